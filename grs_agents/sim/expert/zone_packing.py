"""Where the oracle puts the objects that ``zone`` goals speak of: packed together, clear of what is there."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.geometry import transforms
from grs_agents.sim.goals import SceneView, ScoredTask, make_stop
from grs_agents.sim.instance import Zone
from grs_agents.sim.motion import (
    TALLEST_STACK,
    Blocked,
    FloatArray,
    ReachTest,
    Region,
    Spot,
    Target,
    describe_out_of_reach,
    find_free_spot,
    format_point,
    rotated_outline_at_origin,
    wrap_angle,
)
from grs_agents.sim.world import Prism, margins_inside_outline, signed_outline_gaps

GAPS: Final = (0.025, 0.012, 0.006, 0.003)
"""Free space asked for between neighbours in a zone, metres: as generous as fits."""


def region_of_zone(zone: Zone) -> Region:
    """A zone seen from above."""
    (x, y, _), rotation = zone.pose
    return Region((x, y), zone.size[:2], transforms.yaw_of_quaternion(rotation))


def unplaced_zone_members(zone: Zone, task: ScoredTask) -> list[int]:
    """Objects that goals still want in a zone, and are not there yet."""
    members: list[int] = []
    for goal in task.goals:
        if goal.metric == "zone" and zone in goal.zones:
            scores = task.grs.score_goal_objects(goal)
            members.extend(number for number, score in zip(goal.objects, scores, strict=True) if score < 0.985)
    return list(dict.fromkeys(members))


def yaw_turns_to_try(number: int, region: Region, view: SceneView) -> list[float]:
    """Turns (rad) worth trying: as it is if it is round, else along the region's sides."""
    aligned = wrap_angle(region.yaw - view.object_yaw(number), np.pi / 2)
    width, depth = view.object_extent_xy(number)
    across = [wrap_angle(aligned + np.pi / 2, np.pi)] if abs(width - depth) > 0.002 else []
    round_ = all(shape.kind in ("cylinder", "sphere") for shape in view.object_model(number).colliders)
    return [0.0] if round_ and view.object_tilt(number) < 0.1 else [aligned, *across]


def pack_objects_into_zone(zone: Zone, members: Sequence[int], view: SceneView, lift: float) -> dict[int, Spot]:
    """Spots for as many members as fit together, the first one before all others; empty if it does not fit."""
    region = region_of_zone(zone)
    first, rest = members[0], sorted(members[1:], key=lambda number: -float(np.prod(view.object_extent_xy(number))))
    best: dict[int, Spot] = {}
    for gap in GAPS:
        for order in (
            [first, *rest],
            sorted(members, key=lambda number: -float(np.prod(view.object_extent_xy(number)))),
        ):
            plan = _pack_region_in_order(region, order, view, lift, gap)
            if first in plan and len(plan) > len(best):
                best = plan
            if len(best) == len(members):
                return best
    return best


def _pack_region_in_order(
    region: Region, order: Sequence[int], view: SceneView, lift: float, gap: float
) -> dict[int, Spot]:
    inner = Region(region.center, (region.size[0] - min(gap, 0.008), region.size[1] - min(gap, 0.008)), region.yaw)
    obstacles = view.prisms_of_other_objects(*order)
    plan: dict[int, Spot] = {}
    for number in order:
        body, center = view.object_prism(number), view.object_pose(number)[0]
        standing = [
            *obstacles,
            *(
                prism
                for prism in view.prisms
                if prism.owner in order and prism.owner not in plan and prism.owner != number
            ),
        ]
        alone = len(order) == 1
        spot = find_free_spot(
            body,
            center,
            yaw_turns_to_try(number, region, view),
            inner,
            standing,
            gap,
            ReachTest(lift, view.arm),
            spread=alone,
        )
        if spot is None:
            continue
        plan[number] = spot
        shape = rotated_outline_at_origin(body, np.asarray(center[:2]), spot.turn)
        obstacles.append(
            Prism(shape.outline + np.asarray(spot.center), spot.height, spot.height + body.high - body.low, number)
        )
    return plan


def explain_or_unblock_zone(
    zone: Zone, number: int, members: Sequence[int], view: SceneView, lift: float, host: int = -1
) -> Target:
    """Nothing is free: the zone is too small, out of reach, or taken; if taken, by what can be moved, or on what.

    ``host`` is the id of the container, support or mark that covers the zone, if one does.
    """
    region, name, body = region_of_zone(zone), view.object_label(number), view.object_prism(number)
    center, turns = view.object_pose(number)[0], yaw_turns_to_try(number, region, view)
    width, depth = view.object_extent_xy(number)
    others = view.prisms_of_other_objects(number)
    fixed = [prism for prism in others if prism.owner == host or not view.is_object_movable(prism.owner)]

    def anywhere(offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        del heights
        return np.ones(len(offsets), dtype=bool)

    size = f"{region.size[0]:.3f} x {region.size[1]:.3f} m"
    what = f"the target zone ({size})" if host < 0 else f"{view.object_label(host)} ({size} outside)"
    if find_free_spot(body, center, turns, region, fixed, 0.001, anywhere) is None:
        inner = ", its walls and what is fixed in it counted" if fixed else ""
        detail = f"{what} is too small for {name} ({width:.3f} x {depth:.3f} m){inner}"
        return make_stop("target_too_small", detail, view, number)
    if find_free_spot(body, center, turns, region, fixed, 0.001, ReachTest(lift, view.arm)) is None:
        tip = (region.center[0], region.center[1], lift)
        detail = f"{what} for {name} at {format_point(zone.pose[0])} {describe_out_of_reach(tip, view.arm)}"
        return make_stop("unreachable", detail, view, number)
    return _unblock_full_region(region, number, members, view, lift, what, host)


def _unblock_full_region(
    region: Region, number: int, members: Sequence[int], view: SceneView, lift: float, what: str, host: int
) -> Target:
    """What is to be moved out of a full region; a spot on top of what lies there; or why neither is possible."""
    name, body = view.object_label(number), view.object_prism(number)
    inside = [other for other in _movable_objects_in_region(region, number, view) if other != host]
    foreign = [other for other in inside if other in members or not _is_wholly_in_region(other, region, view)]
    for other in foreign or _objects_without_goal(inside, view):
        return Blocked(other, (Prism(region.corner_points, 0.0, 1.0, number),))
    turns, suits = yaw_turns_to_try(number, region, view), ReachTest(lift, view.arm)
    center, others = view.object_pose(number)[0], view.prisms_of_other_objects(number)
    spot = find_free_spot(body, center, turns, region, others, 0.002, suits, spread=True, stack=True)
    if spot is not None and spot.height + body.high - body.low < TALLEST_STACK:
        return spot
    taken = f"occupied by {', '.join(map(view.object_label, inside))}" if inside else "no place in it can be reached"
    return make_stop("target_occupied", f"no room for {name} in {what}: {taken}", view, number, *inside)


def _movable_objects_in_region(region: Region, number: int, view: SceneView) -> list[int]:
    """The other movable objects that reach into a region."""
    return [
        other
        for other in view.object_ids
        if other != number
        and view.is_object_movable(other)
        and signed_outline_gaps(view.object_prism(other).outline, region.corner_points, np.zeros((1, 2)))[0] < -0.002
    ]


def _is_wholly_in_region(number: int, region: Region, view: SceneView) -> bool:
    """Whether an object lies wholly in a region."""
    return bool(
        margins_inside_outline(view.object_prism(number).outline, region.corner_points, np.zeros((1, 2)))[0] > -0.01
    )


def _objects_without_goal(numbers: Sequence[int], view: SceneView) -> list[int]:
    """Objects that no goal speaks of."""
    wanted = {number for goal in view.stated_goals for number in goal.objects}
    return [number for number in numbers if number not in wanted]
