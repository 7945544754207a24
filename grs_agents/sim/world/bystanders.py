"""Bystanders: objects of the photo that a task does not use, kept on the table.

A task's object of the same asset replaces the bystander, so that nothing is on the table twice. The sandbox and the
host share these rules: a program sees the scene that is judged.
"""

import math
from collections.abc import Sequence
from itertools import count
from typing import Final

from grs_agents.base.geometry import transforms
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance

FIRST_BYSTANDER: Final = 50_000
"""First id of bystanders; ids of a task's objects count from 1."""
_SAME_PLACE, _SAME_TURN = 0.03, math.radians(15)
"""Distance (m) and angle (rad) from the photo's pose within which an object snaps to it: authors are told rounded
poses, and the audit compares with the photo's."""


def find_nearest_bystander_of_asset(item: InstanceObject, around: Sequence[InstanceObject]) -> InstanceObject | None:
    """The bystander that a task's object replaces: the nearest of the same asset."""
    alike = [bystander for bystander in around if bystander.asset == item.asset and not item.fill]
    return min(alike, key=lambda bystander: math.dist(bystander.pose[0], item.pose[0]), default=None)


def adopt_bystander_rest_pose(item: InstanceObject, claimed: InstanceObject) -> InstanceObject:
    """The task's object, snapped to the pose of its bystander if it was put close to it.

    A loose object does not snap to a bystander that is held in the air.
    """
    if claimed.category == "fixed" and item.category != "fixed":
        return item
    near = math.dist(item.pose[0], claimed.pose[0]) <= _SAME_PLACE
    if not near or transforms.angle_between(item.pose[1], claimed.pose[1]) > _SAME_TURN:
        return item
    return item.model_copy(update={"pose": claimed.pose})


def match_objects_to_bystanders(
    objects: Sequence[InstanceObject], around: Sequence[InstanceObject]
) -> tuple[list[InstanceObject], list[InstanceObject]]:
    """The task's objects, snapped to their bystanders, and the bystanders that none of them replaces.

    Objects choose in the order of their ids, each the nearest remaining bystander of its asset.
    """
    left, placed = list(around), dict[int, InstanceObject]()
    for item in sorted(objects, key=lambda item: item.id):
        claimed = find_nearest_bystander_of_asset(item, left)
        placed[item.id] = item if claimed is None else adopt_bystander_rest_pose(item, claimed)
        if claimed is not None:
            left.remove(claimed)
    used = {*placed, *(bystander.id for bystander in left)}
    unused = (number for number in count(FIRST_BYSTANDER) if number not in used)
    left = [
        bystander.model_copy(update={"id": next(unused)}) if bystander.id in placed else bystander for bystander in left
    ]
    return [placed[item.id] for item in objects], left


def place_bystanders(instance: TaskInstance, photo_objects: Sequence[InstanceObject]) -> TaskInstance:
    """The instance with the photo's objects as bystanders, in place of those it had.

    Raises ``ValidationError`` for too many objects, or if a goal refers to a bystander that was dropped.
    """
    placed, around = match_objects_to_bystanders(instance.task_objects, photo_objects)
    return TaskInstance.model_validate({**dict(instance), "objects": (*placed, *around)})
