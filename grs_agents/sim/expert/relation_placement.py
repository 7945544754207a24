"""Placement planning for typed goals: spots at which the goal's own definition holds."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.expert.zone_packing import (
    find_occupied_zone_target,
    pack_objects_into_zone,
    yaw_turns_to_try,
    zone_to_region,
)
from grs_agents.sim.goals.planning_scene import OVERLAP, PlanningScene, describe_tilt, has_toppled, make_oracle_stop
from grs_agents.sim.goals.relation_rules import (
    explain_goal_shortfalls,
    explain_object_shortfall,
    object_footprint_as_zone,
)
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.motion.placement import (
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
from grs_agents.sim.world.footprints import rest_heights_at_offsets, signed_outline_gaps

_GAPS: Final = (0.015, 0.006, 0.003)
_MARGIN: Final = 0.3
"""Safety margin, as a share of the distance of a ``near`` goal."""
_BESIDE: Final = 0.03
"""Gap between the objects of a line without a spacing of its own, metres."""
_ARRIVED: Final = 0.005
Offsets = npt.NDArray[np.bool_]


class RelationPlanner:
    """Chooses spots for typed goals; remembers the positions of a line."""

    def __init__(self) -> None:
        self._lines: dict[Goal, dict[int, tuple[float, float]]] = {}

    def choose_target(self, goal: Goal, row: int, task: ScoredTask, scene: PlanningScene, lift: float) -> Target:
        """Target of the object of a row of a typed goal, or the reason for none; arguments as in `Planner`."""
        number = goal.objects[row]
        if goal.relation_kind == "upright" or has_toppled(number, scene, task.rot_eps):
            name, tilt = scene.object_label(number), describe_tilt(number, scene)
            detail = f"{name} has tipped over or lies: {tilt}; a tool that points down cannot right it"
            return Stop("toppled", detail, (scene.object_name(number),))
        if goal.relation_kind == "stacked":
            below = goal.objects[goal.objects.index(number) - 1]
            center = (scene.object_pose(below)[0][0], scene.object_pose(below)[0][1])
            turn = wrap_angle(scene.object_yaw(below) - scene.object_yaw(number), np.pi / 2)
            spots = [_rest_spot_at_point(center, angle, number, scene) for angle in (turn, 0.0)]
            target = _choose_first_valid_spot(iter(spots), goal, number, task, scene, lift)
            if isinstance(target, Spot) or target.outcome == "unreachable":
                return target
            blocker = _find_blocker_at_spot(spots[0], number, scene, below)
            if blocker is None:
                return target
            return BlockedTarget(blocker, (predict_scene_after_placing(spots[0], number, scene).object_prism(number),))
        if goal.relation_kind == "aligned":
            return self._choose_line_target(goal, number, task, scene, lift)
        if goal.relation_kind == "near":
            beside = _candidate_spots_beside(goal, number, scene, lift)
            return _choose_first_valid_spot(beside, goal, number, task, scene, lift)
        return _choose_spot_on_reference(goal, number, task, scene, lift)

    def goal_rows_to_move(self, goal: Goal, scene: PlanningScene) -> list[int]:
        """Rows of a ``stacked`` or ``aligned`` goal whose objects must move, in order."""
        if goal.relation_kind == "stacked":
            levels = range(1, len(goal.objects))
            return [level for level in levels if explain_object_shortfall(goal, goal.objects[level], scene)]
        planned = self._lines.get(goal, {})
        return [
            row
            for row, number in enumerate(goal.objects)
            if number not in planned or math.dist(planned[number], scene.object_pose(number)[0][:2]) > _ARRIVED
        ]

    def _choose_line_target(
        self, goal: Goal, number: int, task: ScoredTask, scene: PlanningScene, lift: float
    ) -> Target:
        """Target on a line planned for all objects of the goal, once for the episode."""
        plan = self._lines.get(goal) or _plan_line_positions(goal, scene, lift)
        if plan is None:
            detail = f"no free line within reach for {len(goal.objects)} objects"
            return make_oracle_stop("no_free_space", detail, scene, *goal.objects)
        self._lines[goal] = plan
        spot = _rest_spot_at_point(plan[number], 0.0, number, scene)
        blocker = _find_blocker_at_spot(spot, number, scene)
        if blocker is not None:
            return BlockedTarget(blocker, (predict_scene_after_placing(spot, number, scene).object_prism(number),))
        placed = {other: _object_pose_at_spot(Spot(plan[other], 0.0, 0.0), other, scene) for other in goal.objects}
        clauses = explain_goal_shortfalls(goal, scene.copy_with_object_poses(placed), task.rot_eps)
        for other, clause in zip(goal.objects, clauses, strict=True):
            if clause:
                return _explain_no_valid_spot(goal, number, scene, f"{scene.object_label(other)} {clause}")
        return spot if _is_spot_reachable(spot, scene, lift) else _explain_unreachable_spot(number, spot, scene, lift)


def predict_scene_after_placing(spot: Spot, number: int, scene: PlanningScene) -> PlanningScene:
    """The scene with an object moved to a spot."""
    return scene.copy_with_object_poses({number: _object_pose_at_spot(spot, number, scene)})


def _object_pose_at_spot(spot: Spot, number: int, scene: PlanningScene) -> Pose:
    (_, _, z), rotation = scene.object_pose(number)
    about = ((0.0, 0.0, 0.0), transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, spot.turn)))
    turned = transforms.compose_poses(about, ((0.0, 0.0, 0.0), rotation))[1]
    x, y = spot.center
    return (x, y, spot.height + z - scene.object_prism(number).low), transforms.to_unit_quaternion(turned)


def _choose_first_valid_spot(
    spots: Iterator[Spot], goal: Goal, number: int, task: ScoredTask, scene: PlanningScene, lift: float
) -> Spot | Stop:
    """The first reachable spot at which the goal's definition holds, else the reason for none."""
    far, why = None, ""
    for spot in spots:
        if not _is_spot_reachable(spot, scene, lift):
            far = far or spot
            continue
        clause = explain_object_shortfall(goal, number, predict_scene_after_placing(spot, number, scene), task.rot_eps)
        if not clause:
            return spot
        why = why or f"{scene.object_label(number)} {clause}"
    if far:
        return _explain_unreachable_spot(number, far, scene, lift)
    return _explain_no_valid_spot(goal, number, scene, why)


def _is_spot_reachable(spot: Spot, scene: PlanningScene, lift: float) -> bool:
    return bool(ReachTest(lift, scene.arm)(np.array([spot.center]), np.array([spot.height]))[0])


def _explain_unreachable_spot(number: int, spot: Spot, scene: PlanningScene, lift: float) -> Stop:
    tip = (*spot.center, spot.height + lift)
    place = f"target of {scene.object_label(number)} at {format_point(tip)}"
    return make_oracle_stop("unreachable", f"{place} {describe_out_of_reach(tip, scene.arm)}", scene, number)


def _explain_no_valid_spot(goal: Goal, number: int, scene: PlanningScene, why: str) -> Stop:
    """The stop without a valid spot; ``why`` is the shortfall at the best spot, "" if none is free."""
    references = goal.mentioned_object_ids[len(goal.objects) :]
    reference = "".join(f" {scene.object_label(other)}" for other in references)
    wanted = f"{scene.object_label(number)} would be {str(goal.relation_kind).replace('_', ' ')}{reference}"
    if goal.relation_kind == "inside" and "not below the rim" in why:
        width, depth = scene.object_extent_xy(number)
        small = f"{reference.strip()} is too small for {scene.object_label(number)} ({width:.3f} x {depth:.3f} m)"
        detail = f"{small}: on its walls or its rim {why}"
        return make_oracle_stop("target_too_small", detail, scene, number, goal.reference_id)
    words = f"at no spot {wanted}; at the best one {why}" if why else f"no spot at which {wanted} is free"
    return make_oracle_stop("target_occupied", words, scene, number)


def _rest_spot_at_point(center: tuple[float, float], turn: float, number: int, scene: PlanningScene) -> Spot:
    """Spot of an object that is lowered at a point until contact."""
    shape = rotated_outline_at_origin(scene.object_prism(number), np.asarray(scene.object_pose(number)[0][:2]), turn)
    height = rest_heights_at_offsets(shape, scene.prisms_of_other_objects(number), np.array([center]), OVERLAP)
    return Spot(center, turn, float(height[0]))


def _find_blocker_at_spot(spot: Spot, number: int, scene: PlanningScene, below: int = -1) -> int | None:
    """Id of a movable carrier of an object at a spot, other than ``below``; None without any."""
    shape = rotated_outline_at_origin(
        scene.object_prism(number), np.asarray(scene.object_pose(number)[0][:2]), spot.turn
    )
    owners = [
        prism.owner
        for prism in scene.prisms_of_other_objects(number, below)
        if prism.high > spot.height - 0.003
        and scene.may_robot_move(prism.owner)
        and signed_outline_gaps(shape.outline, prism.outline, np.array([spot.center]))[0] < OVERLAP
    ]
    return owners[0] if owners and spot.height > 0.003 else None


def _choose_spot_on_reference(goal: Goal, number: int, task: ScoredTask, scene: PlanningScene, lift: float) -> Target:
    """Target in a container, on a support or in a zone: packed with the other members, with the most clearance."""
    zone = object_footprint_as_zone(goal.reference_id, scene)
    unplaced = [
        member
        for stated in task.goals
        if stated.has_same_relation(goal)
        for member in stated.objects
        if explain_object_shortfall(stated, member, scene, task.rot_eps)
    ]
    members = [number, *(member for member in dict.fromkeys(unplaced) if member != number)]
    plan = pack_objects_into_zone(zone, members, scene, lift, goal.reference_id)
    candidates = _candidate_reference_spots(plan.get(number), goal, number, scene, lift)
    target = _choose_first_valid_spot(candidates, goal, number, task, scene, lift)
    if isinstance(target, Spot):
        return target
    reason = find_occupied_zone_target(zone, number, members, task, scene, lift, goal.reference_id)
    if isinstance(reason, Spot):
        return _choose_first_valid_spot(iter([reason]), goal, number, task, scene, lift)
    return reason


def _candidate_reference_spots(
    packed: Spot | None, goal: Goal, number: int, scene: PlanningScene, lift: float
) -> Iterator[Spot]:
    """Spots by preference: as packed; in the middle with clearance; at the centre, however the object rests there."""
    if packed is not None:
        yield packed
    region = zone_to_region(object_footprint_as_zone(goal.reference_id, scene))
    body, center = scene.object_prism(number), scene.object_pose(number)[0]
    obstacles, suits = scene.obstacles_to_plan_around([number], [goal.reference_id]), ReachTest(lift, scene.arm)
    turns = yaw_turns_to_try(number, region, scene)
    for gap in _GAPS:
        spot = find_free_spot(body, center, turns, region, obstacles, gap, suits, spread=True)
        if spot is not None:
            yield spot
    if goal.relation_kind != "inside":
        for turn in turns:
            yield _rest_spot_at_point(region.center, turn, number, scene)


def _candidate_spots_beside(goal: Goal, number: int, scene: PlanningScene, lift: float) -> Iterator[Spot]:
    """Free spots around the reference, within the required distance."""
    other, bound = scene.object_prism(goal.reference_id), goal.required_distance or 0.0
    body, center = scene.object_prism(number), scene.object_pose(number)[0]
    obstacles = scene.obstacles_to_plan_around([number], scene.object_ids)
    x0, y0, x1, y1 = other.bounding_box_xy
    for turn in (0.0, wrap_angle(scene.object_yaw(goal.reference_id) - scene.object_yaw(number), np.pi / 2), np.pi / 2):
        shape = rotated_outline_at_origin(body, np.asarray(center[:2]), turn)
        reach = 2 * (float(np.abs(shape.outline).max()) + bound)
        region = Region(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0 + 2 * reach, y1 - y0 + 2 * reach), 0.0)
        for share in (_MARGIN, 0.1):
            suits = _make_max_gap_test(shape.outline, other.outline, (1 - share) * bound, ReachTest(lift, scene.arm))
            for gap in (0.01, 0.004):
                clear = min(gap, 0.5 * bound)
                spot = find_free_spot(body, center, [turn], region, obstacles, clear, suits, spread=True, near=center)
                if spot is not None:
                    yield spot


def _make_max_gap_test(
    shape: FloatArray, other: FloatArray, bound: float, suits: Callable[[FloatArray, FloatArray], Offsets]
) -> Callable[[FloatArray, FloatArray], Offsets]:
    """Reach test that also bounds the gap between two outlines, metres."""

    def around(offsets: FloatArray, heights: FloatArray) -> Offsets:
        return (signed_outline_gaps(shape, other, offsets) < bound) & suits(offsets, heights)

    return around


def _plan_line_positions(goal: Goal, scene: PlanningScene, lift: float) -> dict[int, tuple[float, float]] | None:
    """Free positions for all objects on a line across the table, in the order of their y."""
    objects = sorted(goal.objects, key=lambda number: scene.object_pose(number)[0][1])
    widths = [
        max(scene.object_prism(number).bounding_box_xy[3] - scene.object_prism(number).bounding_box_xy[1], 0.01)
        for number in objects
    ]
    least = max((first + second) / 2 for first, second in pairwise(widths)) + _BESIDE
    step = goal.required_distance or least
    places = (np.arange(len(objects)) - (len(objects) - 1) / 2) * step
    obstacles = scene.obstacles_to_plan_around(objects)
    bounds = scene.bounds
    middle = np.mean([scene.object_pose(number)[0][:2] for number in objects], axis=0)
    xs, ys = np.arange(bounds[0, 0], bounds[0, 1], 0.02), np.arange(bounds[1, 0], bounds[1, 1], 0.02)
    centers = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    for axis in ((0.0, 1.0), (1.0, 0.0)):
        good = np.ones(len(centers), dtype=bool)
        for number, place in zip(objects, places, strict=True):
            shape = rotated_outline_at_origin(
                scene.object_prism(number), np.asarray(scene.object_pose(number)[0][:2]), 0.0
            )
            offsets = centers + place * np.asarray(axis)
            heights = rest_heights_at_offsets(shape, obstacles, offsets, 0.01)
            inside = ((offsets >= bounds[:2, 0]) & (offsets <= bounds[:2, 1])).all(axis=1)
            good &= inside & (heights < 0.002) & ReachTest(lift, scene.arm)(offsets, heights)
        if good.any():
            best = centers[good][np.linalg.norm(centers[good] - middle, axis=1).argmin()]
            spots = best + places[:, None] * np.asarray(axis)
            return {number: (float(x), float(y)) for number, (x, y) in zip(objects, spots, strict=True)}
    return None
