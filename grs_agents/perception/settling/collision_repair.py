"""Repair assets that were registered into each other.

Each object is registered by itself first, and occlusion by another object does not count against a pose: an object
that is half hidden may be registered into the one that hides it. It is registered again, beside the other.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import matrix_to_quaternion, to_vec3
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
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame, UprightBox

CONFIG = DEFAULT.settling.repair


@dataclass(frozen=True)
class CollisionRepairs:
    """The outcome for each object that was registered into another, by index."""

    moved: Mapping[int, Registered] = field(default_factory=dict[int, Registered])  # with the new pose
    wrong: frozenset[int] = frozenset()  # its pose, or its asset, is wrong: no other pose agrees with the photo


def repair_collisions(
    objects: Sequence[PlacedObject],
    boxes: Sequence[UprightBox],
    masks: Sequence[Mask],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
) -> CollisionRepairs:
    """Register again the objects that overlap others, the deepest overlap first.

    Of two overlapping objects the one moves whose new pose costs least. If a new pose costs too much for either, both
    stay; above the bound for deep overlaps, the one with the higher registration cost is wrong.

    Args:
        objects: assets where they were registered, each by itself.
        boxes: the box measured of each.
        masks: the pixels (H, W) of each.
        frame: the photo.
        table: the table in it.
        library: the library that holds the assets.
    """
    on_table = [index for index, placed in enumerate(objects) if is_over_table(placed)]
    assets = [objects[index] for index in on_table]
    scene = _CollisionScene(
        assets, [boxes[index] for index in on_table], [masks[index] for index in on_table], (frame, table), library
    )
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
        tried = [(number, *scene.register_object_again(number)) for number in pair]
        better = [
            (overlap + cost, number, registered)
            for number, registered, overlap, cost in tried
            if overlap < depth / 2 and cost < CONFIG.worse
        ]
        if better:
            _, number, registered = min(better, key=lambda repair: repair[0])
            scene.place((registered.position, registered.orientation), number)
            moved[number] = registered
        elif depth > CONFIG.deepest:
            wrong.add(max(pair, key=scene.registration_cost_of_object))
    kept = {on_table[number]: pose for number, pose in moved.items() if number not in wrong}
    return CollisionRepairs(kept, frozenset(on_table[number] for number in wrong))


class _CollisionScene:
    """Known objects in a world; ``poses`` are their current poses."""

    def __init__(
        self,
        objects: Sequence[PlacedObject],
        boxes: Sequence[UprightBox],
        masks: Sequence[Mask],
        photo: tuple[RGBDFrame, TableFrame],
        library: Library,
    ) -> None:
        self.boxes, self.masks, self.photo, self.library = boxes, masks, photo, library
        self.assets = [placed.asset for placed in objects]
        self.poses = [placed.pose for placed in objects]
        self.world = build_settling_world(to_instance_objects(objects, library), library)

    def deepest_overlapping_pair(self, compared: Collection[tuple[int, int]]) -> tuple[tuple[int, int], float]:
        """The pair with the deepest overlap, lower number first, and that depth, m."""
        mujoco.mj_forward(self.world.model, self.world.data)
        depths = {
            pair: depth
            for pair, depth in overlap_depth_by_pair(self.world).items()
            if pair not in compared and all(number in self.world.addresses for number in pair)
        }
        return max(depths.items(), key=lambda item: item[1], default=((0, 0), 0.0))

    def register_object_again(self, number: int) -> tuple[Registered, float, float]:
        """Register an object beside the others: its pose, its overlap there (m), and the increase of its cost (m)."""
        current = self.poses[number]

        def overlap_per_pose(poses: Array) -> Array:
            return np.array(
                [self._overlap_at((to_vec3(pose[:3, 3]), matrix_to_quaternion(pose[:3, :3])), number) for pose in poses]
            )

        registered = register_asset(
            self.assets[number], self.library, self.boxes[number], *self.photo, self.masks[number], overlap_per_pose
        )
        overlap = self._overlap_at((registered.position, registered.orientation), number)
        self._overlap_at(current, number)
        return registered, overlap, registered.cost - self.registration_cost_of_object(number)

    def registration_cost_of_object(self, number: int) -> float:
        """The registration cost of an object at its current pose, m."""
        return registration_cost(
            self.assets[number], self.poses[number], self.library, self.boxes[number], *self.photo, self.masks[number]
        )

    def place(self, pose: Pose, number: int) -> None:
        """Move an object."""
        self.poses[number] = pose
        self._overlap_at(pose, number)

    def _overlap_at(self, pose: Pose, number: int) -> float:
        """Put an object at a pose; returns its deepest overlap there, m."""
        start = self.world.addresses[number]
        (item,) = to_instance_objects([PlacedObject(self.assets[number], pose)], self.library)
        position, (x, y, z, w) = item.pose
        self.world.data.qpos[start : start + 7] = (*position, w, x, y, z)
        return overlap_depth_of_object(self.world, number)
