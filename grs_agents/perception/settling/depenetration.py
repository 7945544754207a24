"""Move objects apart that overlap deeply: the one that has to move least is moved by itself, all others stay."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base.mujoco_import import mujoco
from grs_agents.perception.configuration import DEFAULT
from grs_agents.sim.world.compilation import World

CONFIG = DEFAULT.settling.depenetration

Floats = npt.NDArray[np.float64]
TABLE = -1  # the number of the table, which cannot be moved
DIRECTIONS: Floats = np.array(
    [(0.0, 0.0, 1.0)]
    + [
        (np.cos(height) * np.cos(bearing), np.cos(height) * np.sin(bearing), np.sin(height))
        for height in np.deg2rad([0, 35, 65])
        for bearing in np.deg2rad(np.arange(0, 360, 45))
    ]
)


@dataclass(frozen=True)
class Separation:
    """A way to take objects apart."""

    deep: float  # overlaps up to this (m) are left to easing
    lift: bool  # what is in the table is lifted straight out of it first, whatever stands on that
    steps: tuple[float, ...] = DEFAULT.settling.depenetration.steps  # how far an object may be moved, m


def deepest_overlap_depth(world: World) -> float:
    """The deepest overlap, m."""
    return max(0.0, float(-np.asarray(world.data.contact.dist).min(initial=0.0)))


def separate_objects(world: World, guessed: Collection[int], way: Separation) -> None:
    """Move one object after the other until none overlaps deeply, or none can be moved free of others.
    Of two that overlap the one that has to move least is moved; what is ``guessed`` rather than what is known."""
    if way.lift:
        _lift_out_of_table(world, way.deep)
    stuck: set[tuple[int, int]] = set()
    for _ in range(CONFIG.most):
        mujoco.mj_forward(world.model, world.data)
        pair = _deepest_overlapping_pair(world, stuck, way.deep)
        if pair is None:
            return
        if not _move_pair_apart(world, pair, guessed, way):
            stuck.add(pair)
    mujoco.mj_forward(world.model, world.data)


def _move_pair_apart(world: World, pair: tuple[int, int], guessed: Collection[int], way: Separation) -> bool:
    """Move one of two objects, or each half the way; whether one of them can be moved free of others."""
    free = CONFIG.free * way.deep
    tried = ((one, _find_shortest_free_move(world, one, way.steps, free)) for one in pair if one in world.addresses)
    moves = {number: move for number, move in tried if move is not None}
    if not moves:
        return False
    number = min(moves, key=lambda moved: _displacement_cost(moves[moved], moved in guessed))
    other, move = pair[number == pair[0]], moves[number]
    far = np.linalg.norm(move) >= CONFIG.far and other in world.addresses and set(pair) <= set(guessed)
    if not (far and _move_pair_half_each(world, number, other, move, free)):
        start = world.addresses[number]
        world.data.qpos[start : start + 3] += move
    return True


def _lift_out_of_table(world: World, deep: float) -> None:
    """Lift what is deeper than ``deep`` m in the table straight out of it."""
    mujoco.mj_forward(world.model, world.data)
    for (lower, number), depth in overlap_depth_by_pair(world).items():
        if lower == TABLE and depth > deep:
            world.data.qpos[world.addresses[number] + 2] += depth


def _displacement_cost(move: Floats, guessed: bool) -> float:
    """What it costs to move an object, m."""
    far = float(np.linalg.norm(move))
    return far / CONFIG.guessed if guessed and far < CONFIG.far else far


def overlap_depth_by_pair(world: World) -> dict[tuple[int, int], float]:
    """How deep any two objects are in each other, m, by their numbers, the lower first."""
    found: dict[tuple[int, int], float] = {}
    for geoms, distance in zip(world.data.contact.geom, world.data.contact.dist, strict=True):
        one, other = sorted(world.owners[int(geom)] for geom in geoms)
        found[one, other] = max(found.get((one, other), 0.0), float(-distance))
    return found


def _deepest_overlapping_pair(world: World, stuck: set[tuple[int, int]], deep: float) -> tuple[int, int] | None:
    """The objects, lower number first, that overlap most, if by more than ``deep`` m."""
    left = {pair: depth for pair, depth in overlap_depth_by_pair(world).items() if depth > deep and pair not in stuck}
    found = {pair: depth for pair, depth in left.items() if any(number in world.addresses for number in pair)}
    return max(found, key=lambda pair: found[pair], default=None)


def _find_shortest_free_move(world: World, number: int, steps: Sequence[float], free: float) -> Floats | None:
    """The shortest of the tried moves, (3,) m, after which an object overlaps nothing by more than ``free`` m."""
    start = world.addresses[number]
    here = world.data.qpos[start : start + 3].copy()
    shortest: Floats | None = None
    for step in steps:
        depths: list[float] = []
        for direction in DIRECTIONS:
            world.data.qpos[start : start + 3] = here + step * direction
            depths.append(overlap_depth_of_object(world, number))
        best = int(np.argmin(depths))
        if depths[best] < free:
            shortest = step * DIRECTIONS[best]
            break
    world.data.qpos[start : start + 3] = here
    mujoco.mj_forward(world.model, world.data)
    return shortest


def _move_pair_half_each(world: World, number: int, other: int, move: Floats, free: float) -> bool:
    """Move two objects half the way each, apart, if they overlap nothing by more than ``free`` m then."""
    starts = [world.addresses[moved] for moved in (number, other)]
    before = [world.data.qpos[start : start + 3].copy() for start in starts]
    for start, half in zip(starts, (move / 2, -move / 2), strict=True):
        world.data.qpos[start : start + 3] += half
    if max(overlap_depth_of_object(world, number), overlap_depth_of_object(world, other)) < free:
        return True
    for start, here in zip(starts, before, strict=True):
        world.data.qpos[start : start + 3] = here
    mujoco.mj_forward(world.model, world.data)
    return False


def overlap_depth_of_object(world: World, number: int) -> float:
    """How deep an object overlaps others where it has been put, m."""
    model, data = world.model, world.data
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    owners = np.asarray(world.owners)[data.contact.geom]
    mine = (owners == number).any(axis=1) & (owners[:, 0] != owners[:, 1])
    return max(0.0, float(-data.contact.dist[mine].min(initial=0.0)))
