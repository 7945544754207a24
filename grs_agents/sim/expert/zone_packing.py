"""Packing of objects into zones, containers and supports, clear of obstacles."""

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.planning_scene import PlanningScene, describe_unmovables, make_oracle_stop
from grs_agents.sim.goals.scores import MET
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
"""Clearances between neighbours in a zone, metres, tried from the largest."""
_SNUG: Final = 0.001
"""Least clearance with which an object still comes down beside another, metres."""


def zone_to_region(zone: Zone) -> Region:
    """The rectangle of a zone, seen from above."""
    (x, y, _), rotation = zone.pose
    return Region((x, y), zone.size[:2], transforms.yaw_of_quaternion(rotation))


def unplaced_zone_members(zone: Zone, task: ScoredTask) -> list[int]:
    """Objects that open goals want in a zone, not placed yet."""
    members: list[int] = []
    for goal in task.goals:
        if goal.metric == "zone" and zone in goal.zones:
            scores = task.grs.score_goal_objects(goal)
            members.extend(number for number, score in zip(goal.objects, scores, strict=True) if score < MET)
    return list(dict.fromkeys(members))


def unplaced_objects(task: ScoredTask) -> set[int]:
    """Objects of open goals that are not placed yet."""
    return {
        number
        for goal in task.goals
        for number, score in zip(goal.objects, task.grs.score_goal_objects(goal), strict=True)
        if score < MET
    }


def yaw_turns_to_try(number: int, region: Region, scene: PlanningScene) -> list[float]:
    """Turns (rad) to try: none for a round object, else along the sides of the region."""
    aligned = wrap_angle(region.yaw - scene.object_yaw(number), np.pi / 2)
    width, depth = scene.object_extent_xy(number)
    across = [wrap_angle(aligned + np.pi / 2, np.pi)] if abs(width - depth) > 0.002 else []
    round_ = all(shape.kind in ("cylinder", "sphere") for shape in scene.object_model(number).colliders)
    return [0.0] if round_ and scene.object_tilt(number) < 0.1 else [aligned, *across]


def pack_objects_into_zone(
    zone: Zone, members: Sequence[int], scene: PlanningScene, lift: float, host: int = -1
) -> dict[int, Spot]:
    """Spots for as many members as fit together, the first with priority; empty if it does not fit.

    ``host`` is the id of the container, support or mark that covers the zone, -1 for the bare table. Cached with
    everything that a packing depends on, since the episodes of a task begin alike.
    """
    key = (zone, tuple(members), lift, host, scene.arrangement)
    if key in scene.packings:
        cached: dict[int, Spot] = scene.packings[key]
        return cached
    region = zone_to_region(zone)
    first, rest = members[0], sorted(members[1:], key=lambda number: -float(np.prod(scene.object_extent_xy(number))))
    orders = [[first, *rest]]
    if (largest := sorted(members, key=lambda number: -float(np.prod(scene.object_extent_xy(number))))) != orders[0]:
        orders.append(largest)
    best: dict[int, Spot] = {}
    for gap, order in product(GAPS, orders):
        if len(best) == len(members):
            break
        plan = _pack_region_in_order(region, order, scene, lift, gap, host)
        if first in plan and len(plan) > len(best):
            best = plan
    scene.packings[key] = best
    return best


def _pack_region_in_order(
    region: Region, order: Sequence[int], scene: PlanningScene, lift: float, gap: float, host: int
) -> dict[int, Spot]:
    """Greedy packing: each object at the free spot that is left by those before it."""
    inner = Region(region.center, (region.size[0] - min(gap, 0.008), region.size[1] - min(gap, 0.008)), region.yaw)
    suits, alone = ReachTest(lift, scene.arm), len(order) == 1
    obstacles = scene.obstacles_to_plan_around(order, [host])
    plan: dict[int, Spot] = {}
    for number in order:
        body, center = scene.object_prism(number), scene.object_pose(number)[0]
        waiting = [other for other in order if other not in plan and other != number]
        standing = [*obstacles, *(prism.without_top for prism in scene.prisms if prism.owner in waiting)]
        turns = yaw_turns_to_try(number, region, scene)
        spot = find_free_spot(body, center, turns, inner, standing, gap, suits, spread=alone)
        if spot is None:
            continue
        plan[number] = spot
        shape = rotated_outline_at_origin(body, np.asarray(center[:2]), spot.turn)
        obstacles.append(Prism(shape.outline + np.asarray(spot.center), spot.height, spot.height + 1.0, number))
    return plan


def find_occupied_zone_target(
    zone: Zone, number: int, members: Sequence[int], task: ScoredTask, scene: PlanningScene, lift: float, host: int = -1
) -> Target:
    """Target in a zone without free room: a tight or stacked spot, a blocker to clear, or the reason for none.

    ``members`` are still wanted there; ``host`` is the id of the container, support or mark that covers the zone.
    """
    region = zone_to_region(zone)
    useless = _stop_if_region_unusable(region, number, scene, lift, host)
    if useless is not None:
        return useless
    inside = [other for other in _objects_in_region(region, number, scene) if other != host]
    settled = {member for goal in scene.stated_goals for member in goal.objects} - unplaced_objects(task)
    astray = [other for other in inside if scene.may_robot_move(other) and other not in settled]

    def is_lower_priority(other: int) -> bool:
        margins = margins_inside_outline(scene.object_prism(other).outline, region.corner_points, np.zeros((1, 2)))
        return other not in members and bool(margins[0] > -0.01)

    if astray:  # those over the edge first
        blocker = min(astray, key=is_lower_priority)
        return BlockedTarget(blocker, (Prism(region.corner_points, 0.0, 1.0, number),))
    # In a zone, members may carry each other; in a container the goal's own definition decides.
    fellows = {member for goal in scene.stated_goals if zone in goal.zones for member in goal.objects}
    body, center = scene.object_prism(number), scene.object_pose(number)[0]
    obstacles = scene.obstacles_to_plan_around([number], fellows if host < 0 else scene.object_ids)
    turns, suits = yaw_turns_to_try(number, region, scene), ReachTest(lift, scene.arm)
    for stack in (False, True):  # with hardly any clearance, then on top of a fellow
        spot = find_free_spot(body, center, turns, region, obstacles, _SNUG, suits, spread=True, stack=stack)
        if spot is not None and spot.height + body.high - body.low < TALLEST_STACK:
            return spot
    taken = f"it is occupied by {', '.join(map(scene.object_label, inside))}" if inside else "too little of it is free"
    detail = f"no room for {scene.object_label(number)} in {_describe_region(region, host, scene)}: {taken}"
    return make_oracle_stop("target_occupied", detail, scene, number, *inside)


def _stop_if_region_unusable(region: Region, number: int, scene: PlanningScene, lift: float, host: int) -> Stop | None:
    """The stop if an object has no room in a region even with all movable objects gone; None if it has."""
    name, body = scene.object_label(number), scene.object_prism(number)
    center, turns = scene.object_pose(number)[0], yaw_turns_to_try(number, region, scene)
    width, depth = scene.object_extent_xy(number)
    obstacles = scene.obstacles_to_plan_around([number], [host])
    kept = [prism for prism in obstacles if prism.owner == host or not scene.may_robot_move(prism.owner)]
    fixed = [prism for prism in kept if not scene.is_bystander(prism.owner)]

    def accept_all_offsets(offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        del heights
        return np.ones(len(offsets), dtype=bool)

    name_of_region, suits = _describe_region(region, host, scene), ReachTest(lift, scene.arm)
    if find_free_spot(body, center, turns, region, fixed, _SNUG, accept_all_offsets) is None:
        inner = ", its walls and what is fixed in it counted" if fixed else ""
        detail = f"{name_of_region} is too small for {name} ({width:.3f} x {depth:.3f} m){inner}"
        return make_oracle_stop("target_too_small", detail, scene, number)
    if find_free_spot(body, center, turns, region, fixed, _SNUG, suits) is None:
        where = f"{name_of_region} for {name} at {format_point((*region.center, 0.0))}"
        detail = f"{where} {describe_out_of_reach((*region.center, lift), scene.arm)}"
        return make_oracle_stop("unreachable", detail, scene, number)
    if find_free_spot(body, center, turns, region, kept, _SNUG, suits) is None:
        staying = [other for other in _objects_in_region(region, number, scene) if scene.is_bystander(other)]
        detail = f"no room for {name} in {name_of_region}: it is occupied by {describe_unmovables(staying, scene)}"
        return make_oracle_stop("target_occupied", detail, scene, number, *staying)
    return None


def _describe_region(region: Region, host: int, scene: PlanningScene) -> str:
    size = f"{region.size[0]:.3f} x {region.size[1]:.3f} m"
    return f"the target zone ({size})" if host < 0 else f"{scene.object_label(host)} ({size} outside)"


def _objects_in_region(region: Region, number: int, scene: PlanningScene) -> list[int]:
    """Ids of the other solid objects that reach into a region."""
    return [
        other
        for other in scene.object_ids
        if other != number
        and scene.object_model(other).colliders
        and signed_outline_gaps(scene.object_prism(other).outline, region.corner_points, np.zeros((1, 2)))[0] < -0.002
    ]
