"""The environment: typed objects on a table, an arm with a suction cup, rewards from the task."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.errors import GrsError
from grs_agents.library import Library, ObjectModel
from grs_agents.sim import bullet, geometry, templates, utils, world
from grs_agents.sim.episode import (
    ActionRecord,
    Episode,
    NoFreeSpaceError,
    Recorder,
    SimulationError,
    remember,
    stop_of,
)  # fmt: skip
from grs_agents.sim.goals import as_pose
from grs_agents.sim.instance import InstanceObject
from grs_agents.sim.observation import Observation
from grs_agents.sim.physics import DEFAULT_BUDGET, Budget, Physics, home_joints
from grs_agents.sim.primitives import PickPlace, PickPlaceResult

if TYPE_CHECKING:
    from grs_agents.sim.task import Task

FloatArray = npt.NDArray[np.float64]
Action = Mapping[str, Any]
Info = dict[Any, Any]


class Environment:
    """A table with objects and a robot arm whose base is at the origin (x forward, y left, z up, table top z = 0).

    Args:
        assets_root: kept for CLIPort programs; a folder with a ``manifest.json`` is laid over the library.
        task: may be given later with ``set_task``.
        disp, shared_memory, hz, record_cfg: accepted and ignored.
        library: 3D assets; None for the shipped ones.
        seed: of ``rng``, which places objects at random; None for the process's default.
        budget: simulated steps this environment may use.

    Example::

        env = Environment(assets_root, disp=False, hz=480, record_cfg=[])
        env.set_task(task)
        obs = env.reset()
    """

    def __init__(
        self,
        assets_root: str | Path = "",
        task: "Task | None" = None,
        disp: bool = False,
        shared_memory: bool = False,
        hz: int = 240,
        record_cfg: Any = None,
        *,
        library: Library | None = None,
        seed: int | None = None,
        budget: int = DEFAULT_BUDGET,
    ) -> None:
        self.assets_root = str(assets_root)
        self.disp, self.shared_memory, self.hz, self.record_cfg = disp, shared_memory, hz, record_cfg
        self.library = library or templates.default_library()
        if assets_root and (Path(assets_root) / "manifest.json").is_file():
            self.library = self.library.overlay(Path(assets_root))
        self.bounds: FloatArray = np.array([[0.25, 0.75], [-0.5, 0.5], [0.0, 0.28]])
        self.pix_size = 0.003125
        self.timestep = world.TIMESTEP
        self.task: Task | None = None
        self.recorder = Recorder()
        self.warnings: list[str] = []
        self.failed_placements = 0
        self.budget = Budget(budget)
        self._objects: dict[int, InstanceObject] = {}
        self._physics: Physics | None = None
        self._stale = False
        self.seed(templates.default_seed() if seed is None else seed)
        bullet.attach(self)
        if task is not None:
            self.set_task(task)

    # --- set-up -----------------------------------------------------------------------------------------

    def set_task(self, task: "Task") -> None:
        """Choose the task that ``reset`` sets up."""
        self.task = task

    def seed(self, seed: int | None = None) -> int:
        """Seed ``rng``; returns the seed used."""
        self.seed_used = templates.default_seed() if seed is None else int(seed)
        self.rng = np.random.default_rng(self.seed_used)
        return self.seed_used

    def reset(self, settle: bool = True) -> Observation:
        """Clear the table, let the task set its scene up, and wait until all rests (unless ``settle`` is False).

        Raises:
            SimulationError: there is no task, or the scene cannot be set up.
        """
        if self.task is None:
            raise SimulationError("env.reset() without a task", "call env.set_task(task) first")
        bullet.attach(self)
        self._objects.clear()
        self._physics, self._stale, self.failed_placements = None, False, 0
        self.warnings.clear()
        self.recorder = Recorder(max_steps=int(self.task.max_steps))
        remember(self.recorder)
        try:
            self.task.reset(self)
        except GrsError as error:
            self.recorder.stop = stop_of(error)
            raise
        self.task.finish_reset(self)
        if settle:
            self._lift_out_of_table()
            self.physics.relax()
            self.physics.settle()
            self._note()
        return self.observation

    def add_object(
        self,
        urdf: str,
        pose: Any,
        category: Literal["fixed", "rigid"] = "rigid",
        color: str | Sequence[float] | None = None,
        **_: Any,
    ) -> int:
        """Put an object on the table.

        Args:
            urdf: library-relative name, e.g. ``"HOPE/Milk.urdf"``, or what ``task.fill_template`` returned.
            pose: ``((x, y, z), (qx, qy, qz, qw))`` of the centre of its bounding box, metres, robot frame.
            category: ``"rigid"`` can be moved, ``"fixed"`` (containers, zones) cannot.
            color: a name of ``utils.COLORS`` or (r, g, b) 0..1, laid over the asset's own.

        Returns:
            The object's id.

        Raises:
            UnknownNameError: no such asset; the message lists the nearest names.
            NoFreeSpaceError: ``pose`` is None, as ``get_random_pose`` returns when nothing is free.
        """
        name = templates.asset_name(urdf, self.library)
        if pose is None or pose[0] is None:
            raise NoFreeSpaceError(
                f"add_object({name!r}) was given the pose None: no free place was found for it",
                "add fewer or smaller objects, or give a fixed pose",
            )
        shapes = templates.filled_model(name)
        if shapes is None:
            self.library.asset(name)
        if category not in ("fixed", "rigid"):
            raise SimulationError(f"add_object: category {category!r} is not supported", "use 'fixed' or 'rigid'")
        return self.insert(
            InstanceObject(
                id=0, asset=name, shapes=shapes, pose=as_pose(pose, f"add_object({name!r})"), category=category,
                color=None if color is None else _rgba(color),
            )
        )  # fmt: skip

    def insert(self, item: InstanceObject) -> int:
        """Add a typed object; returns the id it has here."""
        number = max(self._objects, default=0) + 1
        self._objects[number] = item.model_copy(update={"id": number})
        self._stale = True
        return number

    def set_color(self, obj: int, color: str | Sequence[float]) -> None:
        """Recolour an object: a name of ``utils.COLORS`` or (r, g, b) 0..1."""
        self._objects[obj] = self.object(obj).model_copy(update={"color": _rgba(color)})

    set_object_color = set_color

    # --- what there is ----------------------------------------------------------------------------------

    @property
    def objects(self) -> tuple[InstanceObject, ...]:
        """Every object with its present pose."""
        return tuple(item.model_copy(update={"pose": self.get_object_pose(item.id)}) for item in self._objects.values())

    @property
    def obj_ids(self) -> dict[str, list[int]]:
        """Ids of objects by category: ``fixed``, ``rigid``, ``deformable``."""
        return {
            kind: [item.id for item in self._objects.values() if item.category == kind]
            for kind in ("fixed", "rigid", "deformable")
        }

    def object(self, obj: int) -> InstanceObject:
        """The object with an id.

        Raises:
            SimulationError: there is none.
        """
        if obj not in self._objects:
            raise SimulationError(f"there is no object {obj!r}", f"use one of the ids {sorted(self._objects)}")
        return self._objects[obj]

    def shapes(self, obj: int) -> ObjectModel:
        """What an object is made of."""
        return world.model_of(self.object(obj), self.library)

    def is_free(self, obj: int) -> bool:
        """Whether an object can be moved."""
        return world.is_free(self.object(obj), self.shapes(obj))

    def get_object_pose(self, obj: int) -> Pose:
        """Position (m) of the centre of an object's box and its rotation (xyzw)."""
        item = self.object(obj)
        if self._physics is not None and obj in self._physics.world.bodies:
            return self._physics.pose(obj)
        return item.pose

    def get_object_size(self, obj: int) -> Vec3:
        """Upright extents x, y, z of an object, metres."""
        return self.shapes(obj).size

    def outlines(self) -> list[geometry.Prism]:
        """The upright prisms of every object as it stands now."""
        found: list[geometry.Prism] = []
        for number in self._objects:
            found.extend(geometry.prisms(self.shapes(number), self.get_object_pose(number), number))
        return found

    @property
    def info(self) -> Info:
        """``{id: (position, rotation, size), ..., 'lang_goal': str}``."""
        found: Info = {
            number: (*self.get_object_pose(number), self.get_object_size(number)) for number in self._objects
        }
        found["lang_goal"] = self.get_lang_goal()
        return found

    def get_lang_goal(self) -> str:
        """The current goal in words."""
        return self.task.get_lang_goal() if self.task is not None else ""

    @property
    def is_static(self) -> bool:
        """Whether everything rests."""
        return self.physics.speed() < 0.01

    @property
    def observation(self) -> Observation:
        """``{'color': three images, 'depth': three images}``, rendered when they are read."""
        joints = home_joints() if self._physics is None else self._physics.joints
        return Observation(self.objects, self.library, joints)

    @property
    def episode(self) -> Episode:
        """How the current episode stands."""
        return self.recorder.episode()

    # --- acting -----------------------------------------------------------------------------------------

    @property
    def physics(self) -> Physics:
        """The running world, compiled from the objects when they have changed."""
        if self._physics is None or self._stale:
            joints = None if self._physics is None else self._physics.joints
            current = self.objects
            self._objects = {item.id: item for item in current}
            observer = None if self._physics is None else self._physics.observer
            self._physics = Physics(world.build(current, self.library, self.timestep), self.budget, joints)
            self._physics.observer = observer
            self._stale = False
        return self._physics

    def step_simulation(self, steps: int = 1) -> None:
        """Simulate a number of time steps."""
        self.physics.step(steps)

    def step(self, action: Action | None = None) -> tuple[Observation, float, bool, Info]:
        """Pick and place once, then score.

        Args:
            action: ``{'pose0': pick pose, 'pose1': place pose}`` of the suction cup's tip, or None to wait.

        Returns:
            (observation, reward added by this step, done, info). ``done``: all goals met, or ``max_steps`` used.
        """
        if self.task is None:
            raise SimulationError("env.step() without a task", "call env.set_task(task) first")
        if action is None:
            self.physics.step(10)
            reward = self.task.reward()[0]
        else:
            pick, place = as_pose(action["pose0"], "pose0"), as_pose(action["pose1"], "pose1")
            result = self.pick_place(pick, place)
            reward = self.task.reward()[0]
            asset = "" if result.grasped is None else self.object(result.grasped).asset
            self.recorder.actions.append(
                ActionRecord(
                    object=result.grasped, asset=asset, pick=pick[0], place=place[0], reward=reward, note=result.note
                )
            )
        self._note()
        done = self.task.done() or len(self.recorder.actions) >= self.task.max_steps
        return self.observation, reward, done, self.info

    def pick_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at one pose of the tip and place at another; does not score."""
        names = {number: item.asset for number, item in self._objects.items()}
        return PickPlace(self.physics, self.outlines(), names).run(pick, place)

    def _note(self) -> None:
        if self.task is None:
            return
        self.recorder.reward = self.task.total_reward
        self.recorder.complete = self.task.done()
        self.recorder.placed, self.recorder.wanted = self.task.count()

    def _lift_out_of_table(self) -> None:
        for number in list(self._objects):
            if not self.is_free(number):
                continue
            pose = self.get_object_pose(number)
            low = geometry.footprint(self.shapes(number), pose).low
            if low < 0:
                (x, y, z), rotation = pose
                self.place_object(number, ((x, y, z - low + 0.0002), rotation))

    def place_object(self, obj: int, pose: Pose) -> None:
        """Set an object down at a pose at once, without the arm."""
        self._objects[obj] = self.object(obj).model_copy(update={"pose": pose})
        if self._physics is not None and not self._stale:
            self._physics.teleport(obj, pose)


def _rgba(color: str | Sequence[float]) -> tuple[float, float, float, float]:
    if isinstance(color, str):
        if color not in utils.COLORS:
            raise SimulationError(f"colour {color!r} is unknown", f"use one of {', '.join(sorted(utils.COLORS))}")
        return (*utils.COLORS[color], 1.0)
    values = [min(max(float(value), 0.0), 1.0) for value in color]
    if len(values) not in (3, 4):
        raise SimulationError(f"colour {list(color)!r} is not (r, g, b)", "give three numbers in 0..1")
    return (values[0], values[1], values[2], values[3] if len(values) == 4 else 1.0)
