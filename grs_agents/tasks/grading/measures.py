"""What a scene and its goals say of a task's difficulty before anybody tries it: clutter and tolerance."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from grs_agents.base import Frozen
from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import POSITION_TOLERANCE, TaskInstance
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.footprints import Prism, collider_prisms_at_pose, distance_between_outlines
from grs_agents.sim.world.spec import load_object_model

_WORKSPACE: Final = 0.5
"""Square metres of the table that objects stand on, 0.5 by 1 m."""
_FAR: Final = 0.3
"""Obstacles farther than this (m) count as this far."""
_ANY_YAW: Final = 180.0


class Clutter(Frozen):
    """How near other things are, and how many there are."""

    nearest: float  # metres from an object that is to be moved to the nearest other solid thing; mean over these
    objects_per_square_metre: float


class Tolerance(Frozen):
    """How far off the hardest goal lets an object be."""

    metres: float
    degrees: float  # of its yaw; 180 where any will do


def measure_clutter(instance: TaskInstance, library: Library) -> Clutter:
    """Of an instance as it begins."""
    prisms = {
        item.id: collider_prisms_at_pose(load_object_model(item, library), item.pose, item.id)
        for item in instance.objects
    }
    wanted = {number for goal in instance.goals for number in goal.objects if prisms[number]}
    gaps = [
        _distance_to_nearest_outline(
            prisms[number], [one for own, row in prisms.items() if own != number for one in row]
        )
        for number in wanted
    ]
    solid = sum(bool(row) for row in prisms.values())
    return Clutter(nearest=float(np.mean(gaps)) if gaps else _FAR, objects_per_square_metre=solid / _WORKSPACE)


def _distance_to_nearest_outline(own: list[Prism], others: list[Prism]) -> float:
    """The level distance to the nearest of others that rise beside something, metres."""
    low, high = min(prism.low for prism in own), max(prism.high for prism in own)
    beside = [other for other in others if other.high > low + 0.005 and other.low < high]
    return min((distance_between_outlines(one.outline, other.outline) for one in own for other in beside), default=_FAR)


def measure_tolerance(instance: TaskInstance, library: Library) -> Tolerance:
    """Of the goals of an instance: the least of them."""
    models = {item.id: load_object_model(item, library) for item in instance.objects}
    found = [one for goal in instance.goals for one in _list_goal_object_tolerances(goal, instance, models, library)]
    return Tolerance(
        metres=min((metres for metres, _ in found), default=_FAR),
        degrees=min((degrees for _, degrees in found), default=_ANY_YAW),
    )


def _list_goal_object_tolerances(
    goal: Goal, instance: TaskInstance, models: dict[int, ObjectModel], library: Library
) -> Iterator[tuple[float, float]]:
    """(metres, degrees) for each object of a goal."""
    for number, symmetry in zip(goal.objects, goal.symmetries, strict=True):
        if goal.metric == "pose":
            asked = goal.rotations and symmetry > 0
            yield instance.pos_eps, math.degrees(instance.rot_eps) if asked else _ANY_YAW
        elif goal.metric == "zone":
            sharers = {one for other in instance.goals if other.zones == goal.zones for one in other.objects}
            yield max(_max_offset_in_rectangle(zone.size[:2], number, sharers, models) for zone in goal.zones), _ANY_YAW
        else:
            yield _relation_position_tolerance(goal, number, instance.goals, models, library), _ANY_YAW


def _relation_position_tolerance(
    goal: Goal, number: int, goals: Sequence[Goal], models: dict[int, ObjectModel], library: Library
) -> float:
    """Metres that one object of a typed goal may be off."""
    kind = goal.relation_kind
    if kind in ("inside", "in_zone"):
        model = models[goal.reference_id]
        room = measure_inner_size(model, library) if kind == "inside" else None
        sharers = {one for other in goals if other.has_same_relation(goal) for one in other.objects}
        return _max_offset_in_rectangle((room or model.size)[:2], number, sharers, models)
    if kind in ("stacked", "on"):
        carriers = goal.objects if kind == "stacked" else (goal.reference_id,)
        return min(min(models[other].size[:2]) / 2 for other in carriers)
    return {"aligned": POSITION_TOLERANCE, "near": goal.required_distance}.get(str(kind)) or _FAR


def _max_offset_in_rectangle(
    room: tuple[float, float], number: int, sharers: set[int], models: dict[int, ObjectModel]
) -> float:
    """How far (m) an object can be off within a rectangle: as the sides leave, and the area that others take."""
    size = sorted(models[number].size[:2])
    sides = [(have - need) / 2 for have, need in zip(sorted(room), size, strict=True)]
    taken = sum(math.prod(models[one].size[:2]) for one in sharers)
    spare = (math.sqrt(math.prod(room)) - math.sqrt(taken)) / 2
    return max(0.0, min(*sides, spare))
