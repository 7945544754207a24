"""Let a described scene come to rest: overlaps are resolved without gravity, then gravity acts."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grs_agents.base import Pose
from grs_agents.engine import mujoco
from grs_agents.library import Library
from grs_agents.library.shapes import rotation_matrix
from grs_agents.perception.settling.depenetration import STEPS, Separation, deepest_overlap, separate
from grs_agents.sim.instance.instance import InstanceObject
from grs_agents.sim.world.compilation import World, build, place

EASED = 0.0005
"""Things are eased apart until they overlap by less than this, m."""
EASING = 200
"""In at most so many steps."""
LONGEST = 2.0
"""Simulated seconds in which everything should come to rest."""
STILL = 0.01
"""What is slower than this (m/s) rests."""
CHUNK = 25
ROLLING = 0.004
"""Arm of the rolling resistance (m): nothing in a photo rolls."""


def prepare(world: World) -> None:
    """Take the robot out of the way, and let nothing roll."""
    model, owners = world.model, np.asarray(world.owners)
    # What is eased apart never moves by itself, falls asleep at once, and would sleep through gravity.
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    robot = owners < 0
    robot[model.geom("table").id] = False
    model.geom_contype[robot], model.geom_conaffinity[robot] = 0, 0
    model.geom_condim[owners >= 0] = 6
    model.geom_friction[owners >= 0, 2] = ROLLING


def ease(world: World) -> None:
    """Push overlaps apart, without gravity and without speed, so that nothing is thrown.

    And without friction: what sticks to what it is pushed out of goes farther.
    """
    model, data = world.model, world.data
    gravity, dimensions = np.array(model.opt.gravity), np.array(model.geom_condim)
    model.opt.gravity[:], model.geom_condim[:] = 0, 1
    for _ in range(EASING):
        data.qvel[:] = 0
        mujoco.mj_step(model, data)
        if deepest_overlap(world) < EASED:
            break
    model.opt.gravity[:], model.geom_condim[:] = gravity, dimensions
    data.qvel[:] = 0


def fall(world: World) -> bool:
    """Let gravity act until everything rests; whether it does in time."""
    model, data = world.model, world.data
    first, still = world.arm.dof, 0
    for _ in range(int(LONGEST / model.opt.timestep / CHUNK)):
        mujoco.mj_step(model, data, CHUNK)
        speed = np.abs(data.qvel[first:].reshape(-1, 6)) * (1, 1, 1, 0.1, 0.1, 0.1)
        still = still + 1 if speed.max(initial=0.0) < STILL else 0
        if still == 3:
            return True
    return False


@dataclass(frozen=True)
class PlacedObject:
    """An asset, and where the centre of its bounding box is (m) with its rotation (xyzw).

    ``guessed``: it stands for a thing of unknown shape, whose place is known less well.
    """

    asset: str
    pose: Pose
    guessed: bool = False


CENTER, REACH = (0.4, 0.0), 1.1
"""Only what lies within this distance (m) of the middle of the simulated table stands on it."""
OVERLAP = 0.001
TRIES = 3
"""What overlaps by more than this (m) at rest is taken apart again, so many times in all."""
WEDGED = 0.003
"""What overlaps by less than this (m) after that is moved by little first."""
FALLEN = 0.01
"""What moves farther than this (m) was not at rest as it is described, or not there."""
WAYS = (
    *(Separation(deep, lift) for deep in (0.003, 0.012, 0.0015, 0.02) for lift in (True, False)),
    Separation(0.003, lift=True, steps=(*STEPS, 0.05, 0.07, 0.1)),
)
"""Which of them moves things least hangs on the scene: they are tried in turn, until nothing moves too far."""
MOST_HELD = 8
"""At most so many things are taken to stand on something unseen."""


@dataclass(frozen=True)
class Placed:
    """Where a thing came to rest.

    Attributes:
        pose: as in `Thing`.
        drift: how far its centre moved, m.
        held: it would have fallen, and may stand on something that the photo does not show: it stays where it is.
        fell: gravity alone moved it farther than `FALLEN`.
    """

    pose: Pose
    drift: float
    held: bool = False
    fell: bool = False


@dataclass(frozen=True)
class RestState:
    """A scene at rest.

    Attributes:
        placed: for each thing; ``None`` for what is off the simulated table.
        found, penetration: the deepest overlap before and after, m.
        still: everything came to rest.
    """

    placed: tuple[Placed | None, ...]
    found: float
    penetration: float
    still: bool

    @property
    def farthest(self) -> float:
        """How far anything moved at most, m."""
        return max((placed.drift for placed in self.placed if placed is not None), default=0.0)


def on_table(thing: PlacedObject) -> bool:
    """Whether the thing is over the simulated table."""
    x, y, z = thing.pose[0]
    return float(np.hypot(x - CENTER[0], y - CENTER[1])) < REACH and abs(z) < REACH


def instances(things: Sequence[PlacedObject], library: Library) -> list[InstanceObject]:
    """The things as objects of a simulation; ids count from 0."""
    return [
        InstanceObject(id=number, asset=one.asset, pose=_shifted(one.pose, -_middle(one.asset, library)))
        for number, one in enumerate(things)
    ]


def settle(
    things: Sequence[PlacedObject], library: Library, unseen: Callable[[PlacedObject], bool] | None = None
) -> RestState:
    """Let things come to rest, without the robot.

    Args:
        things: as described.
        library: where their assets are looked up.
        unseen: whether a thing may stand on something that is not described; of those that may and fall, the lowest
            are held in the air, one after the other, until no other falls.

    Raises:
        UnknownNameError: an asset is not in the library.
        SimulationError: MuJoCo takes the scene for impossible.
    """
    found: list[RestState] = []
    for way in WAYS:
        rest = _settled(things, library, unseen, way)
        if rest.penetration < OVERLAP and rest.farthest < FALLEN:
            return rest
        found.append(rest)
    return min(found, key=_dearness)


def _dearness(rest: RestState) -> tuple[bool, int, float]:
    """What is wrong with a scene at rest, the worst first: overlaps, things that moved too far, how far all did."""
    drifts = [placed.drift for placed in rest.placed if placed is not None]
    return rest.penetration >= OVERLAP, sum(drift > FALLEN for drift in drifts), sum(drifts)


def _settled(
    things: Sequence[PlacedObject], library: Library, unseen: Callable[[PlacedObject], bool] | None, way: Separation
) -> RestState:
    """The scene at rest, if it is taken apart in one way."""
    here = [number for number, one in enumerate(things) if on_table(one)]
    items, held, tried = instances([things[number] for number in here], library), set[int](), set[int]()
    guessed = {item.id for item, number in zip(items, here, strict=True) if things[number].guessed}
    fallen = begun = _fallen(items, (), guessed, library, way)
    while unseen is not None and len(held) < MOST_HELD:
        fell = [number for number in fallen.fell if number not in tried]
        if not fell:
            break
        lowest = min(fell, key=lambda number: _bottom(begun.parted[number], library))
        tried.add(lowest)
        pose = _shifted(begun.parted[lowest].pose, _middle(items[lowest].asset, library))
        if unseen(PlacedObject(items[lowest].asset, pose)):
            held.add(lowest)
            fallen = _fallen(begun.parted, held, guessed, library, way)
    placed: list[Placed | None] = [None] * len(things)
    for item, rest, number in zip(items, fallen.poses, here, strict=True):
        pose = _shifted(rest, _middle(item.asset, library))
        drift = float(np.linalg.norm(np.subtract(pose[0], things[number].pose[0])))
        placed[number] = Placed(pose, drift, item.id in held, item.id in fallen.fell)
    return RestState(tuple(placed), begun.found, fallen.penetration, fallen.still)


@dataclass(frozen=True)
class _Fall:
    """Things taken apart before they fell, the poses in which they rest, and which of them fell, by number."""

    parted: list[InstanceObject]
    poses: list[Pose]
    fell: list[int]
    found: float
    penetration: float
    still: bool


def _fallen(
    items: Sequence[InstanceObject], held: Collection[int], guessed: Collection[int], library: Library, way: Separation
) -> _Fall:
    """Take things apart and let all fall but those that are held."""
    items = [item.model_copy(update={"category": "fixed"}) if item.id in held else item for item in items]
    world = build(items, library)
    place(world, items)
    prepare(world)
    mujoco.mj_forward(world.model, world.data)
    found, still = deepest_overlap(world), False
    first: list[Pose] = []
    parted: list[Pose] = []
    for attempt in range(TRIES):
        if attempt and deepest_overlap(world) < WEDGED:
            last = attempt == TRIES - 1
            steps = tuple(step for step in way.steps if step < FALLEN or last)
            separate(world, guessed, replace(way, deep=OVERLAP, steps=steps))
        else:
            separate(world, guessed, way)
        ease(world)
        parted = [_pose(world.data, world.bodies[item.id]) for item in items]
        first = first or parted
        still = fall(world)
        mujoco.mj_forward(world.model, world.data)
        if deepest_overlap(world) < OVERLAP:
            break
    poses = [_pose(world.data, world.bodies[item.id]) for item in items]
    moved = [float(np.linalg.norm(np.subtract(one[0], two[0]))) for one, two in zip(first, poses, strict=True)]
    fell = [item.id for item, far in zip(items, moved, strict=True) if far > FALLEN]
    begun = [
        item.model_copy(update={"pose": before if item.id in fell else after})
        for item, before, after in zip(items, first, parted, strict=True)
    ]
    return _Fall(begun, poses, fell, found, deepest_overlap(world), still)


def _bottom(item: InstanceObject, library: Library) -> float:
    """The height of the lowest corner of its box, m."""
    corners = np.array(np.meshgrid(*np.array(library.model(item.asset).bounds).T)).reshape(3, -1)
    return float((rotation_matrix(item.pose[1]) @ corners)[2].min() + item.pose[0][2])


def _middle(asset: str, library: Library) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """The centre of the bounding box in the asset's frame, (3,) m."""
    return np.array(library.model(asset).bounds, np.float64).mean(axis=0)


def _shifted(pose: Pose, offset: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> Pose:
    """A pose moved along its own axes."""
    x, y, z = (float(value) for value in rotation_matrix(pose[1]) @ offset + pose[0])
    return (x, y, z), pose[1]


def _pose(data: Any, body: int) -> Pose:
    x, y, z = (float(value) for value in data.xpos[body])
    w, i, j, k = (float(value) for value in data.xquat[body])
    return (x, y, z), (i, j, k, w)
