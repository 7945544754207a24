"""The table: typed objects, where they stand, and the running world that is compiled from them."""

import difflib
import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
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
from grs_agents.sim.instance.episode import InvalidValueError, NoFreeSpaceError, Recorder, SimulationError
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.task_instance import InstanceObject, InstanceTie
from grs_agents.sim.world import budget, bystanders, compilation, footprints, spec, templates
from grs_agents.sim.world.collision_volumes import Volume, sample_collision_volume
from grs_agents.sim.world.colors import color_to_rgba
from grs_agents.sim.world.physics import Physics


@dataclass(frozen=True)
class _SettledScene:
    """A scene before it settled, all that decides how it does; its state afterwards, and the steps that this took."""

    before: object
    world: compilation.World
    state: Any
    steps: int


_REMEMBERED = 8
"""Compiled worlds of a library that are kept: a program's tests and an audit's episodes have one or two."""
_compiled: WeakKeyDictionary[Library, dict[object, compilation.World]] = WeakKeyDictionary()
_SETTLED = 4
"""Settled scenes of a library that are kept, those used last: a suite of tests, run on mutants too, returns to few."""
_settled: WeakKeyDictionary[Library, list[_SettledScene]] = WeakKeyDictionary()
CATEGORIES = ("fixed", "rigid", "deformable")


class Tabletop:
    """Objects on a table, compiled into a world when they have changed."""

    def __init__(self, library: Library, steps: budget.Budget, arm: Arm, seed: int | None = None) -> None:
        self.library, self.budget, self.arm = library, steps, arm
        self.bounds: FloatArray = np.array([[0.25, 0.75], [-0.5, 0.5], [0.0, 0.28]])  # metres
        self.recorder = Recorder()
        self.places: dict[int, Pose] = {}  # of every object when the scene had settled
        self.seed(seed)
        self.timestep = spec.TIMESTEP
        self.tool: spec.Tool = "suction"
        self.background = templates.defaults.background
        self._objects: dict[int, InstanceObject] = {}
        self._copies: dict[int, tuple[InstanceObject, InstanceObject]] = {}  # objects with their last pose
        self._prisms: dict[int, tuple[ObjectModel, Pose, tuple[list[footprints.Prism], footprints.Prism]]] = {}
        self._ties: list[InstanceTie] = []
        self._models: dict[int, ObjectModel] = {}
        self._physics: Physics | None = None
        self._stale, self._vertices = False, 0
        self._world: tuple[object, compilation.World] | None = None

    def seed(self, seed: int | None = None) -> int:
        """Seed ``rng``, which places objects at random; returns the seed used."""
        self.seed_used = templates.defaults.seed if seed is None else int(seed)
        self.rng = np.random.default_rng(self.seed_used)
        return self.seed_used

    def remove_all_objects(self) -> None:
        """Take everything off the table but the bystanders; the arm goes home."""
        self._objects.clear()
        self._ties.clear()
        self._models.clear()
        self._physics, self._stale, self._vertices, self.background = None, False, 0, templates.defaults.background
        for item in templates.defaults.bystanders:
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
        self.warn_of_unknown_arguments("env.add_object", _unknown, Tabletop.add_object)
        pair = cast("Sequence[Any]", pose) if isinstance(pose, tuple | list) else ()
        if pose is None or (pair and pair[0] is None):
            found = f"add_object({name!r}) was given the pose None: no free place was found for it"
            raise NoFreeSpaceError(found, "add fewer or smaller objects, or give a fixed pose")
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
        return self.insert_object(self._replace_bystander_by_object(item))

    def _replace_bystander_by_object(self, item: InstanceObject) -> InstanceObject:
        """Take the bystander that a task's object stands for off the table; the object takes its place there."""
        around = [one for one in self._objects.values() if one.role == "bystander"]
        claimed = bystanders.find_nearest_bystander_of_asset(item, around)
        if claimed is None:
            return item
        del self._objects[claimed.id]
        self._vertices -= budget.add_to_vertex_count(0, self._models[claimed.id], self.library)
        return bystanders.adopt_bystander_rest_pose(item, claimed)

    def restore_bystanders(self) -> None:
        """Put bystanders where the photo shows them, as the task's objects claim them from where they stand now.

        So the scene does not depend on how the program came to it.
        """
        if not templates.defaults.bystanders:
            return
        own = [item for item in self.objects if item.role == "task"]
        placed, around = bystanders.match_objects_to_bystanders(own, templates.defaults.bystanders)
        self._models |= {item.id: spec.load_object_model(item, self.library) for item in around}
        self._objects = {item.id: item for item in (*placed, *around)}
        self._physics, self._stale = None, False

    def insert_object(self, item: InstanceObject) -> int:
        """Add a typed object and return the id it has here; refuse what is too large, too thin or one too many."""
        budget.check_object_count(len(self._objects) + 1)
        number = self._next_object_id if item.role == "task" else self._choose_free_bystander_id(item.id)
        shapes = spec.load_object_model(item, self.library)
        self._vertices = budget.add_to_vertex_count(self._vertices, shapes, self.library)
        self._objects[number] = item if item.id == number else item.model_copy(update={"id": number})
        self._models[number], self._stale = shapes, True
        return number

    @property
    def _next_object_id(self) -> int:
        """The id of the task's next object."""
        return max((item.id for item in self._task_objects), default=0) + 1

    def _choose_free_bystander_id(self, wanted: int) -> int:
        """The id that a bystander has, or another one if the task's objects may come to have that."""
        if wanted >= bystanders.FIRST_BYSTANDER and wanted not in self._objects:
            return wanted
        return max([bystanders.FIRST_BYSTANDER - 1, *self._objects]) + 1

    def tie_objects(self, tie: InstanceTie) -> int:
        """Keep two objects together; returns the number of the tie; raises ``SimulationError`` for no such object."""
        for number in (tie.parent, tie.child):
            self.object_by_id(number)
        self._ties.append(tie)
        self._stale = True
        return len(self._ties)

    @property
    def object_ties(self) -> tuple[InstanceTie, ...]:
        """What keeps objects together."""
        return tuple(self._ties)

    def record_warning(self, text: str) -> None:
        """Note, once, what had to be assumed; it goes into the task instance."""
        if text not in self.warnings:
            self.warnings.append(text)

    @property
    def warnings(self) -> list[str]:
        """What was noted since the last reset."""
        return self.recorder.warnings

    def warn_of_unknown_arguments(self, call: str, given: Iterable[str], function: Callable[..., Any]) -> None:
        """Note arguments that a call was given and that its function does not have: they have no effect."""
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

    set_object_color = set_color

    @property
    def objects(self) -> tuple[InstanceObject, ...]:
        """Every object with its present pose."""
        return tuple(self._copy_with_current_pose(item) for item in self._objects.values())

    def _copy_with_current_pose(self, item: InstanceObject) -> InstanceObject:
        pose = self.get_object_pose(item.id)
        if pose is item.pose:
            return item
        known = self._copies.get(item.id)
        if known is None or known[0] is not item or known[1].pose != pose:  # most things stand where they stood
            known = self._copies[item.id] = (item, item.model_copy(update={"pose": pose}))
        return known[1]

    @property
    def obj_ids(self) -> dict[str, list[int]]:
        """Ids of the task's objects by category: ``fixed``, ``rigid``, ``deformable``."""
        return {kind: [item.id for item in self._task_objects if item.category == kind] for kind in CATEGORIES}

    @property
    def _task_objects(self) -> list[InstanceObject]:
        """What the task has put on the table, all that programs are told of."""
        return [item for item in self._objects.values() if item.role == "task"]

    def object_by_id(self, obj: Any) -> InstanceObject:
        """The object with an id; raises ``SimulationError`` if there is none."""
        item = self._objects.get(obj) if obj.__hash__ else None  # a list has no hash
        if item is None:
            ids = ", ".join(map(str, list(self._objects)[:20])) or "none yet"
            more = ", ..." if len(self._objects) > 20 else ""
            raise SimulationError(f"there is no object {obj!r}"[:150], f"use one of the ids {ids}{more}")
        return item

    def object_model(self, obj: int) -> ObjectModel:
        """What an object is made of."""
        return self._models[self.object_by_id(obj).id]

    def object_collision_points(self, obj: int) -> Volume:
        """The collision volume of an object as points in its own frame."""
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
        """The upright prisms of every object's colliders as it stands now."""
        return [prism for number in self._objects for prism in self._find_prisms(number)[0]]

    def object_prism(self, obj: int) -> footprints.Prism:
        """One upright prism around a whole object as it stands now."""
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
        """The running world, compiled from the objects when they have changed."""
        if self._physics is None or self._stale:
            before, current = self._physics, self.objects
            self._objects = {item.id: item for item in current}
            joints = None if before is None else before.joint_positions
            self._physics = Physics(self._compile_world(current), self.budget, current, joints)
            if before is not None:
                self._physics.observer, self._physics.observer_period = before.observer, before.observer_period
            self._stale = False
        return self._physics

    def _compile_world(self, objects: Sequence[InstanceObject]) -> compilation.World:
        """The compiled world of these objects; the last one again if only their places differ.

        Environments that come after each other share what is compiled, each has a copy of its own.
        """
        kinds = tuple(
            (item.id, item.asset, tuple(sorted(item.fill.items())), item.category, item.mass, item.friction)
            for item in objects
        )
        key = (self.timestep, kinds, self.object_ties, self.tool, self.background, self.arm)
        if self._world is None or self._world[0] != key:
            known = _compiled.setdefault(self.library, {})
            if key not in known:
                if len(known) >= _REMEMBERED:
                    known.clear()
                known[key] = compilation.build_world(
                    objects, self.library, self.timestep, False, *key[2:4], self.arm, self.background
                )
            self._world = (key, compilation.copy_world(known[key]))
        return self._world[1]

    def settle_scene(self) -> None:
        """Let everything settle; a scene that was settled before is taken up as it came to rest then."""
        before = (self.timestep, self.objects, self.object_ties, self.tool, self.background, self.arm)
        scenes = _settled.setdefault(self.library, [])
        known = next((scene for scene in scenes if scene.before == before), None)
        if known is not None:
            scenes.remove(known)
            self.budget.spend_steps(known.steps)
            self.physics.restore_state(known.state)
        else:
            known = self._settle_and_remember(before, scenes.pop(0) if len(scenes) >= _SETTLED else None)
        scenes.append(known)

    def _settle_and_remember(self, before: object, forgotten: _SettledScene | None) -> _SettledScene:
        start = self.budget.left
        self.raise_sunken_objects()
        self.physics.separate_overlapping_bodies()
        self.physics.simulate_until_at_rest()
        reused = forgotten.state if forgotten is not None and forgotten.world is self.physics.world else None
        state = self.physics.save_state(reused)
        return _SettledScene(before, self.physics.world, state, start - self.budget.left)

    def step_simulation(self, steps: int = 1) -> None:
        """Simulate a number of time steps; errors as ``Physics.check``."""
        self.physics.step(steps)
        self.physics.raise_if_diverged()

    def raise_sunken_objects(self) -> None:
        """Raise what reaches below the table top, as objects placed from noisy depth may."""
        for number, item in list(self._objects.items()):
            if not spec.is_movable(item, self._models[number]):
                continue
            pose = self.get_object_pose(number)
            low = footprints.lowest_height_at_pose(self._models[number], pose)
            if low < 0:
                (x, y, z), rotation = pose
                self.set_object_pose(number, ((x, y, z - low + 0.0002), rotation))

    def set_object_pose(self, obj: int, pose: Pose) -> None:
        """Set an object down at a pose at once, without the arm."""
        self._objects[obj] = self.object_by_id(obj).model_copy(update={"pose": pose})
        if not self.is_object_movable(obj):
            self._stale = True
        elif self._physics is not None and not self._stale:
            self._physics.teleport_object(obj, pose)


def is_number(value: Any) -> bool:
    """Whether a value is one real number, of Python or of numpy."""
    return bool(np.isscalar(value))


def is_vector(value: Any, *lengths: int) -> bool:
    """Whether something is a flat row of as many numbers as one of ``lengths``."""
    try:
        return len(value) in lengths and all(is_number(number) for number in value)
    except TypeError:
        return False


def parse_pose(value: Any, what: str) -> Pose:
    """A pose from a position (m) and perhaps a quaternion (xyzw); else a ``SimulationError``."""
    if (plain := transforms.parse_pose(value)) is not None:
        return plain
    try:
        if is_vector(value, 3):
            value = (value, transforms.IDENTITY)
        position = np.asarray(value[0], dtype=np.float64).ravel()
        turn = value[1] if len(value) > 1 and value[1] is not None else transforms.IDENTITY
        rotation = np.asarray(turn, dtype=np.float64)
    except (TypeError, ValueError, LookupError, OverflowError) as error:
        raise SimulationError(f"{what}: {value!r} is not a pose", "give ((x, y, z), (qx, qy, qz, qw))") from error
    if position.shape == rotation.shape == (3,):
        raise SimulationError(
            f"{what}: {value!r} has three numbers as its rotation",
            "give a quaternion (qx, qy, qz, qw); utils.eulerXYZ_to_quatXYZW makes one of three angles",
        )
    if position.shape != (3,) or rotation.shape != (4,) or not np.isfinite([*position, *rotation]).all():
        raise SimulationError(f"{what}: {value!r} is not a pose", "give ((x, y, z), (qx, qy, qz, qw)), all finite")
    return (transforms.to_vec3(position), transforms.to_unit_quaternion(rotation))
