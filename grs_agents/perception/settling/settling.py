"""Let a described scene come to rest: overlaps are resolved without gravity, then gravity acts."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.settling.depenetration import Separation, deepest_overlap_depth, separate_objects
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.compilation import World, build_world, reset_world_to_poses

CONFIG = DEFAULT.settling

CHUNK = 25  # so many steps of the simulation are made between two looks at the speeds


def prepare_world_for_settling(world: World) -> None:
    """Take the robot out of the way, and let nothing roll."""
    model, owners = world.model, np.asarray(world.owners)
    # What is eased apart never moves by itself, falls asleep at once, and would sleep through gravity.
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    robot = owners < 0
    robot[model.geom("table").id] = False
    model.geom_contype[robot], model.geom_conaffinity[robot] = 0, 0
    model.geom_condim[owners >= 0] = 6
    model.geom_friction[owners >= 0, 2] = CONFIG.rolling


def push_overlaps_apart(world: World) -> None:
    """Push overlaps apart, without gravity and without speed, so that nothing is thrown.
    And without friction: what sticks to what it is pushed out of goes farther."""
    model, data = world.model, world.data
    gravity, dimensions = np.array(model.opt.gravity), np.array(model.geom_condim)
    model.opt.gravity[:], model.geom_condim[:] = 0, 1
    for _ in range(CONFIG.easing_steps):
        data.qvel[:] = 0
        mujoco.mj_step(model, data)
        if deepest_overlap_depth(world) < CONFIG.eased:
            break
    model.opt.gravity[:], model.geom_condim[:] = gravity, dimensions
    data.qvel[:] = 0


def simulate_until_rest(world: World) -> bool:
    """Let gravity act until everything rests; whether it does in time."""
    model, data = world.model, world.data
    first, still = world.arm.dof, 0
    for _ in range(int(CONFIG.longest / model.opt.timestep / CHUNK)):
        mujoco.mj_step(model, data, CHUNK)
        speed = np.abs(data.qvel[first:].reshape(-1, 6)) * (1, 1, 1, 0.1, 0.1, 0.1)
        still = still + 1 if speed.max(initial=0.0) < CONFIG.still else 0
        if still == 3:
            return True
    return False


@dataclass(frozen=True)
class PlacedObject:
    """An asset, and where the centre of its bounding box is (m) with its rotation (xyzw).
    ``guessed``: it stands for an object of unknown shape, whose place is known less well."""

    asset: str
    pose: Pose
    guessed: bool = False


@dataclass(frozen=True)
class Placed:
    """Where an object came to rest."""

    pose: Pose  # as in `PlacedObject`
    drift: float  # how far its centre moved, m
    held: bool = False  # it would have fallen: it stays where it is


@dataclass(frozen=True)
class RestState:
    """A scene at rest."""

    placed: tuple[Placed | None, ...]  # for each object; ``None`` for what is off the simulated table
    found: float  # found, penetration: the deepest overlap before and after, m
    penetration: float
    still: bool  # everything came to rest

    @property
    def largest_drift(self) -> float:
        """How far anything moved at most, m."""
        return max((placed.drift for placed in self.placed if placed is not None), default=0.0)


def is_over_table(placed: PlacedObject) -> bool:
    """Whether the object is over the simulated table."""
    x, y, z = placed.pose[0]
    away = float(np.hypot(x - CONFIG.table_center[0], y - CONFIG.table_center[1]))
    return away < CONFIG.table_reach and abs(z) < CONFIG.table_reach


def to_instance_objects(objects: Sequence[PlacedObject], library: Library) -> list[InstanceObject]:
    """The objects as those of a simulation; ids count from 0."""
    poses = [_translate_in_own_frame(one.pose, -_bounding_box_center(one.asset, library)) for one in objects]
    numbered = enumerate(zip(objects, poses, strict=True))
    return [InstanceObject(id=number, asset=one.asset, pose=pose) for number, (one, pose) in numbered]


def build_settling_world(items: Sequence[InstanceObject], library: Library) -> World:
    """A world of these objects without the robot, in which nothing rolls."""
    world = build_world(items, library)
    reset_world_to_poses(world, items)
    prepare_world_for_settling(world)
    mujoco.mj_forward(world.model, world.data)
    return world


def settle_objects(objects: Sequence[PlacedObject], library: Library) -> RestState:
    """Let objects come to rest, without the robot.

    Of those that would fall the lowest are held in the air, one after the other, until no other falls: the photo shows
    them at rest, so something carries them that is not described, or not as it is.

    Raises:
        SimulationError: MuJoCo takes the scene for impossible.
    """
    bounds = CONFIG.depenetration
    ways = [Separation(deep, lift, bounds.steps) for deep in bounds.depths for lift in (True, False)]
    ways.append(Separation(bounds.depths[0], lift=True, steps=(*bounds.steps, *bounds.last_steps)))
    rests: list[RestState] = []
    for way in ways:
        rest = _Settler(objects, library, way).compute_rest_state()
        if rest.penetration < CONFIG.overlap and rest.largest_drift < CONFIG.fallen:
            return rest
        rests.append(rest)

    def rest_state_fault_rank(rest: RestState) -> tuple[bool, int, float]:
        """What is wrong, the worst first: overlaps, objects that moved too far, how far all did."""
        drifts = [placed.drift for placed in rest.placed if placed is not None]
        return rest.penetration >= CONFIG.overlap, sum(drift > CONFIG.fallen for drift in drifts), sum(drifts)

    return min(rests, key=rest_state_fault_rank)


@dataclass(frozen=True)
class _Drop:
    """Objects moved apart before gravity acts, the poses in which they rest, and which of them fell, by number."""

    apart: list[InstanceObject]
    poses: list[Pose]
    fell: list[int]
    found: float
    penetration: float
    still: bool


class _Settler:
    """Lets objects come to rest, moved apart in one way."""

    def __init__(self, objects: Sequence[PlacedObject], library: Library, way: Separation) -> None:
        self.objects, self.library, self.way = objects, library, way
        self.here = [number for number, placed in enumerate(objects) if is_over_table(placed)]
        self.items = to_instance_objects([objects[number] for number in self.here], library)
        self.guessed = {item.id for item, number in zip(self.items, self.here, strict=True) if objects[number].guessed}

    def compute_rest_state(self) -> RestState:
        """The scene at rest."""
        first = self._separate_and_drop(self.items, set())
        last, held = self._hold_falling_objects(first)
        placed: list[Placed | None] = [None] * len(self.objects)
        for item, resting, number in zip(self.items, last.poses, self.here, strict=True):
            pose = _translate_in_own_frame(resting, _bounding_box_center(item.asset, self.library))
            drift = _position_distance(pose, self.objects[number].pose)
            placed[number] = Placed(pose, drift, item.id in held)
        return RestState(tuple(placed), first.found, last.penetration, last.still)

    def _hold_falling_objects(self, first: _Drop) -> tuple[_Drop, set[int]]:
        """The scene dropped again, with what falls held in the air: the lowest first."""
        last, held = first, set[int]()
        while fell := [number for number in last.fell if number not in held]:
            held.add(min(fell, key=lambda number: _lowest_corner_height(first.apart[number], self.library)))
            last = self._separate_and_drop(first.apart, held)
        return last, held

    def _separate_and_drop(self, items: Sequence[InstanceObject], held: Collection[int]) -> _Drop:
        """Move objects apart and let all fall but those that are held."""
        items = [item.model_copy(update={"category": "fixed"}) if item.id in held else item for item in items]
        world = build_settling_world(items, self.library)
        found, still = deepest_overlap_depth(world), False
        first: list[Pose] = []
        apart: list[Pose] = []
        for attempt in range(CONFIG.tries):
            separate_objects(world, self.guessed, self._choose_separation(attempt, deepest_overlap_depth(world)))
            push_overlaps_apart(world)
            apart = _read_body_poses(world, items)
            first = first or apart
            still = simulate_until_rest(world)
            mujoco.mj_forward(world.model, world.data)
            if deepest_overlap_depth(world) < CONFIG.overlap:
                break
        poses = _read_body_poses(world, items)
        moves = zip(items, first, poses, strict=True)
        fell = [item.id for item, before, after in moves if _position_distance(before, after) > CONFIG.fallen]
        moves = zip(items, first, apart, strict=True)
        moved = [one.model_copy(update={"pose": old if one.id in fell else new}) for one, old, new in moves]
        return _Drop(moved, poses, fell, found, deepest_overlap_depth(world), still)

    def _choose_separation(self, attempt: int, overlap: float) -> Separation:
        """How objects that overlap by ``overlap`` (m) are moved apart: what is wedged after a fall, by little first."""
        if attempt == 0 or overlap >= CONFIG.wedged:
            return self.way
        last = attempt == CONFIG.tries - 1
        steps = tuple(step for step in self.way.steps if step < CONFIG.fallen or last)
        return replace(self.way, deep=CONFIG.overlap, steps=steps)


def _position_distance(one: Pose, other: Pose) -> float:
    """Between two positions, m."""
    return float(np.linalg.norm(np.subtract(one[0], other[0])))


def _lowest_corner_height(item: InstanceObject, library: Library) -> float:
    """The height of the lowest corner of its box, m."""
    corners = np.array(np.meshgrid(*np.array(library.load_object_model(item.asset).bounds).T)).reshape(3, -1)
    return float((matrix_from_quaternion(item.pose[1]) @ corners)[2].min() + item.pose[0][2])


def _bounding_box_center(asset: str, library: Library) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """The centre of the bounding box in the asset's frame, (3,) m."""
    return np.array(library.load_object_model(asset).bounds, np.float64).mean(axis=0)


def _translate_in_own_frame(pose: Pose, offset: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> Pose:
    """A pose moved along its own axes."""
    return to_vec3(matrix_from_quaternion(pose[1]) @ offset + pose[0]), pose[1]


def _read_body_poses(world: World, items: Sequence[InstanceObject]) -> list[Pose]:
    """Where the objects are by now."""
    bodies = [world.bodies[item.id] for item in items]
    return [
        (to_vec3(world.data.xpos[body]), (float(i), float(j), float(k), float(w)))
        for body, (w, i, j, k) in ((body, world.data.xquat[body]) for body in bodies)
    ]
