"""Assets that were registered into each other: one of them is somewhere else, and is registered again beside the other.

Each thing is registered by itself first, and what another thing hides says nothing against a pose: one that is half
hidden may come to stand in what hides it.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.engine import mujoco
from grs_agents.library import Library
from grs_agents.perception.registration.registration import Registered, cost_of, register
from grs_agents.perception.segmentation.candidates import quaternion
from grs_agents.perception.settling.depenetration import depth_of, overlaps
from grs_agents.perception.settling.settling import PlacedObject, instances, on_table, prepare
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, UprightBox
from grs_agents.sim.world.compilation import World, build, place

Floats = npt.NDArray[np.float64]
DEEP = 0.006
"""Things that are in each other by more than this (m) are not where they were registered."""
DEEPEST = 0.015
"""If they can be nowhere else, by more than this, one is not what it was taken for."""
WORSE = 0.004
"""A pose that costs more than the first one by more than this (m) does not show what was seen."""
MOST = 8
"""At most so many pairs are looked at."""


@dataclass(frozen=True)
class KnownObject:
    """A thing whose asset is known.

    Attributes:
        thing: its asset where it was registered.
        upright: the box measured of it.
        mask: (H, W) its pixels.
    """

    thing: PlacedObject
    upright: UprightBox
    mask: Mask


@dataclass(frozen=True)
class Disentangled:
    """What becomes of known things, by index.

    Attributes:
        moved: where those stand that were registered into others.
        wrong: those that are not where they were registered, or are not these assets, wherever they stand.
    """

    moved: Mapping[int, Registered] = field(default_factory=dict[int, Registered])
    wrong: frozenset[int] = frozenset()


def repair_collisions(
    things: Sequence[KnownObject], frame: RGBDFrame, table: TableFrame, library: Library
) -> Disentangled:
    """Which are not to stay in others.

    Of two that are in each other, that one is registered again of which this contradicts less of what was seen. Where
    it contradicts too much of either, both stay; but if they are deep in each other, the one that fits worse is wrong.

    Args:
        things: as they were registered one by one.
        frame, table: the photo and its pose.
        library: where their assets are looked up.

    Raises:
        UnknownNameError: an asset is not in the library.
        SimulationError: MuJoCo takes the scene for impossible.
    """
    here = [index for index, one in enumerate(things) if on_table(one.thing)]
    crowd = _Crowd.of([things[index] for index in here], (frame, table), library)
    looked: set[tuple[int, int]] = set()
    moved: dict[int, Registered] = {}
    wrong: set[int] = set()
    while len(looked) < MOST:
        pair, depth = crowd.worst(looked)
        if depth < DEEP:
            break
        looked.add(pair)
        if wrong & {here[number] for number in pair}:
            continue
        tried = [(number, *crowd.again(number)) for number in pair]
        better = [one for one in tried if one[2] < depth / 2 and one[3] < WORSE]
        if better:
            number, found, _, _ = min(better, key=lambda one: one[2] + one[3])
            crowd.stand(number, found)
            moved[here[number]] = found
        elif depth > DEEPEST:
            wrong.add(here[max(pair, key=crowd.cost)])
    return Disentangled({index: found for index, found in moved.items() if index not in wrong}, frozenset(wrong))


@dataclass(frozen=True)
class _Crowd:
    """The things in a world; ``poses`` says where each stands by now."""

    things: Sequence[KnownObject]
    poses: list[Pose]
    photo: tuple[RGBDFrame, TableFrame]
    library: Library
    world: World

    @classmethod
    def of(cls, things: Sequence[KnownObject], photo: tuple[RGBDFrame, TableFrame], library: Library) -> "_Crowd":
        items = instances([one.thing for one in things], library)
        world = build(items, library)
        place(world, items)
        prepare(world)
        return cls(things, [one.thing.pose for one in things], photo, library, world)

    def worst(self, looked: Collection[tuple[int, int]]) -> tuple[tuple[int, int], float]:
        """The two that are deepest in each other, lower number first, and how deep, m."""
        mujoco.mj_forward(self.world.model, self.world.data)
        found = {
            pair: depth
            for pair, depth in overlaps(self.world).items()
            if pair not in looked and all(number in self.world.addresses for number in pair)
        }
        return max(found.items(), key=lambda one: one[1], default=((0, 0), 0.0))

    def again(self, number: int) -> tuple[Registered, float, float]:
        """Where a thing is registered beside the others, how deep it is in them then, and how much dearer that is."""
        one, (frame, table) = self.things[number], self.photo
        asset, pose = one.thing.asset, self.poses[number]

        def entered(poses: Floats) -> Floats:
            return np.array([self._depth(number, ((x, y, z), quaternion(turn))) for (x, y, z), turn in _parts(poses)])

        found = register(asset, self.library, one.upright, frame, table, one.mask, entered)
        left = self._depth(number, (found.position, found.orientation))
        self._depth(number, pose)
        return found, left, found.cost - self.cost(number)

    def cost(self, number: int) -> float:
        """How badly a thing where it stands fits what was seen, m."""
        one, (frame, table) = self.things[number], self.photo
        return cost_of(one.thing.asset, self.poses[number], self.library, one.upright, frame, table, one.mask)

    def stand(self, number: int, found: Registered) -> None:
        """Put a thing where it was found."""
        self.poses[number] = (found.position, found.orientation)
        self._depth(number, self.poses[number])

    def _depth(self, number: int, pose: Pose) -> float:
        """How deep a thing is in others at a pose, where it stays, m."""
        thing, start = PlacedObject(self.things[number].thing.asset, pose), self.world.addresses[number]
        position, (x, y, z, w) = instances([thing], self.library)[0].pose
        self.world.data.qpos[start : start + 7] = (*position, w, x, y, z)
        return depth_of(self.world, number)


def _parts(poses: Floats) -> Iterator[tuple[Vec3, Floats]]:
    """Positions, m, and rotations (3, 3) of (K, 4, 4) poses."""
    for pose in poses:
        x, y, z = (float(value) for value in pose[:3, 3])
        yield (x, y, z), pose[:3, :3]
