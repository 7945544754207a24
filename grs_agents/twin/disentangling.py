"""Assets that were registered into each other: one of them is somewhere else, and is registered again beside the other.

Each thing is registered by itself first, and what another thing hides says nothing against a pose: one that is half
hidden may come to stand in what hides it.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.scene import Mask, Registered, RGBDFrame, TableFrame, UprightBox, register
from grs_agents.scene.candidates import quaternion
from grs_agents.sim.engine import mujoco
from grs_agents.sim.world import World, build, place
from grs_agents.twin.parting import depth_of
from grs_agents.twin.settle import instances, on_table, prepare
from grs_agents.twin.thing import Thing

Floats = npt.NDArray[np.float64]
DEEP = 0.006
"""Things that are in each other by more than this (m) are not where they were registered."""
WORSE = 0.004
"""A pose that costs more than the first one by more than this (m) does not show what was seen."""
MOST = 8
"""At most so many pairs are looked at."""


@dataclass(frozen=True)
class Known:
    """A thing whose asset is known.

    Attributes:
        asset: a library name.
        upright: the box measured of it.
        mask: (H, W) its pixels.
        stood: where it was registered.
    """

    asset: str
    upright: UprightBox
    mask: Mask
    stood: Registered


def disentangled(
    things: Sequence[Known], frame: RGBDFrame, table: TableFrame, library: Library
) -> tuple[Registered, ...]:
    """Where the things stand once none is in another, as far as what was seen allows.

    Of two that are in each other, that one is moved of which this contradicts less of what was seen.

    Args:
        things: as they were registered one by one.
        frame, table: the photo and its pose.
        library: where their assets are looked up.

    Raises:
        UnknownNameError: an asset is not in the library.
        SimulationError: MuJoCo takes the scene for impossible.
    """
    stood = [one.stood for one in things]
    solids = [Thing(one.asset, (one.stood.position, one.stood.orientation)) for one in things]
    here = [number for number, one in enumerate(solids) if on_table(one)]
    items = instances([solids[number] for number in here], library)
    world = build(items, library)
    place(world, items)
    prepare(world)
    looked: set[tuple[int, int]] = set()
    for _ in range(MOST):
        mujoco.mj_forward(world.model, world.data)
        pair, depth = _worst(world, looked)
        if depth < DEEP:
            break
        looked.add(pair)
        tried: list[tuple[float, int, Registered]] = []
        for item in pair:
            one = things[here[item]]
            entered = _entering(world, item, one.asset, library)
            again = register(one.asset, library, one.upright, frame, table, one.mask, entered)
            left, dearer = _put(world, item, one.asset, _pose(again), library), again.cost - stood[here[item]].cost
            _put(world, item, one.asset, _pose(stood[here[item]]), library)
            if left < depth / 2 and dearer < WORSE:
                tried.append((left + dearer, item, again))
        if tried:
            _, item, again = min(tried, key=lambda one: one[0])
            stood[here[item]] = again
            _put(world, item, things[here[item]].asset, _pose(again), library)
    return tuple(stood)


def _worst(world: World, looked: Collection[tuple[int, int]]) -> tuple[tuple[int, int], float]:
    """The two things, lower number first, that are deepest in each other, and how deep, m."""
    worst, found = 0.0, (0, 0)
    for geoms, distance in zip(world.data.contact.geom, world.data.contact.dist, strict=True):
        one, other = sorted(world.owners[int(geom)] for geom in geoms)
        if -distance > worst and (one, other) not in looked and one in world.addresses and other in world.addresses:
            worst, found = float(-distance), (one, other)
    return found, worst


def _entering(world: World, number: int, asset: str, library: Library) -> Callable[[Floats], Floats]:
    """How deep a thing is in the others at each of (K, 4, 4) poses, (K,) m."""

    def entered(poses: Floats) -> Floats:
        places: list[Pose] = []
        for pose in poses:
            x, y, z = (float(value) for value in pose[:3, 3])
            places.append(((x, y, z), quaternion(pose[:3, :3])))
        return np.array([_put(world, number, asset, place, library) for place in places])

    return entered


def _pose(stood: Registered) -> Pose:
    return stood.position, stood.orientation


def _put(world: World, number: int, asset: str, pose: Pose, library: Library) -> float:
    """Move a thing; how deep it is in others there, m."""
    (position, (x, y, z, w)), start = instances([Thing(asset, pose)], library)[0].pose, world.addresses[number]
    world.data.qpos[start : start + 7] = (*position, w, x, y, z)
    return depth_of(world, number)
