"""What each typed goal means: one definition, which scores the scene as it is and checks what the oracle plans."""

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.geometry import transforms
from grs_agents.sim.goals.scene_view import SceneView, has_toppled, is_at_rest, objects_below
from grs_agents.sim.instance import POSITION_TOLERANCE, ROTATION_TOLERANCE, UPRIGHT_WITHIN, Goal, Kind, Zone
from grs_agents.sim.world import inside_margin, outline_distance, share_inside

WHOLE: Final = 0.985
"""Share of an object's volume from which on it counts as wholly in a zone."""
_RIM: Final = 0.002
_FLUSH: Final = 0.003
"""An object may reach this far over the outline of its container, and stand this high on the bare table, metres."""
_POINT: Final = np.zeros((1, 2))


def shortfall(goal: Goal, number: int, view: SceneView, rot_eps: float = ROTATION_TOLERANCE) -> str:
    """Why a typed goal does not hold for one of its objects in a scene, in one clause; "" where it holds.

    ``rot_eps`` (rad) is how much more tilted than at the start the object may be.
    """
    if not is_at_rest(number, view):
        return "does not lie still"
    assert goal.kind is not None, "a goal without a relation"
    if goal.kind != "upright" and has_toppled(number, view, rot_eps):
        return "does not stand as upright as at the start"
    return _RULES[goal.kind](goal, number, view)


def shortfalls(goal: Goal, view: SceneView, rot_eps: float = ROTATION_TOLERANCE) -> list[str]:
    """One clause (see ``shortfall``) for each object of a typed goal."""
    return [shortfall(goal, number, view, rot_eps) for number in goal.objects]


def zone_covered_by(number: int, view: SceneView) -> Zone:
    """The rectangle that an object covers, as a zone: its pose and extents, metres."""
    low, high = view.model(number).bounds
    pose = view.pose(number)
    center = transforms.apply(pose, (np.add(low, high) / 2).reshape(3, 1)).ravel()
    upright = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, transforms.yaw_of(pose[1])))
    return Zone.model_construct(pose=(transforms.vec3(center), upright), size=transforms.vec3(np.subtract(high, low)))


def _inside(goal: Goal, number: int, view: SceneView) -> str:
    container = goal.reference
    own, rim = view.outline(number), view.outline(container)
    if own.low > rim.high - _RIM:
        return f"is not below the rim of {view.name(container)}, at {rim.high:.3f} m"
    if inside_margin(own.outline, rim.outline, _POINT)[0] < -_FLUSH:
        return f"reaches over the outline of {view.name(container)}"
    below = objects_below(number, view)
    in_bottomless_frame = not below and own.low < _FLUSH and view.over(container, view.pose(number)[0])
    if container in below or in_bottomless_frame:
        return ""
    if below and all(
        view.over(container, view.pose(other)[0]) and view.outline(other).low <= rim.high - _RIM for other in below
    ):
        return ""
    return f"is held neither by {view.name(container)} nor by what lies in it"


def _rests_on(number: int, support: int, view: SceneView) -> str:
    name = view.name(support)
    below = objects_below(number, view)
    mark = (
        not view.model(support).colliders and not below and view.outline(number).low < view.outline(support).high + 0.01
    )
    if support not in below and not mark:
        return f"does not rest on {name}"
    return "" if view.over(support, view.pose(number)[0]) else f"has its centre beside {name}"


def _stacked(goal: Goal, number: int, view: SceneView) -> str:
    level = goal.objects.index(number)
    if level == 0:
        above = goal.objects[1]
        return _rests_on(above, number, view) and f"does not carry {view.name(above)}"
    return _rests_on(number, goal.objects[level - 1], view)


def _near(goal: Goal, number: int, view: SceneView) -> str:
    other, bound = goal.reference, goal.distance or 0.0
    if other in objects_below(number, view):
        return f"lies on {view.name(other)}, not beside it"
    gap = gap_between(number, other, view)
    return "" if gap <= bound else f"is {gap:.3f} m from {view.name(other)}, at most {bound:.3f} m are asked for"


def gap_between(first: int, second: int, view: SceneView) -> float:
    """The distance between the upright prisms around two objects, metres."""
    own, other = view.outline(first), view.outline(second)
    return float(
        np.hypot(outline_distance(own.outline, other.outline), max(0.0, own.low - other.high, other.low - own.high))
    )


def _aligned(goal: Goal, number: int, view: SceneView) -> str:
    centers = np.array([view.pose(other)[0][:2] for other in goal.objects])
    along, aside = fit_line(centers)
    row, out = goal.objects.index(number), aside > POSITION_TOLERANCE
    if out[row]:
        return f"lies {aside[row]:.3f} m beside the line of the {len(centers)} objects"
    if out.any():
        return f"is in no line with the others, of which {out.sum()} lie beside it"
    lows = [view.outline(other).low for other in goal.objects]
    if abs(lows[row] - float(np.median(lows))) > POSITION_TOLERANCE:
        return "lies higher or lower than the others of its line"
    if goal.distance is None:
        return ""
    ranks = np.argsort(along)
    steps = np.abs(np.diff(along[ranks]) - goal.distance)
    rank = int(np.flatnonzero(ranks == row)[0])
    beside = [float(steps[index]) for index in (rank - 1, rank) if 0 <= index < len(steps)]
    wrong = [step for step in beside if step > POSITION_TOLERANCE]
    return f"is {max(wrong):.3f} m off the spacing of {goal.distance:.3f} m" if wrong else ""


def fit_line(points: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """For points (N, 2) the places (N,) along their best line, and the distances (N,) from it, metres."""
    centered = points - points.mean(axis=0)
    axes = np.linalg.svd(centered)[2]
    return centered @ axes[0], np.abs(centered @ axes[1])


def _upright(goal: Goal, number: int, view: SceneView) -> str:
    del goal
    tilt = view.tilt(number)
    return "" if tilt <= UPRIGHT_WITHIN else f"is tilted by {np.rad2deg(tilt):.0f} degrees"


def _in_zone(goal: Goal, number: int, view: SceneView) -> str:
    zone = goal.reference
    share = share_inside(view.volume(number), view.pose(number), [zone_covered_by(zone, view)], np.inf)
    if share <= WHOLE:
        return f"is {share:.0%} over {view.name(zone)}"
    below = objects_below(number, view) - {zone}
    top = max(0.0, view.outline(zone).high)
    if view.outline(number).low <= top + POSITION_TOLERANCE or (below and _all_wanted_in_zone(below, goal, view)):
        return ""
    return f"rests at {view.outline(number).low:.3f} m, above {view.name(zone)}"


def _all_wanted_in_zone(numbers: set[int], goal: Goal, view: SceneView) -> bool:
    """Whether what carries an object is wanted in the same zone, by this goal or by another one."""
    wanted = set(goal.objects)
    for other in view.stated_goals:
        if other.same_relation(goal):
            wanted.update(other.objects)
    return numbers <= wanted


_RULES: Final[dict[Kind, Callable[[Goal, int, SceneView], str]]] = {
    "inside": _inside,
    "on": lambda goal, number, view: _rests_on(number, goal.reference, view),
    "stacked": _stacked,
    "near": _near,
    "aligned": _aligned,
    "upright": _upright,
    "in_zone": _in_zone,
}
