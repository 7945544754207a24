"""Where the oracle puts the objects that ``zone`` goals speak of: packed together, clear of what is there."""

from collections.abc import Collection, Iterable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.scene_view import SceneView, describe_unmovables, make_oracle_stop
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.instance.goal import Zone
from grs_agents.sim.motion.placement import (
    TALLEST_STACK,
    BlockedTarget,
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
from grs_agents.sim.world.footprints import Prism, margins_inside_outline, signed_outline_gaps

GAPS: Final = (0.025, 0.012, 0.006, 0.003)
"""Free space asked for between neighbours in a zone, metres: as generous as fits."""
_SNUG: Final = 0.001
"""The least space with which an object still comes down beside another, metres."""


def zone_to_region(zone: Zone) -> Region:
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


def unplaced_objects(task: ScoredTask) -> set[int]:
    """Objects that goals still want elsewhere."""
    return {
        number
        for goal in task.goals
        for number, score in zip(goal.objects, task.grs.score_goal_objects(goal), strict=True)
        if score < 0.985
    }


def yaw_turns_to_try(number: int, region: Region, view: SceneView) -> list[float]:
    """Turns (rad) worth trying: as it is if it is round, else along the region's sides."""
    aligned = wrap_angle(region.yaw - view.object_yaw(number), np.pi / 2)
    width, depth = view.object_extent_xy(number)
    across = [wrap_angle(aligned + np.pi / 2, np.pi)] if abs(width - depth) > 0.002 else []
    round_ = all(shape.kind in ("cylinder", "sphere") for shape in view.object_model(number).colliders)
    return [0.0] if round_ and view.object_tilt(number) < 0.1 else [aligned, *across]


def pack_objects_into_zone(
    zone: Zone, members: Sequence[int], view: SceneView, lift: float, host: int = -1
) -> dict[int, Spot]:
    """Spots for as many members as fit together, the first one before all others; empty if it does not fit.

    ``host`` is the id of what covers the zone, if anything does: they stand on it or in it, else on the table. Episodes
    of one task begin alike, so a plan is remembered with all that it depends on.
    """
    key = (zone, tuple(members), lift, host, view.arrangement)
    if key not in view.packings:
        view.packings[key] = _pack_as_many_as_fit(zone, members, view, lift, host)
    packed: dict[int, Spot] = view.packings[key]
    return packed


def _pack_as_many_as_fit(
    zone: Zone, members: Sequence[int], view: SceneView, lift: float, host: int
) -> dict[int, Spot]:
    region = zone_to_region(zone)
    first, rest = members[0], sorted(members[1:], key=lambda number: -float(np.prod(view.object_extent_xy(number))))
    orders = [[first, *rest]]
    if (largest := sorted(members, key=lambda number: -float(np.prod(view.object_extent_xy(number))))) != orders[0]:
        orders.append(largest)
    best: dict[int, Spot] = {}
    for gap in GAPS:
        for order in orders:
            plan = _pack_region_in_order(region, order, view, lift, gap, host)
            if first in plan and len(plan) > len(best):
                best = plan
            if len(best) == len(members):
                return best
    return best


def _pack_region_in_order(
    region: Region, order: Sequence[int], view: SceneView, lift: float, gap: float, host: int
) -> dict[int, Spot]:
    inner = Region(region.center, (region.size[0] - min(gap, 0.008), region.size[1] - min(gap, 0.008)), region.yaw)
    obstacles = view.obstacles_to_plan_around(order, [host])
    plan: dict[int, Spot] = {}
    for number in order:
        body, center = view.object_prism(number), view.object_pose(number)[0]
        waiting = [other for other in order if other not in plan and other != number]
        standing = [*obstacles, *(prism.without_top for prism in view.prisms if prism.owner in waiting)]
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
        obstacles.append(Prism(shape.outline + np.asarray(spot.center), spot.height, spot.height + 1.0, number))
    return plan


def find_occupied_zone_target(
    zone: Zone, number: int, members: Sequence[int], task: ScoredTask, view: SceneView, lift: float, host: int = -1
) -> Target:
    """Nothing is free: the zone is too small, out of reach, or taken; if taken, by what can be moved, or on what.

    ``members`` are still wanted there; ``host`` is the id of what covers the zone: a container, support or mark.
    """
    region = zone_to_region(zone)
    useless = _stop_if_region_unusable(region, number, view, lift, host)
    if useless is not None:
        return useless
    inside = [other for other in _objects_in_region(region, number, view) if other != host]
    blockers = _objects_to_move_out(region, filter(view.may_robot_move, inside), members, task, view)
    if blockers:
        return BlockedTarget(blockers[0], (Prism(region.corner_points, 0.0, 1.0, number),))
    # What is wanted in a zone may carry others that are; in a container the goal's own definition decides.
    fellows = {other for goal in view.stated_goals if zone in goal.zones for other in goal.objects}
    spot = _find_tight_or_stacked_spot(region, number, view, lift, fellows if host < 0 else view.object_ids)
    if spot is not None:
        return spot
    taken = f"it is occupied by {', '.join(map(view.object_label, inside))}" if inside else "too little of it is free"
    detail = f"no room for {view.object_label(number)} in {_describe_region(region, host, view)}: {taken}"
    return make_oracle_stop("target_occupied", detail, view, number, *inside)


def _find_tight_or_stacked_spot(
    region: Region, number: int, view: SceneView, lift: float, fellows: Collection[int]
) -> Spot | None:
    """A spot for which there is hardly room, or on top of one of the fellows."""
    body, center, turns = view.object_prism(number), view.object_pose(number)[0], yaw_turns_to_try(number, region, view)
    obstacles, suits = view.obstacles_to_plan_around([number], fellows), ReachTest(lift, view.arm)
    for stack in (False, True):
        spot = find_free_spot(body, center, turns, region, obstacles, _SNUG, suits, spread=True, stack=stack)
        if spot is not None and spot.height + body.high - body.low < TALLEST_STACK:
            return spot
    return None


def _stop_if_region_unusable(region: Region, number: int, view: SceneView, lift: float, host: int) -> Stop | None:
    """Why an object finds no room in a region even if all is gone that the robot may move; None if it does."""
    name, body = view.object_label(number), view.object_prism(number)
    center, turns = view.object_pose(number)[0], yaw_turns_to_try(number, region, view)
    width, depth = view.object_extent_xy(number)
    obstacles = view.obstacles_to_plan_around([number], [host])
    kept = [prism for prism in obstacles if prism.owner == host or not view.may_robot_move(prism.owner)]
    fixed = [prism for prism in kept if not view.is_bystander(prism.owner)]

    def accept_all_offsets(offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        del heights
        return np.ones(len(offsets), dtype=bool)

    what, suits = _describe_region(region, host, view), ReachTest(lift, view.arm)
    if find_free_spot(body, center, turns, region, fixed, _SNUG, accept_all_offsets) is None:
        inner = ", its walls and what is fixed in it counted" if fixed else ""
        detail = f"{what} is too small for {name} ({width:.3f} x {depth:.3f} m){inner}"
        return make_oracle_stop("target_too_small", detail, view, number)
    if find_free_spot(body, center, turns, region, fixed, _SNUG, suits) is None:
        tip = (*region.center, lift)
        detail = f"{what} for {name} at {format_point((*region.center, 0.0))} {describe_out_of_reach(tip, view.arm)}"
        return make_oracle_stop("unreachable", detail, view, number)
    if find_free_spot(body, center, turns, region, kept, _SNUG, suits) is None:
        staying = [other for other in _objects_in_region(region, number, view) if view.is_bystander(other)]
        detail = f"no room for {name} in {what}: it is occupied by {describe_unmovables(staying, view)}"
        return make_oracle_stop("target_occupied", detail, view, number, *staying)
    return None


def _describe_region(region: Region, host: int, view: SceneView) -> str:
    size = f"{region.size[0]:.3f} x {region.size[1]:.3f} m"
    return f"the target zone ({size})" if host < 0 else f"{view.object_label(host)} ({size} outside)"


def _objects_to_move_out(
    region: Region, loose: Iterable[int], members: Sequence[int], task: ScoredTask, view: SceneView
) -> list[int]:
    """Of loose objects in a region those that no goal has settled where they are, first what reaches over its edge."""
    settled = {number for goal in view.stated_goals for number in goal.objects} - unplaced_objects(task)
    astray = [other for other in loose if other not in settled]
    return sorted(astray, key=lambda other: other not in members and _is_wholly_in_region(other, region, view))


def _objects_in_region(region: Region, number: int, view: SceneView) -> list[int]:
    """The other solid objects that reach into a region."""
    return [
        other
        for other in view.object_ids
        if other != number
        and view.object_model(other).colliders
        and signed_outline_gaps(view.object_prism(other).outline, region.corner_points, np.zeros((1, 2)))[0] < -0.002
    ]


def _is_wholly_in_region(number: int, region: Region, view: SceneView) -> bool:
    """Whether an object lies wholly in a region."""
    return bool(
        margins_inside_outline(view.object_prism(number).outline, region.corner_points, np.zeros((1, 2)))[0] > -0.01
    )
