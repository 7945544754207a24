"""Move deeply overlapping objects apart: the object with the shortest way moves, all others stay."""

from collections.abc import Collection, Generator
from contextlib import contextmanager
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
    """A strategy to move objects apart."""

    deep: float  # shallower overlaps (m) are left to easing
    lift: bool  # objects in the table are first lifted straight out of it, whatever stands on them
    steps: tuple[float, ...] = DEFAULT.settling.depenetration.steps  # distances to try, m


TriedMoves = dict[tuple[bytes, int, float], list[float]]
"""The depths (m) that the moves of an object in `DIRECTIONS` leave, by the state before, the object and the step."""


def physics_state(world: World) -> bytes:
    """The state on which a simulation depends to the last bit, within a world."""
    model, kind = world.model, mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, world.data, state, kind)
    return state.tobytes()


def deepest_overlap_depth(world: World) -> float:
    """The deepest overlap, m."""
    return max(0.0, float(-np.asarray(world.data.contact.dist).min(initial=0.0)))


def separate_objects(world: World, guessed: Collection[int], way: Separation, tried: TriedMoves) -> None:
    """Separate overlapping objects, deepest pair first, until no remaining deep overlap can be resolved by a move.

    Of a pair the object with the cheaper move moves; a move of a ``guessed`` object is cheaper. Moves in ``tried``, of
    other strategies in the same world, are not computed again; new ones are added.
    """
    if way.lift:
        mujoco.mj_forward(world.model, world.data)
        for (lower, number), depth in overlap_depth_by_pair(world).items():
            if lower == TABLE and depth > way.deep:
                world.data.qpos[world.addresses[number] + 2] += depth
    stuck: set[tuple[int, int]] = set()
    for _ in range(CONFIG.most):
        mujoco.mj_forward(world.model, world.data)
        deep = {
            pair: depth
            for pair, depth in overlap_depth_by_pair(world).items()
            if depth > way.deep and pair not in stuck and any(number in world.addresses for number in pair)
        }
        if not deep:
            return
        pair = max(deep, key=lambda pair: deep[pair])
        if not _move_pair_apart(world, pair, guessed, way, tried):
            stuck.add(pair)
    mujoco.mj_forward(world.model, world.data)


def _move_pair_apart(
    world: World, pair: tuple[int, int], guessed: Collection[int], way: Separation, tried: TriedMoves
) -> bool:
    """Move either of two objects, or each half the way; False if neither can be moved free of others."""
    free = CONFIG.free * way.deep
    shortest = ((number, _find_shortest_free_move(world, number, way, free, tried)) for number in pair)
    moves = {number: move for number, move in shortest if move is not None}
    if not moves:
        return False

    def cost(number: int) -> float:
        distance = float(np.linalg.norm(moves[number]))
        return distance / CONFIG.guessed if number in guessed and distance < CONFIG.far else distance

    number = min(moves, key=cost)
    partner, move = pair[number == pair[0]], moves[number]
    far = np.linalg.norm(move) >= CONFIG.far and partner in world.addresses and set(pair) <= set(guessed)
    if not (far and _move_both_by_half(world, number, partner, move, free)):
        start = world.addresses[number]
        world.data.qpos[start : start + 3] += move
    return True


def overlap_depth_by_pair(world: World) -> dict[tuple[int, int], float]:
    """Depth of the overlap of each touching pair of objects, m, by their numbers, the lower first."""
    depths: dict[tuple[int, int], float] = {}
    for geoms, distance in zip(world.data.contact.geom, world.data.contact.dist, strict=True):
        lower, higher = sorted(world.owners[int(geom)] for geom in geoms)
        depths[lower, higher] = max(depths.get((lower, higher), 0.0), float(-distance))
    return depths


def _find_shortest_free_move(
    world: World, number: int, way: Separation, free: float, tried: TriedMoves
) -> Floats | None:
    """The first tried move (3,), m, that leaves no overlap above ``free`` m; None without such a move."""
    if number not in world.addresses:
        return None
    start = world.addresses[number]
    here, before = world.data.qpos[start : start + 3].copy(), world.data.qpos.tobytes()
    shortest: Floats | None = None
    with _collisions_of_object(world, number):
        for step in way.steps:
            depths = tried.setdefault((before, number, step), [])
            for direction in () if depths else DIRECTIONS:
                world.data.qpos[start : start + 3] = here + step * direction
                depths.append(overlap_depth_of_object(world, number))
            best = int(np.argmin(depths))
            if depths[best] < free:
                shortest = step * DIRECTIONS[best]
                break
    world.data.qpos[start : start + 3] = here
    mujoco.mj_forward(world.model, world.data)
    return shortest


@contextmanager
def _collisions_of_object(world: World, number: int) -> Generator[None]:
    """Leave out the collisions of the other objects with each other: of a pile they are most."""
    affinity, others = world.model.geom_conaffinity, world.owner_of_geom != number
    before = affinity[others].copy()
    affinity[others] = 0  # their types stay: they collide with an object that has an affinity
    try:
        yield
    finally:
        affinity[others] = before


def _move_both_by_half(world: World, number: int, partner: int, move: Floats, free: float) -> bool:
    """Move two objects apart by half the way each; undone, and False, if an overlap above ``free`` m is left."""
    starts = [world.addresses[moved] for moved in (number, partner)]
    before = [world.data.qpos[start : start + 3].copy() for start in starts]
    for start, half in zip(starts, (move / 2, -move / 2), strict=True):
        world.data.qpos[start : start + 3] += half
    if max(overlap_depth_of_object(world, number), overlap_depth_of_object(world, partner)) < free:
        return True
    for start, here in zip(starts, before, strict=True):
        world.data.qpos[start : start + 3] = here
    mujoco.mj_forward(world.model, world.data)
    return False


def overlap_depth_of_object(world: World, number: int) -> float:
    """Depth of an object's deepest overlap at its position in ``qpos``, m."""
    model, data = world.model, world.data
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    owners = world.owner_of_geom[data.contact.geom]
    mine = (owners == number).any(axis=1) & (owners[:, 0] != owners[:, 1])
    return max(0.0, float(-data.contact.dist[mine].min(initial=0.0)))
