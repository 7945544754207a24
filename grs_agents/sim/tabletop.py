"""The simulated table: typed objects, a robot arm with an end effector, and the physics compiled from them."""

import difflib
import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, cast
from weakref import WeakKeyDictionary

import numpy as np
from pydantic import ValidationError

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.end_effectors import EndEffector, make_end_effector
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.instance.episode import (
    Episode,
    InvalidValueError,
    NoFreeSpaceError,
    Recorder,
    SimulationError,
)
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.task_instance import InstanceObject, InstanceTie
from grs_agents.sim.motion import placement
from grs_agents.sim.motion.finger_pick_place import FingerPickPlace
from grs_agents.sim.motion.pick_place import PickPlaceMotion, PickPlaceResult
from grs_agents.sim.motion.push import Push, PushResult
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.world import bystanders, compilation, footprints, spec, templates
from grs_agents.sim.world.budget import DEFAULT_BUDGET, Budget, add_to_vertex_count, check_object_count
from grs_agents.sim.world.collision_volumes import Volume, sample_collision_volume
from grs_agents.sim.world.colors import color_to_rgba
from grs_agents.sim.world.context import SimContext
from grs_agents.sim.world.physics import Physics

CATEGORIES = ("fixed", "rigid", "deformable")
_SHIFT, _DROP = 0.01, 0.03
"""Settling that moves an object farther sideways, or lets it drop farther, is reported, metres."""
_POSE_FORMS = "give ((x, y, z), (qx, qy, qz, qw)) or, without a turn, (x, y, z)"
_OVERLAP = 0.002
"""Depth from which on two objects count as placed inside each other, metres."""
_COMPILED_WORLDS = 8
"""Compiled worlds kept for each library: a program's tests and an audit's episodes need two at most."""
_SETTLED_SCENES = 4
"""Settled scenes kept for each library, least recently used dropped: test suites, run on mutants too, revisit few."""


@dataclass(frozen=True)
class _SettledScene:
    """A scene before it settled (all that decides the result), its state afterwards, and the steps that this took."""

    before: object
    world: compilation.World
    state: Any
    steps: int


@dataclass
class _SceneCache:
    """Compiled worlds and settled scenes of a library, shared by the simulations of a process."""

    worlds: dict[object, compilation.World] = field(default_factory=dict[object, compilation.World])
    settled: list[_SettledScene] = field(default_factory=list[_SettledScene])


_scene_caches: WeakKeyDictionary[Library, _SceneCache] = WeakKeyDictionary()


class TabletopSim:
    """A table with objects and a robot arm whose base is at the origin (x forward, y left, z up, table top z = 0).

    It knows no task: ``TabletopEpisode`` sets up and scores one on it. The physics is compiled when it is needed and
    the objects have changed.

    Args:
        library: 3D assets.
        seed: of ``rng``, which places objects at random; None for the context's.
        budget: simulated steps allowed.
        robot: ``"ur5e"``, ``"panda"`` or the path of an MJCF or URDF file; None for the context's.
        hand: ``"suction"``, ``"franka_hand"`` or ``"robotiq_2f85"``; None for the context's.
        context: settings and bystanders of every scene; None for an empty table.
    """

    def __init__(
        self,
        library: Library,
        *,
        seed: int | None = None,
        budget: int = DEFAULT_BUDGET,
        robot: str | None = None,
        hand: str | None = None,
        context: SimContext | None = None,
    ) -> None:
        self.context = context or SimContext()
        self.library, self.budget = library, Budget(budget)
        self.robot, self.hand = robot or self.context.robot, hand or self.context.hand
        get_arm(self.robot, self.hand)  # refused now if it cannot be used
        self.bounds: FloatArray = np.array([[0.25, 0.75], [-0.5, 0.5], [0.0, 0.28]])  # metres
        self.recorder = Recorder()
        self.places: dict[int, Pose] = {}  # of every object once the scene had settled
        self.explain_lack_of_space: Callable[[], str] | None = None  # for the last place that was not found
        self.seed(seed)
        self.timestep = spec.TIMESTEP
        self.end_effector: EndEffector = make_end_effector("pick_place", self.hand)
        self.background = self.context.background
        self._objects: dict[int, InstanceObject] = {}
        self._copies: dict[int, tuple[InstanceObject, InstanceObject]] = {}  # objects with their last pose
        self._prisms: dict[int, tuple[ObjectModel, Pose, tuple[list[footprints.Prism], footprints.Prism]]] = {}
        self._ties: list[InstanceTie] = []
        self._models: dict[int, ObjectModel] = {}
        self._physics: Physics | None = None
        self._stale, self._vertices = False, 0
        self._world: tuple[object, compilation.World] | None = None

    @property
    def arm(self) -> Arm:
        """The arm with the hand of the present end effector: pushing takes a spatula in place of any hand."""
        return get_arm(self.robot, DEFAULT_HAND if self.end_effector.tool == "spatula" else self.hand)

    def seed(self, seed: int | None = None) -> int:
        """Seed ``rng``, which places objects at random; None for the context's seed. Returns the seed used."""
        self.seed_used = self.context.seed if seed is None else int(seed)
        self.rng = np.random.default_rng(self.seed_used)
        return self.seed_used

    def remove_all_objects(self) -> None:
        """Clear the table but for the bystanders; the arm goes home."""
        self._objects.clear()
        self._ties.clear()
        self._models.clear()
        self._physics, self._stale, self._vertices, self.background = None, False, 0, self.context.background
        for item in self.context.bystanders:
            self.insert_object(item)

    def add_object(
        self,
        urdf: str,
        pose: Any,
        category: Literal["fixed", "rigid", "deformable"] = "rigid",
        color: str | Sequence[float] | None = None,
        **_unknown: Any,
    ) -> int:
        """Put an object on the table.

        Args:
            urdf: library-relative name, e.g. ``"HOPE/Milk.urdf"``, or what ``task.fill_template`` returned.
            pose: ``((x, y, z), (qx, qy, qz, qw))`` of the centre of its bounding box, metres, robot frame.
            category: ``"rigid"`` can be moved, ``"fixed"`` (containers, zones) cannot; ``"deformable"`` is moved
                as rigid.
            color: a name of ``utils.COLORS`` or (r, g, b) 0..1, laid over the asset's own.

        Returns:
            The object's id.

        Raises:
            UnknownNameError: no such asset; the message lists the nearest names.
            NoFreeSpaceError: ``pose`` is None, as ``get_random_pose`` returns when nothing is free.
        """
        name = templates.resolve_asset_name(urdf, self.library)
        self.warn_of_unknown_arguments("env.add_object", _unknown, TabletopSim.add_object)
        pair = cast("Sequence[Any]", pose) if isinstance(pose, tuple | list) else ()
        if pose is None or (pair and pair[0] is None):
            reason = self.explain_lack_of_space() if self.explain_lack_of_space else "no free place was found for it"
            raise NoFreeSpaceError(
                f"add_object({name!r}) was given the pose None: {reason}",
                "add fewer or smaller objects, the largest first, or give a fixed pose",
            )
        filling = templates.find_filling_by_name(name)
        if filling is None:
            self.library.asset(name)
            if defaults := self.library.template_defaults(name):
                values = templates.describe_placeholder_values(defaults)
                self.record_warning(f"{name} was not filled in: it takes its defaults, {values}")
        if category not in CATEGORIES:
            raise SimulationError(f"add_object: category {category!r} is unknown", f"use one of {CATEGORIES}")
        if category == "deformable":
            self.record_warning(f"add_object({name!r}): 'deformable' moves as 'rigid' does")
        number, asset = self._next_object_id, filling.template if filling else name
        call = f"add_object({name!r})"
        rgba = None if color is None else color_to_rgba(color, f"{call}: ")
        at, fill = parse_pose(pose, call), dict(filling.values) if filling else {}
        try:
            item = InstanceObject(id=number, asset=asset, fill=fill, color=rgba, pose=at, category=category)
        except ValidationError as error:
            raise InvalidValueError(describe_first_error(error, call)) from error
        around = [other for other in self._objects.values() if other.role == "bystander"]
        claimed = bystanders.find_nearest_bystander_of_asset(item, around)
        if claimed is not None:  # the object takes the place of the bystander that it stands for
            del self._objects[claimed.id]
            self._vertices -= add_to_vertex_count(0, self._models[claimed.id], self.library)
            item = bystanders.adopt_bystander_rest_pose(item, claimed)
        return self.insert_object(item)

    def restore_bystanders(self) -> None:
        """Set the bystanders up as in the photo, without those that the task's objects now stand for.

        The scene then does not depend on the order in which the program set it up.
        """
        if not self.context.bystanders:
            return
        own = [item for item in self.objects if item.role == "task"]
        placed, around = bystanders.match_objects_to_bystanders(own, self.context.bystanders)
        self._models |= {item.id: spec.load_object_model(item, self.library) for item in around}
        self._objects = {item.id: item for item in (*placed, *around)}
        self._physics, self._stale = None, False

    def insert_object(self, item: InstanceObject) -> int:
        """Add a typed object; returns its id on this table. Errors as ``add_object``."""
        check_object_count(len(self._objects) + 1)
        number = item.id
        if item.role == "task":
            number = self._next_object_id
        elif number < bystanders.FIRST_BYSTANDER or number in self._objects:  # the task's objects may come to have it
            number = max([bystanders.FIRST_BYSTANDER - 1, *self._objects]) + 1
        shapes = spec.load_object_model(item, self.library)
        self._vertices = add_to_vertex_count(self._vertices, shapes, self.library)
        self._objects[number] = item if item.id == number else item.model_copy(update={"id": number})
        self._models[number], self._stale = shapes, True
        return number

    @property
    def _next_object_id(self) -> int:
        """The id of the task's next object."""
        return max((item.id for item in self._task_objects), default=0) + 1

    def replace_object(self, item: InstanceObject) -> None:
        """Replace the object with the same id, before anything has moved."""
        self.object_by_id(item.id)
        self._objects[item.id], self._models[item.id] = item, spec.load_object_model(item, self.library)
        self._physics, self._stale = None, False

    def tie_objects(self, tie: InstanceTie) -> int:
        """Tie two objects together; returns the number of the tie. Raises ``SimulationError`` for an unknown id."""
        for number in (tie.parent, tie.child):
            self.object_by_id(number)
        self._ties.append(tie)
        self._stale = True
        return len(self._ties)

    @property
    def object_ties(self) -> tuple[InstanceTie, ...]:
        """Ties between objects."""
        return tuple(self._ties)

    def record_warning(self, text: str) -> None:
        """Record an assumption, once; it goes into the task instance."""
        if text not in self.warnings:
            self.warnings.append(text)

    @property
    def warnings(self) -> list[str]:
        """Assumptions recorded since the last reset."""
        return self.recorder.warnings

    def warn_of_unknown_arguments(self, call: str, given: Iterable[str], function: Callable[..., Any]) -> None:
        """Warn of arguments that a call was given and its function does not have; they have no effect."""
        for name in given:
            known = [name for name in inspect.signature(function).parameters if name != "self" and name[0] != "_"]
            alike = difflib.get_close_matches(name, known, 1)
            hint = f"; {alike[0]} may be meant" if alike else f"; there are {', '.join(known)}"
            self.record_warning(f"{call} has no argument {name}, what was given for it had no effect{hint}")

    def set_color(self, obj: int, color: str | Sequence[float]) -> None:
        """Recolour an object: a name of ``utils.COLORS`` or (r, g, b) 0..1."""
        item = self.object_by_id(obj)
        rgba = color_to_rgba(color, f"object {item.id} ({item.asset}): ")
        self._objects[obj] = item.model_copy(update={"color": rgba})

    @property
    def objects(self) -> tuple[InstanceObject, ...]:
        """Every object with its present pose."""
        current: list[InstanceObject] = []
        for number, item in self._objects.items():
            pose = self.get_object_pose(number)
            if pose is item.pose:
                current.append(item)
                continue
            known = self._copies.get(number)
            if known is None or known[0] is not item or known[1].pose != pose:  # most objects have not moved
                known = self._copies[number] = (item, item.model_copy(update={"pose": pose}))
            current.append(known[1])
        return tuple(current)

    @property
    def _task_objects(self) -> list[InstanceObject]:
        """Objects that the task added; programs see no others."""
        return [item for item in self._objects.values() if item.role == "task"]

    def object_by_id(self, obj: Any) -> InstanceObject:
        """The object with an id; raises ``SimulationError`` for an unknown id."""
        item = self._objects.get(obj) if obj.__hash__ else None  # a list has no hash
        if item is None:
            ids = ", ".join(map(str, list(self._objects)[:20])) or "none yet"
            more = ", ..." if len(self._objects) > 20 else ""
            remedy = f"use one of the ids {ids}{more}"
            if isinstance(obj, list | tuple):
                remedy = "give a single id: env.find(asset) is a list of them, so env.find(asset)[0]"
            raise SimulationError(f"there is no object {obj!r}"[:150], remedy)
        return item

    def object_model(self, obj: int) -> ObjectModel:
        """Shapes, size and mass of an object."""
        return self._models[self.object_by_id(obj).id]

    def object_collision_points(self, obj: int) -> Volume:
        """Collision volume of an object as points in its own frame."""
        return sample_collision_volume(self.object_model(obj), self.library)

    def is_object_movable(self, obj: int) -> bool:
        """Whether an object can be moved."""
        return spec.is_movable(self.object_by_id(obj), self.object_model(obj))

    def get_object_pose(self, obj: int) -> Pose:
        """Position (m) of the centre of an object's box and its rotation (xyzw)."""
        item = self.object_by_id(obj)
        if self._physics is not None and obj in self._physics.world.addresses:
            return self._physics.object_pose(obj)
        return item.pose

    def get_object_size(self, obj: int) -> Vec3:
        """Extents of an object along its own axes, metres, however it stands."""
        return self.object_model(obj).size

    def collider_prisms(self) -> list[footprints.Prism]:
        """Upright prisms around every object's colliders at their present poses."""
        return [prism for number in self._objects for prism in self._find_prisms(number)[0]]

    def object_prism(self, obj: int) -> footprints.Prism:
        """Upright prism around a whole object at its present pose."""
        return self._find_prisms(obj)[1]

    def _find_prisms(self, number: int) -> tuple[list[footprints.Prism], footprints.Prism]:
        model, pose = self.object_model(number), self.get_object_pose(number)
        known = self._prisms.get(number)
        if known is None or known[0] is not model or known[1] is not pose:
            known = (model, pose, footprints.find_prisms_at_pose(model, pose, number))
            self._prisms[number] = known
        return known[2]

    @property
    def is_static(self) -> bool:
        """Whether everything rests."""
        return self.physics.max_free_body_speed() < 0.01

    @property
    def physics(self) -> Physics:
        """The running world, compiled anew after a change of the objects, unless only their poses differ.

        Environments that come after each other share compiled worlds, each has a copy of its own.
        """
        if self._physics is not None and not self._stale:
            return self._physics
        before, current = self._physics, self.objects
        self._objects = {item.id: item for item in current}
        kinds = tuple(
            (item.id, item.asset, tuple(sorted(item.fill.items())), item.category, item.mass, item.friction)
            for item in current
        )
        tool, ties = self.end_effector.tool, self.object_ties
        key = (self.timestep, kinds, ties, tool, self.background, self.arm)
        if self._world is None or self._world[0] != key:
            known = _scene_caches.setdefault(self.library, _SceneCache()).worlds
            if key not in known:
                if len(known) >= _COMPILED_WORLDS:
                    known.clear()
                known[key] = compilation.build_world(
                    current, self.library, self.timestep, False, ties, tool, self.arm, self.background
                )
            self._world = (key, compilation.copy_world(known[key]))
        joints = None if before is None else before.joint_positions
        self._physics = Physics(self._world[1], self.budget, current, joints)
        if before is not None:
            self._physics.observer, self._physics.observer_period = before.observer, before.observer_period
        self._stale = False
        return self._physics

    def settle_scene(self) -> None:
        """Let everything come to rest, note in ``places`` where, and warn of objects that settling moved.

        A scene that was settled before is restored as it came to rest then.
        """
        placed = {number: self.get_object_pose(number) for number in self._objects}
        before = (self.timestep, self.objects, self.object_ties, self.end_effector.tool, self.background, self.arm)
        scenes = _scene_caches.setdefault(self.library, _SceneCache()).settled
        known = next((scene for scene in scenes if scene.before == before), None)
        if known is not None:
            scenes.remove(known)
            self.budget.spend_steps(known.steps)
            self.physics.restore_state(known.state)
        else:
            forgotten = scenes.pop(0) if len(scenes) >= _SETTLED_SCENES else None
            start = self.budget.left
            self.raise_sunken_objects()
            self.physics.separate_overlapping_bodies()
            self.physics.simulate_until_at_rest()
            reused = forgotten.state if forgotten is not None and forgotten.world is self.physics.world else None
            state = self.physics.save_state(reused)
            known = _SettledScene(before, self.physics.world, state, start - self.budget.left)
        scenes.append(known)
        self.places = {number: self.get_object_pose(number) for number in self._objects}
        self._warn_about_settling(placed)

    def _warn_about_settling(self, placed: Mapping[int, Pose]) -> None:
        """Warn of every object that did not stay at its pose in ``placed``, and why not."""
        moved: list[int] = []
        for number, (start, _) in placed.items():
            end = self.places[number][0]
            if math.dist(start[:2], end[:2]) > _SHIFT or abs(start[2] - end[2]) > _DROP:
                moved.append(number)
        if not moved:
            return
        prisms = {
            number: footprints.object_prism_at_pose(self.object_model(number), at) for number, at in placed.items()
        }
        labels = self.object_labels
        for number in moved:
            start, end = placed[number][0], self.places[number][0]
            inside, within = prisms[number], list[str]()
            for other, prism in prisms.items():
                overlap = min(inside.high, prism.high) - max(inside.low, prism.low)
                if other != number and overlap > _OVERLAP:
                    gap = footprints.signed_outline_gaps(inside.outline, prism.outline, np.zeros((1, 2)))[0]
                    within += [labels[other]] if gap < -_OVERLAP else []
            why = f"was put into {' and '.join(within)}" if within else "was put in the air, or did not stand"
            way = f"from {placement.format_point(start)} to {placement.format_point(end)}"
            self.record_warning(f"{labels[number]} {why}: settling moved it {math.dist(start, end):.3f} m, {way}")

    def step_simulation(self, steps: int = 1) -> None:
        """Simulate a number of time steps; errors as ``Physics.check``."""
        self.physics.step(steps)
        self.physics.raise_if_diverged()

    def raise_sunken_objects(self) -> None:
        """Lift objects that reach below the table top, as those placed from noisy depth may."""
        for number, item in list(self._objects.items()):
            if not spec.is_movable(item, self._models[number]):
                continue
            pose = self.get_object_pose(number)
            low = footprints.lowest_height_at_pose(self._models[number], pose)
            if low < 0:
                (x, y, z), rotation = pose
                self.set_object_pose(number, ((x, y, z - low + 0.0002), rotation))

    def set_object_pose(self, obj: int, pose: Pose) -> None:
        """Teleport an object to a pose."""
        self._objects[obj] = self.object_by_id(obj).model_copy(update={"pose": pose})
        if not self.is_object_movable(obj):
            self._stale = True
        elif self._physics is not None and not self._stale:
            self._physics.teleport_object(obj, pose)

    def pick_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at one pose of the tip and place at another; does not score."""
        return self.pick_place_motion.pick_and_place(pick, place)

    @property
    def pick_place_motion(self) -> PickPlaceMotion | FingerPickPlace:
        """Motions of the arm, from where it is now, that pick and place with its hand."""
        motion = FingerPickPlace if self.end_effector.tool == "fingers" else PickPlaceMotion
        return motion(self.physics, self.collider_prisms, self.object_labels)

    def push(self, pose0: Pose, pose1: Pose) -> PushResult:
        """Push along the table from one pose towards another with the blade; does not score."""
        return Push(self.physics, self.collider_prisms, self.object_labels).push(pose0, pose1)

    @property
    def object_labels(self) -> dict[int, str]:
        """``asset #id`` of each object, its name in episodes."""
        return {number: f"{item.asset} #{number}" for number, item in self._objects.items()}

    @property
    def current_episode(self) -> Episode:
        """Record of the episode so far."""
        return self.recorder.build_episode()

    @property
    def visible_scene(self) -> VisibleScene:
        """Everything that a camera can see now."""
        return VisibleScene(
            tuple(self._objects.values()),
            self.library,
            self.arm.home_joints.copy() if self._physics is None else self._physics.robot_positions,
            self.arm,
            self.end_effector.tool,
            tuple(self.get_object_pose(number) for number in self._objects),
            self.background,
        )


def is_number(value: Any) -> bool:
    """Whether a value is a real number, of Python or of numpy."""
    return bool(np.isscalar(value))


def is_vector(value: Any, *lengths: int) -> bool:
    """Whether a value is a flat sequence of numbers whose length is among ``lengths``."""
    try:
        return len(value) in lengths and all(is_number(number) for number in value)
    except TypeError:
        return False


def parse_pose(value: Any, what: str) -> Pose:
    """A pose from a position (m) and an optional quaternion (xyzw); raises ``SimulationError`` for anything else."""
    if (plain := transforms.parse_pose(value)) is not None:
        return plain
    try:
        if is_vector(value, 3):
            value = (value, transforms.IDENTITY)
        position = np.asarray(value[0], dtype=np.float64).ravel()
        turn = value[1] if len(value) > 1 and value[1] is not None else transforms.IDENTITY
        rotation = np.asarray(turn, dtype=np.float64)
    except (TypeError, ValueError, LookupError, OverflowError) as error:
        raise SimulationError(f"{what}: {value!r} is not a pose", _POSE_FORMS) from error
    if position.shape == rotation.shape == (3,):
        raise SimulationError(
            f"{what}: {value!r} has three numbers as its rotation",
            "give a quaternion (qx, qy, qz, qw); utils.eulerXYZ_to_quatXYZW makes one of three angles",
        )
    if position.shape != (3,) or rotation.shape != (4,) or not np.isfinite([*position, *rotation]).all():
        raise SimulationError(f"{what}: {value!r} is not a pose", f"{_POSE_FORMS}, all finite")
    return (transforms.to_vec3(position), transforms.to_unit_quaternion(rotation))
