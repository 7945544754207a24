"""The strict definition of each typed goal, shared by the score of a scene and by the oracle's plans."""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.planning_scene import (
    PlanningScene,
    describe_tilt,
    has_toppled,
    is_at_rest,
    supporting_object_ids,
)
from grs_agents.sim.goals.scores import MET
from grs_agents.sim.instance.goal import UPRIGHT_WITHIN, Goal, Kind, Zone
from grs_agents.sim.instance.task_instance import POSITION_TOLERANCE, ROTATION_TOLERANCE
from grs_agents.sim.world.collision_volumes import volume_share_in_zones
from grs_agents.sim.world.footprints import distance_between_outlines, margins_inside_outline

_RIM: Final = 0.002
_FLUSH: Final = 0.003
"""Slack, metres: how far an object may overhang its container's outline, and stand above the bare table."""
_POINT: Final = np.zeros((1, 2))


def explain_object_shortfall(goal: Goal, number: int, scene: PlanningScene, rot_eps: float = ROTATION_TOLERANCE) -> str:
    """Reason, in a clause, why a typed goal does not hold for an object of it; "" if it holds.

    ``rot_eps`` (rad) is the tilt that the object may have gained since the start.
    """
    if not is_at_rest(number, scene):
        return "does not lie still"
    assert goal.relation_kind is not None, "a goal without a relation"
    if goal.relation_kind != "upright" and has_toppled(number, scene, rot_eps):
        return f"does not stand as upright as at the start: {describe_tilt(number, scene)}"
    return _RULES[goal.relation_kind](goal, number, scene)


def explain_goal_shortfalls(goal: Goal, scene: PlanningScene, rot_eps: float = ROTATION_TOLERANCE) -> list[str]:
    """``explain_object_shortfall`` for each object of a typed goal."""
    return [explain_object_shortfall(goal, number, scene, rot_eps) for number in goal.objects]


def object_footprint_as_zone(number: int, scene: PlanningScene) -> Zone:
    """An object's bounding rectangle on the table as a zone: pose and extents, metres."""
    low, high = scene.object_model(number).bounds
    pose = scene.object_pose(number)
    center = transforms.transform_points(pose, (np.add(low, high) / 2).reshape(3, 1)).ravel()
    upright = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, transforms.yaw_of_quaternion(pose[1])))
    return Zone.model_construct(
        pose=(transforms.to_vec3(center), upright), size=transforms.to_vec3(np.subtract(high, low))
    )


def explain_not_inside(number: int, container: int, scene: PlanningScene) -> str:
    """Reason, in a clause, why an object does not lie in a container; "" if it does."""
    body, rim = scene.object_prism(number), scene.object_prism(container)
    if body.low > rim.high - _RIM:
        return f"is {body.low:.3f} m up, not below the rim of {scene.object_label(container)} at {rim.high:.3f} m"
    margin = margins_inside_outline(body.outline, rim.outline, _POINT)[0]
    if margin < -_FLUSH:
        return f"reaches {-margin:.3f} m over the outline of {scene.object_label(container)}"
    below = supporting_object_ids(number, scene)
    in_bottomless_frame = (
        not below and body.low < _FLUSH and scene.is_point_over_object(container, scene.object_pose(number)[0])
    )
    if container in below or in_bottomless_frame:
        return ""
    if below and all(
        scene.is_point_over_object(container, scene.object_pose(other)[0])
        and scene.object_prism(other).low <= rim.high - _RIM
        for other in below
    ):
        return ""
    return f"is held neither by {scene.object_label(container)} nor by what lies in it"


def _explain_not_resting_on(number: int, support: int, scene: PlanningScene) -> str:
    name = scene.object_label(support)
    below = supporting_object_ids(number, scene)
    mark = (
        not scene.object_model(support).colliders
        and not below
        and scene.object_prism(number).low < scene.object_prism(support).high + 0.01
    )
    if support not in below and not mark:
        center, middle = scene.object_pose(number)[0], scene.object_pose(support)[0]
        low, high = scene.object_prism(number).low, scene.object_prism(support).high
        return (
            f"does not rest on {name}: their centres are {math.dist(center[:2], middle[:2]):.3f} m apart seen from "
            f"above, its underside is {abs(low):.3f} m up, the top of {name} {high:.3f} m"
        )
    return "" if scene.is_point_over_object(support, scene.object_pose(number)[0]) else f"has its centre beside {name}"


def _explain_not_stacked(goal: Goal, number: int, scene: PlanningScene) -> str:
    level = goal.objects.index(number)
    if level == 0:
        above = goal.objects[1]
        return _explain_not_resting_on(above, number, scene) and f"does not carry {scene.object_label(above)}"
    return _explain_not_resting_on(number, goal.objects[level - 1], scene)


def _explain_not_near(goal: Goal, number: int, scene: PlanningScene) -> str:
    neighbour, bound = goal.reference_id, goal.required_distance or 0.0
    label = scene.object_label(neighbour)
    if neighbour in supporting_object_ids(number, scene):
        return f"lies on {label}, not beside it"
    gap = gap_between_objects(number, neighbour, scene)
    return "" if gap <= bound else f"is {gap:.3f} m from {label}, at most {bound:.3f} m are asked for"


def gap_between_objects(first: int, second: int, scene: PlanningScene) -> float:
    """Distance between the upright prisms around two objects, metres."""
    a, b = scene.object_prism(first), scene.object_prism(second)
    return float(np.hypot(distance_between_outlines(a.outline, b.outline), max(0.0, a.low - b.high, b.low - a.high)))


def _explain_not_aligned(goal: Goal, number: int, scene: PlanningScene) -> str:
    centers = np.array([scene.object_pose(other)[0][:2] for other in goal.objects])
    along, aside = project_onto_best_line(centers)
    row, out = goal.objects.index(number), aside > POSITION_TOLERANCE
    if out[row]:
        return f"lies {aside[row]:.3f} m beside the line of the {len(centers)} objects"
    if out.any():
        return f"is in no line with the others, of which {out.sum()} lie beside it"
    lows = [scene.object_prism(other).low for other in goal.objects]
    if abs(lows[row] - float(np.median(lows))) > POSITION_TOLERANCE:
        return "lies higher or lower than the others of its line"
    if goal.required_distance is None:
        return ""
    ranks = np.argsort(along)
    steps = np.abs(np.diff(along[ranks]) - goal.required_distance)
    rank = int(np.flatnonzero(ranks == row)[0])
    beside = [float(steps[index]) for index in (rank - 1, rank) if 0 <= index < len(steps)]
    wrong = [step for step in beside if step > POSITION_TOLERANCE]
    return f"is {max(wrong):.3f} m off the spacing of {goal.required_distance:.3f} m" if wrong else ""


def project_onto_best_line(points: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Coordinates (N,) of points (N, 2) along their best-fit line, and distances (N,) from it, metres."""
    centered = points - points.mean(axis=0)
    axes = np.linalg.svd(centered)[2]
    return centered @ axes[0], np.abs(centered @ axes[1])


def _explain_not_upright(goal: Goal, number: int, scene: PlanningScene) -> str:
    del goal
    tilt = scene.object_tilt(number)
    return "" if tilt <= UPRIGHT_WITHIN else f"is tilted by {np.rad2deg(tilt):.0f} degrees"


def _explain_not_in_zone(goal: Goal, number: int, scene: PlanningScene) -> str:
    zone = goal.reference_id
    share = volume_share_in_zones(
        scene.object_volume(number), scene.object_pose(number), [object_footprint_as_zone(zone, scene)], np.inf
    )
    if share <= MET:
        x, y, _ = scene.object_pose(number)[0]
        return f"is {share:.0%} over {scene.object_label(zone)}, its centre is at ({x:.3f}, {y:.3f})"
    label, low = scene.object_label(zone), scene.object_prism(number).low
    if low <= max(0.0, scene.object_prism(zone).high) + POSITION_TOLERANCE:
        return ""
    below = supporting_object_ids(number, scene) - {zone}
    wanted = set(goal.objects)  # in the same zone, by this goal or others
    for stated in scene.stated_goals:
        if stated.has_same_relation(goal):
            wanted.update(stated.objects)
    return "" if below and below <= wanted else f"rests at {low:.3f} m, above {label}"


_RULES: Final[dict[Kind, Callable[[Goal, int, PlanningScene], str]]] = {
    "inside": lambda goal, number, scene: explain_not_inside(number, goal.reference_id, scene),
    "on": lambda goal, number, scene: _explain_not_resting_on(number, goal.reference_id, scene),
    "stacked": _explain_not_stacked,
    "near": _explain_not_near,
    "aligned": _explain_not_aligned,
    "upright": _explain_not_upright,
    "in_zone": _explain_not_in_zone,
}
