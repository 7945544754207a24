"""What each typed goal means: one definition, which scores the scene as it is and checks what the oracle plans."""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.scene_view import SceneView, describe_tilt, has_toppled, is_at_rest, supporting_object_ids
from grs_agents.sim.instance.goal import UPRIGHT_WITHIN, Goal, Kind, Zone
from grs_agents.sim.instance.task_instance import POSITION_TOLERANCE, ROTATION_TOLERANCE
from grs_agents.sim.world.collision_volumes import volume_share_in_zones
from grs_agents.sim.world.footprints import distance_between_outlines, margins_inside_outline

WHOLE: Final = 0.985
"""Share of an object's volume from which on it counts as wholly in a zone."""
_RIM: Final = 0.002
_FLUSH: Final = 0.003
"""An object may reach this far over the outline of its container, and stand this high on the bare table, metres."""
_POINT: Final = np.zeros((1, 2))


def explain_object_shortfall(goal: Goal, number: int, view: SceneView, rot_eps: float = ROTATION_TOLERANCE) -> str:
    """Why a typed goal does not hold for one of its objects in a scene, in one clause; "" where it holds.

    ``rot_eps`` (rad) is how much more tilted than at the start the object may be.
    """
    if not is_at_rest(number, view):
        return "does not lie still"
    assert goal.relation_kind is not None, "a goal without a relation"
    if goal.relation_kind != "upright" and has_toppled(number, view, rot_eps):
        return f"does not stand as upright as at the start: {describe_tilt(number, view)}"
    return _RULES[goal.relation_kind](goal, number, view)


def explain_goal_shortfalls(goal: Goal, view: SceneView, rot_eps: float = ROTATION_TOLERANCE) -> list[str]:
    """One clause (see ``explain_object_shortfall``) for each object of a typed goal."""
    return [explain_object_shortfall(goal, number, view, rot_eps) for number in goal.objects]


def object_footprint_as_zone(number: int, view: SceneView) -> Zone:
    """The rectangle that an object covers, as a zone: its pose and extents, metres."""
    low, high = view.object_model(number).bounds
    pose = view.object_pose(number)
    center = transforms.transform_points(pose, (np.add(low, high) / 2).reshape(3, 1)).ravel()
    upright = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, transforms.yaw_of_quaternion(pose[1])))
    return Zone.model_construct(
        pose=(transforms.to_vec3(center), upright), size=transforms.to_vec3(np.subtract(high, low))
    )


def explain_not_inside(number: int, container: int, view: SceneView) -> str:
    """Why an object does not lie in a container, in one clause; "" where it does."""
    own, rim = view.object_prism(number), view.object_prism(container)
    if own.low > rim.high - _RIM:
        return f"is {own.low:.3f} m up, not below the rim of {view.object_label(container)} at {rim.high:.3f} m"
    margin = margins_inside_outline(own.outline, rim.outline, _POINT)[0]
    if margin < -_FLUSH:
        return f"reaches {-margin:.3f} m over the outline of {view.object_label(container)}"
    below = supporting_object_ids(number, view)
    in_bottomless_frame = (
        not below and own.low < _FLUSH and view.is_point_over_object(container, view.object_pose(number)[0])
    )
    if container in below or in_bottomless_frame:
        return ""
    if below and all(
        view.is_point_over_object(container, view.object_pose(other)[0])
        and view.object_prism(other).low <= rim.high - _RIM
        for other in below
    ):
        return ""
    return f"is held neither by {view.object_label(container)} nor by what lies in it"


def _explain_not_resting_on(number: int, support: int, view: SceneView) -> str:
    name = view.object_label(support)
    below = supporting_object_ids(number, view)
    mark = (
        not view.object_model(support).colliders
        and not below
        and view.object_prism(number).low < view.object_prism(support).high + 0.01
    )
    if support not in below and not mark:
        own, other = view.object_pose(number)[0], view.object_pose(support)[0]
        low, high = view.object_prism(number).low, view.object_prism(support).high
        return (
            f"does not rest on {name}: their centres are {math.dist(own[:2], other[:2]):.3f} m apart seen from above, "
            f"its underside is {abs(low):.3f} m up, the top of {name} {high:.3f} m"
        )
    return "" if view.is_point_over_object(support, view.object_pose(number)[0]) else f"has its centre beside {name}"


def _explain_not_stacked(goal: Goal, number: int, view: SceneView) -> str:
    level = goal.objects.index(number)
    if level == 0:
        above = goal.objects[1]
        return _explain_not_resting_on(above, number, view) and f"does not carry {view.object_label(above)}"
    return _explain_not_resting_on(number, goal.objects[level - 1], view)


def _explain_not_near(goal: Goal, number: int, view: SceneView) -> str:
    other, bound = goal.reference_id, goal.required_distance or 0.0
    if other in supporting_object_ids(number, view):
        return f"lies on {view.object_label(other)}, not beside it"
    gap = gap_between_objects(number, other, view)
    return (
        "" if gap <= bound else f"is {gap:.3f} m from {view.object_label(other)}, at most {bound:.3f} m are asked for"
    )


def gap_between_objects(first: int, second: int, view: SceneView) -> float:
    """The distance between the upright prisms around two objects, metres."""
    own, other = view.object_prism(first), view.object_prism(second)
    return float(
        np.hypot(
            distance_between_outlines(own.outline, other.outline), max(0.0, own.low - other.high, other.low - own.high)
        )
    )


def _explain_not_aligned(goal: Goal, number: int, view: SceneView) -> str:
    centers = np.array([view.object_pose(other)[0][:2] for other in goal.objects])
    along, aside = project_onto_best_line(centers)
    row, out = goal.objects.index(number), aside > POSITION_TOLERANCE
    if out[row]:
        return f"lies {aside[row]:.3f} m beside the line of the {len(centers)} objects"
    if out.any():
        return f"is in no line with the others, of which {out.sum()} lie beside it"
    lows = [view.object_prism(other).low for other in goal.objects]
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
    """For points (N, 2) the places (N,) along their best line, and the distances (N,) from it, metres."""
    centered = points - points.mean(axis=0)
    axes = np.linalg.svd(centered)[2]
    return centered @ axes[0], np.abs(centered @ axes[1])


def _explain_not_upright(goal: Goal, number: int, view: SceneView) -> str:
    del goal
    tilt = view.object_tilt(number)
    return "" if tilt <= UPRIGHT_WITHIN else f"is tilted by {np.rad2deg(tilt):.0f} degrees"


def _explain_not_in_zone(goal: Goal, number: int, view: SceneView) -> str:
    zone = goal.reference_id
    share = volume_share_in_zones(
        view.object_volume(number), view.object_pose(number), [object_footprint_as_zone(zone, view)], np.inf
    )
    if share <= WHOLE:
        x, y, _ = view.object_pose(number)[0]
        return f"is {share:.0%} over {view.object_label(zone)}, its centre is at ({x:.3f}, {y:.3f})"
    below = supporting_object_ids(number, view) - {zone}
    top = max(0.0, view.object_prism(zone).high)
    if view.object_prism(number).low <= top + POSITION_TOLERANCE or (
        below and _are_all_wanted_in_zone(below, goal, view)
    ):
        return ""
    return f"rests at {view.object_prism(number).low:.3f} m, above {view.object_label(zone)}"


def _are_all_wanted_in_zone(numbers: set[int], goal: Goal, view: SceneView) -> bool:
    """Whether what carries an object is wanted in the same zone, by this goal or by another one."""
    wanted = set(goal.objects)
    for other in view.stated_goals:
        if other.has_same_relation(goal):
            wanted.update(other.objects)
    return numbers <= wanted


_RULES: Final[dict[Kind, Callable[[Goal, int, SceneView], str]]] = {
    "inside": lambda goal, number, view: explain_not_inside(number, goal.reference_id, view),
    "on": lambda goal, number, view: _explain_not_resting_on(number, goal.reference_id, view),
    "stacked": _explain_not_stacked,
    "near": _explain_not_near,
    "aligned": _explain_not_aligned,
    "upright": _explain_not_upright,
    "in_zone": _explain_not_in_zone,
}
