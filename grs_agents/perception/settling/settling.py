"""Settle a described scene in MuJoCo and compare it with its photo.

Overlaps are resolved without gravity, then gravity acts. The comparison is the share of pixels with the photo's depth.
"""

import copy
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import pixels_in_mask
from grs_agents.perception.settling.depenetration import (
    Separation,
    TriedMoves,
    deepest_overlap_depth,
    physics_state,
    separate_objects,
)
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame, TwinReport
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays
from grs_agents.sim.world.compilation import World, build_world, reset_world_to_poses

CONFIG = DEFAULT.settling

CHUNK = 25  # simulation steps between two checks of the speeds


def prepare_world_for_settling(world: World) -> None:
    """Take the robot out of the way, and prevent rolling."""
    model, owners = world.model, np.asarray(world.owners)
    # Objects are eased apart without speed, so they would fall asleep at once and sleep through gravity.
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    robot = owners < 0
    robot[model.geom("table").id] = False
    model.geom_contype[robot], model.geom_conaffinity[robot] = 0, 0
    model.geom_condim[owners >= 0] = 6
    model.geom_friction[owners >= 0, 2] = CONFIG.rolling


def push_overlaps_apart(world: World) -> None:
    """Push overlaps apart without gravity, speed or friction.

    Without speed nothing is thrown; without friction nothing is dragged along.
    """
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
    """Simulate with gravity until everything rests; False if the time runs out first."""
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
    """An asset at a pose."""

    asset: str  # library name
    pose: Pose  # centre of its bounding box (m) and rotation (xyzw), robot frame
    guessed: bool = False  # a proxy of an object of unknown shape, whose place is less certain


@dataclass(frozen=True)
class RestPose:
    """The pose at which an object comes to rest."""

    pose: Pose  # as in `PlacedObject`
    drift: float  # distance of its centre from the described pose, m
    held: bool = False  # it would have fallen, and is fixed where it is


@dataclass(frozen=True)
class RestState:
    """A scene at rest."""

    placed: tuple[RestPose | None, ...]  # of each object; None for objects off the table
    found: float  # deepest penetration as described, m
    penetration: float  # deepest penetration at rest, m
    still: bool  # everything came to rest

    @property
    def largest_drift(self) -> float:
        """The largest drift of an object, m."""
        return max((placed.drift for placed in self.placed if placed is not None), default=0.0)


def is_over_table(placed: PlacedObject) -> bool:
    """Whether the object is over the simulated table."""
    x, y, z = placed.pose[0]
    away = float(np.hypot(x - CONFIG.table_center[0], y - CONFIG.table_center[1]))
    return away < CONFIG.table_reach and abs(z) < CONFIG.table_reach


def to_instance_objects(objects: Sequence[PlacedObject], library: Library) -> list[InstanceObject]:
    """Convert objects to those of a simulation, numbered from 0."""
    return [
        InstanceObject(
            id=number,
            asset=placed.asset,
            pose=_translate_in_own_frame(placed.pose, -_bounding_box_center(placed.asset, library)),
        )
        for number, placed in enumerate(objects)
    ]


def build_settling_world(items: Sequence[InstanceObject], library: Library) -> World:
    """A world of these objects without the robot, in which nothing rolls."""
    world = build_world(items, library)
    reset_world_to_poses(world, items)
    prepare_world_for_settling(world)
    mujoco.mj_forward(world.model, world.data)
    return world


def settle_objects(objects: Sequence[PlacedObject], library: Library, accept_drift: bool = False) -> RestState:
    """Simulate the objects to rest, without the robot, by the separation strategy that leaves the least fault.

    With ``accept_drift`` the first strategy that leaves no overlap is taken, even if objects drift: the others seldom
    reduce that. Objects that would fall are held in the air, the lowest first, until no other falls: the photo shows
    them at rest, so they have a support that the description lacks.

    Raises:
        SimulationError: MuJoCo rejects the scene.
    """
    bounds = CONFIG.depenetration
    ways = [Separation(deep, lift, bounds.steps) for deep in bounds.depths for lift in (True, False)]
    ways.append(Separation(bounds.depths[0], lift=True, steps=(*bounds.steps, *bounds.last_steps)))
    rests: list[RestState] = []
    settler = _Settler(objects, library)
    for way in ways:
        rest = settler.compute_rest_state(way)
        if rest.penetration < CONFIG.overlap and (accept_drift or rest.largest_drift < CONFIG.fallen):
            return rest
        rests.append(rest)

    def fault_rank(rest: RestState) -> tuple[bool, int, float]:
        """Remaining overlap first, then the number of objects that moved too far, then their total drift."""
        drifts = [placed.drift for placed in rest.placed if placed is not None]
        return rest.penetration >= CONFIG.overlap, sum(drift > CONFIG.fallen for drift in drifts), sum(drifts)

    return min(rests, key=fault_rank)


@dataclass(frozen=True)
class _Drop:
    """A simulation to rest: the poses before gravity acts and at rest."""

    apart: list[InstanceObject]
    poses: list[Pose]
    fell: list[int]
    found: float
    penetration: float
    still: bool


@dataclass(frozen=True)
class _Simulation:
    """A world at rest or at the end of the time, and the poses before gravity acted."""

    apart: list[Pose]
    data: Any  # ``mujoco.MjData``
    still: bool


@dataclass(frozen=True)
class _Memo:
    """A world before the objects are moved apart, and all that is computed from it.

    Most strategies move the same objects to the same places: each simulation runs once.
    """

    world: World
    moves: TriedMoves
    simulations: dict[bytes, _Simulation]  # by the state when the objects are apart


class _Settler:
    """Simulates the scene to rest by each separation strategy."""

    def __init__(self, objects: Sequence[PlacedObject], library: Library) -> None:
        self.objects, self.library = objects, library
        self.memos: dict[tuple[tuple[int, ...], tuple[Pose, ...]], _Memo] = {}  # by held objects and poses
        self.here = [number for number, placed in enumerate(objects) if is_over_table(placed)]
        self.items = to_instance_objects([objects[number] for number in self.here], library)
        self.guessed = {item.id for item, number in zip(self.items, self.here, strict=True) if objects[number].guessed}

    def compute_rest_state(self, strategy: Separation) -> RestState:
        """The scene at rest; falling objects are held, the lowest first, each in a new simulation."""

        def lowest_corner_height(number: int) -> float:
            item = first.apart[number]
            bounds = np.array(self.library.load_object_model(item.asset).bounds)
            corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1)
            return float((matrix_from_quaternion(item.pose[1]) @ corners)[2].min() + item.pose[0][2])

        first = last = self._separate_and_drop(self.items, set(), strategy)
        held: set[int] = set()
        while fell := [number for number in last.fell if number not in held]:
            held.add(min(fell, key=lowest_corner_height))
            last = self._separate_and_drop(first.apart, held, strategy)
        placed: list[RestPose | None] = [None] * len(self.objects)
        for item, resting, number in zip(self.items, last.poses, self.here, strict=True):
            pose = _translate_in_own_frame(resting, _bounding_box_center(item.asset, self.library))
            drift = _position_distance(pose, self.objects[number].pose)
            placed[number] = RestPose(pose, drift, item.id in held)
        return RestState(tuple(placed), first.found, last.penetration, last.still)

    def _separate_and_drop(self, items: Sequence[InstanceObject], held: Collection[int], strategy: Separation) -> _Drop:
        """Move objects apart, and simulate to rest; the ``held`` objects are fixed."""
        items = [item.model_copy(update={"category": "fixed"}) if item.id in held else item for item in items]
        key = tuple(sorted(held)), tuple(item.pose for item in items)
        if key not in self.memos:
            self.memos[key] = _Memo(build_settling_world(items, self.library), {}, {})
        memo = self.memos[key]
        world = replace(memo.world, data=copy.copy(memo.world.data))
        found, still = deepest_overlap_depth(world), False
        first: list[Pose] = []
        apart: list[Pose] = []
        for attempt in range(CONFIG.tries):
            way, overlap = strategy, deepest_overlap_depth(world)
            if attempt > 0 and overlap < CONFIG.wedged:  # wedged after a fall: first by small steps
                last = attempt == CONFIG.tries - 1
                steps = tuple(step for step in way.steps if step < CONFIG.fallen or last)
                way = replace(way, deep=CONFIG.overlap, steps=steps)
            separate_objects(world, self.guessed, way, memo.moves)
            start = physics_state(world)
            if start in memo.simulations:
                world = replace(world, data=copy.copy(memo.simulations[start].data))
            else:
                push_overlaps_apart(world)
                before = _read_body_poses(world, items)
                still = simulate_until_rest(world)
                mujoco.mj_forward(world.model, world.data)
                memo.simulations[start] = _Simulation(before, copy.copy(world.data), still)
            apart, still = memo.simulations[start].apart, memo.simulations[start].still
            first = first or apart
            if deepest_overlap_depth(world) < CONFIG.overlap:
                break
        poses = _read_body_poses(world, items)
        moves = zip(items, first, poses, strict=True)
        fell = [item.id for item, before, after in moves if _position_distance(before, after) > CONFIG.fallen]
        moves = zip(items, first, apart, strict=True)
        moved = [item.model_copy(update={"pose": old if item.id in fell else new}) for item, old, new in moves]
        return _Drop(moved, poses, fell, found, deepest_overlap_depth(world), still)


def _position_distance(first: Pose, second: Pose) -> float:
    return float(np.linalg.norm(np.subtract(first[0], second[0])))


def _bounding_box_center(asset: str, library: Library) -> Array:
    """Centre (3,) of the bounding box in the asset's frame, m."""
    return np.array(library.load_object_model(asset).bounds, np.float64).mean(axis=0)


def _translate_in_own_frame(pose: Pose, offset: Array) -> Pose:
    """A pose moved along its own axes."""
    return to_vec3(matrix_from_quaternion(pose[1]) @ offset + pose[0]), pose[1]


def _read_body_poses(world: World, items: Sequence[InstanceObject]) -> list[Pose]:
    """The current poses of the objects."""
    bodies = [world.bodies[item.id] for item in items]
    return [
        (to_vec3(world.data.xpos[body]), (float(i), float(j), float(k), float(w)))
        for body, (w, i, j, k) in ((body, world.data.xquat[body]) for body in bodies)
    ]


def measure_depth_fidelity(
    objects: Sequence[PlacedObject], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> float | None:
    """Share of the measured pixels of ``mask`` (H, W) at which the objects have the photo's depth.

    ``None`` without a measured pixel.
    """
    rows, columns = pixels_in_mask(mask & (frame.depth > 0))
    if not len(rows):
        return None
    step = -(-len(rows) // CONFIG.rays)
    rows, columns = rows[::step], columns[::step]
    camera, pose = frame.camera, np.asarray(table.T_robot_cam)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], axis=-1)
    directions = np.asarray((local @ pose[:3, :3].T)[None], np.float64)
    sight = VisibleScene(to_instance_objects([placed for placed in objects if is_over_table(placed)], library), library)
    picture = render_along_rays(sight, pose[:3, 3].copy(), directions)
    off = np.abs(picture.depth[0] - frame.depth[rows, columns])
    return float(((off <= CONFIG.near) & (picture.owner[0] >= 0)).mean())


def settle_and_measure_fidelity(
    objects: Sequence[PlacedObject],
    library: Library,
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
    settle: Callable[[Sequence[PlacedObject], Library], RestState] = settle_objects,
) -> tuple[RestState, TwinReport]:
    """The scene at rest and its figures; fidelity is measured at the pixels of ``mask`` (H, W)."""
    rest = settle(objects, library)
    resting = [
        placed if end is None else PlacedObject(placed.asset, end.pose)
        for placed, end in zip(objects, rest.placed, strict=True)
    ]
    return rest, TwinReport(
        found=rest.found,
        penetration=rest.penetration,
        drift=rest.largest_drift,
        fidelity=measure_depth_fidelity(resting, library, frame, table, mask),
        still=rest.still,
        held=sum(end.held for end in rest.placed if end is not None),
    )
