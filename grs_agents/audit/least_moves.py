"""How far an object must move at the least for its goal to hold: the oracle may move it farther than it has to."""

import math
from itertools import combinations
from typing import Final

import numpy as np

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.footprints import (
    Prism,
    distance_between_outlines,
    margins_inside_outline,
    object_prism_at_pose,
    rectangle_outline,
)
from grs_agents.sim.world.spec import load_object_model

_TOLERANCE: Final = 0.01
"""Metres by which a pose goal may be missed anyway."""
_LIFTED: Final = 0.05
"""What must come to lie so much higher or lower (m) is not nudged there."""
_HERE: Final = np.zeros((1, 2))


def measure_least_move(goal: Goal, row: int, instance: TaskInstance, rollout: Rollout, library: Library) -> float:
    """Metres along the table, at most so many; infinite where no nudge along the table could do."""
    if goal.metric == "pose":
        return _distance_to_nearest_target(goal, row, instance, rollout)
    own = _compute_object_prism_at_start(goal.objects[row], instance, rollout, library)
    if goal.metric == "zone":
        return min(_distance_to_fit_inside(own, _outline_of_zone(zone)) for zone in goal.zones)
    if goal.relation_kind == "aligned" and goal.required_distance is None:
        return _distance_to_best_line(np.array([rollout.initial[number][0][:2] for number in goal.objects]))
    if goal.relation_kind not in ("near", "in_zone") or _is_object_of_goal(goal.reference_id, instance):
        return math.inf
    other = _compute_object_prism_at_start(goal.reference_id, instance, rollout, library)
    if goal.relation_kind == "in_zone":
        return _distance_to_fit_inside(own, other.outline)
    return distance_between_outlines(own.outline, other.outline) - (goal.required_distance or 0.0)


def _distance_to_nearest_target(goal: Goal, row: int, instance: TaskInstance, rollout: Rollout) -> float:
    start = rollout.initial[goal.objects[row]][0]
    ends = [goal.targets[index][0] for index in goal.allowed_target_indices(row)]
    ways = [math.dist(start[:2], end[:2]) if abs(start[2] - end[2]) < _LIFTED else math.inf for end in ends]
    return min(ways, default=math.inf) - max(0.0, instance.pos_eps - _TOLERANCE)


def _distance_to_fit_inside(own: Prism, around: FloatArray) -> float:
    return max(0.0, -float(margins_inside_outline(own.outline, around, _HERE)[0]))


def _outline_of_zone(zone: Zone) -> FloatArray:
    (x, y, _), turn = zone.pose
    return rectangle_outline((x, y), zone.size[:2], transforms.yaw_of_quaternion(turn))


def _distance_to_best_line(points: FloatArray) -> float:
    """How far the farthest of some points (N, 2) is from the best line through two of them."""
    farthest = math.inf
    for one, other in combinations(points, 2):
        way = other - one
        length = float(np.hypot(*way))
        if length > _TOLERANCE:
            aside = np.abs(way[0] * (points[:, 1] - one[1]) - way[1] * (points[:, 0] - one[0])) / length
            farthest = min(farthest, float(aside.max()))
    return farthest


def _is_object_of_goal(number: int, instance: TaskInstance) -> bool:
    """Whether a goal asks for an object itself, so that it does not stay where it stands at the start."""
    return any(number in goal.objects for goal in instance.goals)


def _compute_object_prism_at_start(number: int, instance: TaskInstance, rollout: Rollout, library: Library) -> Prism:
    item = next(item for item in instance.objects if item.id == number)
    return object_prism_at_pose(load_object_model(item, library), rollout.initial[number], number)
