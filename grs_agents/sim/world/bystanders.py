"""Bystanders: what the photo shows and a task does not use stands on the table too.

A task's object of a photo's asset stands for one of them, so that nothing stands there twice. The sandbox and the host
share these rules: a program sees the scene that counts.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import count
from typing import Final

from grs_agents.base.geometry import transforms
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance

FIRST_BYSTANDER: Final = 50_000
"""Ids of bystanders begin here, so that those of a task's objects count from 1 as ever."""
_SAME_PLACE, _SAME_TURN = 0.03, math.radians(15)
"""Within so many metres and radians of its place in the photo an object is put exactly where it rests there: the audit
takes that for the photo's pose, and authors are told poses that are rounded."""


def find_nearest_bystander_of_asset(item: InstanceObject, around: Sequence[InstanceObject]) -> InstanceObject | None:
    """The bystander that a task's object stands for: the nearest of its asset."""
    alike = [one for one in around if one.asset == item.asset and not item.fill]
    return min(alike, key=lambda one: math.dist(one.pose[0], item.pose[0]), default=None)


def adopt_bystander_rest_pose(item: InstanceObject, claimed: InstanceObject) -> InstanceObject:
    """The task's object where its bystander rests, if it was put almost there.

    One that is loose is not put where a bystander is held in the air.
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
    """The task's objects and the bystanders that none of them stands for.

    Objects claim in the order of their ids, each the nearest that is left of its asset.
    """
    left, placed = list(around), dict[int, InstanceObject]()
    for item in sorted(objects, key=lambda one: one.id):
        claimed = find_nearest_bystander_of_asset(item, left)
        placed[item.id] = item if claimed is None else adopt_bystander_rest_pose(item, claimed)
        if claimed is not None:
            left.remove(claimed)
    return [placed[item.id] for item in objects], _renumber_taken_ids(left, placed)


def _renumber_taken_ids(around: Sequence[InstanceObject], taken: Collection[int]) -> list[InstanceObject]:
    """Bystanders with ids that no task's object has."""
    used = {*taken, *(one.id for one in around)}
    unused: Iterator[int] = (number for number in count(FIRST_BYSTANDER) if number not in used)
    return [one.model_copy(update={"id": next(unused)}) if one.id in taken else one for one in around]


def place_bystanders(instance: TaskInstance, photo_objects: Sequence[InstanceObject]) -> TaskInstance:
    """The instance among the objects of the photo; bystanders that it had before are dropped.

    Raises ``ValidationError`` where it then has too many objects, or speaks of a bystander that it had.
    """
    placed, around = match_objects_to_bystanders(instance.task_objects, photo_objects)
    return TaskInstance.model_validate({**dict(instance), "objects": (*placed, *around)})
