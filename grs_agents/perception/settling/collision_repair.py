"""Assets that were registered into each other: one of them is somewhere else, and is registered again beside the other.
Each object is registered by itself first, and what another object hides says nothing against a pose: one that is half
hidden may come to stand in what hides it."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry.transforms import matrix_to_quaternion
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.registration.registration import Registered, register_asset, registration_cost
from grs_agents.perception.settling.depenetration import overlap_depth_by_pair, overlap_depth_of_object
from grs_agents.perception.settling.settling import (
    PlacedObject,
    build_settling_world,
    is_over_table,
    to_instance_objects,
)
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, UprightBox
from grs_agents.sim.world.compilation import World

CONFIG = DEFAULT.settling.repair

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class KnownObject:
    """An object whose asset is known."""

    placed: PlacedObject  # its asset where it was registered
    upright: UprightBox  # the box measured of it
    mask: Mask  # (H, W) its pixels


@dataclass(frozen=True)
class CollisionRepairs:
    """What becomes of known objects, by index."""

    # where those stand that were registered into others
    moved: Mapping[int, Registered] = field(default_factory=dict[int, Registered])
    # those that are not where they were registered, or are not these assets, wherever they stand
    wrong: frozenset[int] = frozenset()


def repair_collisions(
    objects: Sequence[KnownObject], frame: RGBDFrame, table: TableFrame, library: Library
) -> CollisionRepairs:
    """Which known objects are not to stay in others, as they were registered one by one.

    Of two that are in each other, that one is registered again of which this contradicts less of what was seen. Where
    it contradicts too much of either, both stay; but if they are deep in each other, the one that fits worse is wrong.
    """
    on = [index for index, known in enumerate(objects) if is_over_table(known.placed)]
    scene = _CollisionScene.from_objects([objects[index] for index in on], (frame, table), library)
    compared: set[tuple[int, int]] = set()
    moved: dict[int, Registered] = {}
    wrong: set[int] = set()
    while len(compared) < CONFIG.most:
        pair, depth = scene.deepest_overlapping_pair(compared)
        if depth < CONFIG.deep:
            break
        compared.add(pair)
        if wrong & set(pair):
            continue
        repair = _find_pose_halving_overlap(scene, pair, depth)
        if repair is not None:
            scene.move_object(*repair)
            moved[repair[0]] = repair[1]
        elif depth > CONFIG.deepest:
            wrong.add(max(pair, key=scene.registration_cost_of_object))
    kept = {on[number]: pose for number, pose in moved.items() if number not in wrong}
    return CollisionRepairs(kept, frozenset(on[number] for number in wrong))


def _find_pose_halving_overlap(
    scene: "_CollisionScene", pair: tuple[int, int], depth: float
) -> tuple[int, Registered] | None:
    """Which of two objects goes where, so that they are half as deep in each other and it still shows what was seen."""
    tried = [(number, *scene.register_object_again(number)) for number in pair]
    better = [(left + cost, one, pose) for one, pose, left, cost in tried if left < depth / 2 and cost < CONFIG.worse]
    return min(better, key=lambda repair: repair[0])[1:] if better else None


@dataclass(frozen=True)
class _CollisionScene:
    """Known objects in a world; ``poses`` says where each stands by now."""

    objects: Sequence[KnownObject]
    poses: list[Pose]
    photo: tuple[RGBDFrame, TableFrame]
    library: Library
    world: World

    @classmethod
    def from_objects(
        cls, objects: Sequence[KnownObject], photo: tuple[RGBDFrame, TableFrame], library: Library
    ) -> "_CollisionScene":
        world = build_settling_world(to_instance_objects([known.placed for known in objects], library), library)
        return cls(objects, [known.placed.pose for known in objects], photo, library, world)

    def deepest_overlapping_pair(self, compared: Collection[tuple[int, int]]) -> tuple[tuple[int, int], float]:
        """The two that are deepest in each other, lower number first, and how deep, m."""
        mujoco.mj_forward(self.world.model, self.world.data)
        pairs, known = overlap_depth_by_pair(self.world).items(), self.world.addresses
        found = {pair: depth for pair, depth in pairs if pair not in compared and all(one in known for one in pair)}
        return max(found.items(), key=lambda one: one[1], default=((0, 0), 0.0))

    def register_object_again(self, number: int) -> tuple[Registered, float, float]:
        """Where an object is registered beside the others, how deep it is in them then, and how much dearer that is."""
        one, (frame, table) = self.objects[number], self.photo
        asset, pose = one.placed.asset, self.poses[number]

        def measure_overlap_per_pose(poses: Floats) -> Floats:
            placed = ((place, matrix_to_quaternion(turn)) for place, turn in _positions_and_rotations(poses))
            return np.array([self._place_and_measure_overlap(number, pose) for pose in placed])

        found = register_asset(asset, self.library, one.upright, frame, table, one.mask, measure_overlap_per_pose)
        left = self._place_and_measure_overlap(number, (found.position, found.orientation))
        self._place_and_measure_overlap(number, pose)
        return found, left, found.cost - self.registration_cost_of_object(number)

    def registration_cost_of_object(self, number: int) -> float:
        """How badly an object where it stands fits what was seen, m."""
        one, (frame, table) = self.objects[number], self.photo
        return registration_cost(
            one.placed.asset, self.poses[number], self.library, one.upright, frame, table, one.mask
        )

    def move_object(self, number: int, found: Registered) -> None:
        """Put an object where it was registered."""
        self.poses[number] = (found.position, found.orientation)
        self._place_and_measure_overlap(number, self.poses[number])

    def _place_and_measure_overlap(self, number: int, pose: Pose) -> float:
        """How deep an object is in others at a pose, where it stays, m."""
        placed, start = PlacedObject(self.objects[number].placed.asset, pose), self.world.addresses[number]
        position, (x, y, z, w) = to_instance_objects([placed], self.library)[0].pose
        self.world.data.qpos[start : start + 7] = (*position, w, x, y, z)
        return overlap_depth_of_object(self.world, number)


def _positions_and_rotations(poses: Floats) -> Iterator[tuple[Vec3, Floats]]:
    """Positions, m, and rotations (3, 3) of (K, 4, 4) poses."""
    for pose in poses:
        x, y, z = (float(value) for value in pose[:3, 3])
        yield (x, y, z), pose[:3, :3]
