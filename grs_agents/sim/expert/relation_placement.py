"""Where the oracle puts the objects of typed goals: spots at which the goal's own definition says that it holds."""

import math
from collections.abc import Callable, Iterator, Sequence
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
from grs_agents.sim.goals.relation_rules import (
    explain_goal_shortfalls,
    explain_object_shortfall,
    object_footprint_as_zone,
)
from grs_agents.sim.goals.scene_view import SceneView, describe_tilt, has_toppled, make_oracle_stop
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
from grs_agents.sim.world.footprints import Prism, rest_heights_at_offsets, signed_outline_gaps

_GAPS: Final = (0.015, 0.006, 0.003)
_MARGIN: Final = 0.3
"""Share of the distance of a ``near`` goal that is kept in hand."""
_BESIDE: Final = 0.03
"""Free space between the objects of a line without a spacing of its own, metres."""
_ARRIVED: Final = 0.005
Offsets = npt.NDArray[np.bool_]


class RelationPlanner:
    """Chooses spots for typed goals; remembers the places of a line."""

    def __init__(self) -> None:
        self._lines: dict[Goal, dict[int, tuple[float, float]]] = {}

    def choose_target(self, goal: Goal, row: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
        """Where the object of one row of a typed goal should go, or why nowhere; arguments as `Planner` takes them."""
        number = goal.objects[row]
        if goal.relation_kind == "upright" or has_toppled(number, view, task.rot_eps):
            return _explain_toppled_object(number, view)
        if goal.relation_kind == "stacked":
            return _choose_stack_target(goal.objects[goal.objects.index(number) - 1], goal, number, task, view, lift)
        if goal.relation_kind == "aligned":
            return self._choose_line_target(goal, number, task, view, lift)
        if goal.relation_kind == "near":
            return _choose_first_valid_spot(
                _candidate_spots_beside(goal, number, view, lift), goal, number, task, view, lift
            )
        return _choose_spot_on_reference(goal, number, task, view, lift)

    def goal_rows_to_move(self, goal: Goal, view: SceneView) -> list[int]:
        """Rows of a ``stacked`` or ``aligned`` goal whose objects must move, in the order in which they must."""
        if goal.relation_kind == "stacked":
            levels = range(1, len(goal.objects))
            return [level for level in levels if explain_object_shortfall(goal, goal.objects[level], view)]
        planned = self._lines.get(goal, {})
        return [
            row
            for row, number in enumerate(goal.objects)
            if number not in planned or math.dist(planned[number], view.object_pose(number)[0][:2]) > _ARRIVED
        ]

    def _choose_line_target(self, goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
        plan = self._lines.get(goal) or _plan_line_positions(goal, view, lift)
        if plan is None:
            detail = f"no free line within reach for {len(goal.objects)} objects"
            return make_oracle_stop("no_free_space", detail, view, *goal.objects)
        self._lines[goal] = plan
        spot = _rest_spot_at_point(plan[number], 0.0, number, view)
        blocker = _find_blocker_at_spot(spot, number, view)
        if blocker is not None:
            return BlockedTarget(blocker, (_object_prism_at_spot(number, spot, view),))
        placed = {other: _object_pose_at_spot(Spot(plan[other], 0.0, 0.0), other, view) for other in goal.objects}
        clauses = explain_goal_shortfalls(goal, view.copy_with_object_poses(placed), task.rot_eps)
        for other, clause in zip(goal.objects, clauses, strict=True):
            if clause:
                return _explain_no_valid_spot(goal, number, view, f"{view.object_label(other)} {clause}")
        return spot if _is_spot_reachable(spot, view, lift) else _explain_unreachable_spot(number, spot, view, lift)


def predict_view_after_placing(spot: Spot, number: int, view: SceneView) -> SceneView:
    """The scene once an object has been put at a spot."""
    return view.copy_with_object_poses({number: _object_pose_at_spot(spot, number, view)})


def _object_pose_at_spot(spot: Spot, number: int, view: SceneView) -> Pose:
    (_, _, z), rotation = view.object_pose(number)
    about = ((0.0, 0.0, 0.0), transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, spot.turn)))
    turned_by = transforms.compose_poses(about, ((0.0, 0.0, 0.0), rotation))[1]
    return (
        spot.center[0],
        spot.center[1],
        spot.height + z - view.object_prism(number).low,
    ), transforms.to_unit_quaternion(turned_by)


def _choose_first_valid_spot(
    spots: Iterator[Spot], goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float
) -> Spot | Stop:
    """The first spot within reach at which the goal's definition holds."""
    far, why = None, ""
    for spot in spots:
        if not _is_spot_reachable(spot, view, lift):
            far = far or spot
            continue
        clause = explain_object_shortfall(goal, number, predict_view_after_placing(spot, number, view), task.rot_eps)
        if not clause:
            return spot
        why = why or f"{view.object_label(number)} {clause}"
    if far:
        return _explain_unreachable_spot(number, far, view, lift)
    return _explain_no_valid_spot(goal, number, view, why)


def _is_spot_reachable(spot: Spot, view: SceneView, lift: float) -> bool:
    return bool(ReachTest(lift, view.arm)(np.array([spot.center]), np.array([spot.height]))[0])


def _explain_unreachable_spot(number: int, spot: Spot, view: SceneView, lift: float) -> Stop:
    tip = (*spot.center, spot.height + lift)
    place = f"target of {view.object_label(number)} at {format_point(tip)}"
    return make_oracle_stop("unreachable", f"{place} {describe_out_of_reach(tip, view.arm)}", view, number)


def _explain_no_valid_spot(goal: Goal, number: int, view: SceneView, why: str) -> Stop:
    """No spot will do; ``why`` is what is wrong with the best, "" if none is free."""
    other = "".join(f" {view.object_label(other)}" for other in goal.mentioned_object_ids[len(goal.objects) :])
    wanted = f"{view.object_label(number)} would be {str(goal.relation_kind).replace('_', ' ')}{other}"
    words = f"at no spot {wanted}; at the best one {why}" if why else f"no spot at which {wanted} is free"
    return make_oracle_stop("target_occupied", words, view, number)


def _object_prism_at_spot(number: int, spot: Spot, view: SceneView) -> Prism:
    return view.copy_with_object_poses({number: _object_pose_at_spot(spot, number, view)}).object_prism(number)


def _rest_spot_at_point(center: tuple[float, float], turn: float, number: int, view: SceneView) -> Spot:
    """Where an object comes to rest that is lowered at a point."""
    shape = rotated_outline_at_origin(view.object_prism(number), np.asarray(view.object_pose(number)[0][:2]), turn)
    height = rest_heights_at_offsets(shape, view.prisms_of_other_objects(number), np.array([center]), -0.0005)
    return Spot(center, turn, float(height[0]))


def _explain_toppled_object(number: int, view: SceneView) -> Stop:
    """An object that lies is not to be put anywhere as it stood."""
    words = (
        f"{view.object_label(number)} has tipped over or lies: {describe_tilt(number, view)}; a tool that points down"
    )
    return Stop("toppled", f"{words} cannot right it", (view.object_name(number),))


def _choose_stack_target(below: int, goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
    """Centred on what is below it, turned along with it; what stands there goes first."""
    center = (view.object_pose(below)[0][0], view.object_pose(below)[0][1])
    turn = wrap_angle(view.object_yaw(below) - view.object_yaw(number), np.pi / 2)
    spots = [_rest_spot_at_point(center, angle, number, view) for angle in (turn, 0.0)]
    target = _choose_first_valid_spot(iter(spots), goal, number, task, view, lift)
    if isinstance(target, Spot) or target.outcome == "unreachable":
        return target
    blocker = _find_blocker_at_spot(spots[0], number, view, below)
    return BlockedTarget(blocker, (_object_prism_at_spot(number, spots[0], view),)) if blocker is not None else target


def _find_blocker_at_spot(spot: Spot, number: int, view: SceneView, below: int = -1) -> int | None:
    """An object that may be moved, other than the one ``below``, that holds an object up at a spot."""
    shape = rotated_outline_at_origin(view.object_prism(number), np.asarray(view.object_pose(number)[0][:2]), spot.turn)
    owners = [
        prism.owner
        for prism in view.prisms_of_other_objects(number, below)
        if prism.high > spot.height - 0.003
        and view.may_robot_move(prism.owner)
        and signed_outline_gaps(shape.outline, prism.outline, np.array([spot.center]))[0] < -0.0005
    ]
    return owners[0] if owners and spot.height > 0.003 else None


def _choose_spot_on_reference(goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
    """In a container, on a support or in a zone: packed with its fellows, as clear of one another as fits."""
    zone = object_footprint_as_zone(goal.reference_id, view)
    members = [number, *(other for other in _unplaced_relation_members(goal, task, view) if other != number)]
    plan = pack_objects_into_zone(zone, members, view, lift, goal.reference_id)
    candidates = [plan[number]] if number in plan else []
    target = _choose_first_valid_spot(
        _candidate_reference_spots(candidates, goal, number, view, lift), goal, number, task, view, lift
    )
    if isinstance(target, Spot):
        return target
    reason = find_occupied_zone_target(zone, number, members, task, view, lift, goal.reference_id)
    if isinstance(reason, Spot):
        return _choose_first_valid_spot(iter([reason]), goal, number, task, view, lift)
    return reason


def _unplaced_relation_members(goal: Goal, task: ScoredTask, view: SceneView) -> list[int]:
    """Objects that goals still want there too, and are not there yet."""
    members: list[int] = []
    for other in task.goals:
        if other.has_same_relation(goal):
            members += [
                number for number in other.objects if explain_object_shortfall(other, number, view, task.rot_eps)
            ]
    return list(dict.fromkeys(members))


def _candidate_reference_spots(
    first: Sequence[Spot], goal: Goal, number: int, view: SceneView, lift: float
) -> Iterator[Spot]:
    """Spots by preference: as packed; clear in the middle; centred, however it rests there."""
    yield from first
    region = zone_to_region(object_footprint_as_zone(goal.reference_id, view))
    body, center = view.object_prism(number), view.object_pose(number)[0]
    turns = yaw_turns_to_try(number, region, view)
    for gap in _GAPS:
        spot = find_free_spot(
            body,
            center,
            turns,
            region,
            view.obstacles_to_plan_around([number], [goal.reference_id]),
            gap,
            ReachTest(lift, view.arm),
            spread=True,
        )
        if spot is not None:
            yield spot
    if goal.relation_kind != "inside":
        for turn in turns:
            yield _rest_spot_at_point(region.center, turn, number, view)


def _candidate_spots_beside(goal: Goal, number: int, view: SceneView, lift: float) -> Iterator[Spot]:
    """Free spots around the other object, at no more than the distance asked for."""
    other, bound = view.object_prism(goal.reference_id), goal.required_distance or 0.0
    body, center = view.object_prism(number), view.object_pose(number)[0]
    x0, y0, x1, y1 = other.bounding_box_xy
    for turn in (0.0, wrap_angle(view.object_yaw(goal.reference_id) - view.object_yaw(number), np.pi / 2), np.pi / 2):
        shape = rotated_outline_at_origin(body, np.asarray(center[:2]), turn)
        reach = 2 * (float(np.abs(shape.outline).max()) + bound)
        region = Region(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0 + 2 * reach, y1 - y0 + 2 * reach), 0.0)
        for share in (_MARGIN, 0.1):
            suits = _make_max_gap_test(shape.outline, other.outline, (1 - share) * bound, ReachTest(lift, view.arm))
            for gap in (0.01, 0.004):
                clear = min(gap, 0.5 * bound)
                spot = find_free_spot(
                    body,
                    center,
                    [turn],
                    region,
                    view.obstacles_to_plan_around([number], view.object_ids),
                    clear,
                    suits,
                    spread=True,
                    near=center,
                )
                if spot is not None:
                    yield spot


def _make_max_gap_test(
    shape: FloatArray, other: FloatArray, bound: float, suits: Callable[[FloatArray, FloatArray], Offsets]
) -> Callable[[FloatArray, FloatArray], Offsets]:
    def around(offsets: FloatArray, heights: FloatArray) -> Offsets:
        return (signed_outline_gaps(shape, other, offsets) < bound) & suits(offsets, heights)

    return around


def _plan_line_positions(goal: Goal, view: SceneView, lift: float) -> dict[int, tuple[float, float]] | None:
    """Free places for all objects on a line across the table, in the order in which they lie across it."""
    objects = sorted(goal.objects, key=lambda number: view.object_pose(number)[0][1])
    widths = [
        max(view.object_prism(number).bounding_box_xy[3] - view.object_prism(number).bounding_box_xy[1], 0.01)
        for number in objects
    ]
    least = max((first + second) / 2 for first, second in pairwise(widths)) + _BESIDE
    step = goal.required_distance or least
    places = (np.arange(len(objects)) - (len(objects) - 1) / 2) * step
    obstacles = view.obstacles_to_plan_around(objects)
    bounds = view.bounds
    middle = np.mean([view.object_pose(number)[0][:2] for number in objects], axis=0)
    xs, ys = np.arange(bounds[0, 0], bounds[0, 1], 0.02), np.arange(bounds[1, 0], bounds[1, 1], 0.02)
    centers = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    for axis in ((0.0, 1.0), (1.0, 0.0)):
        good = np.ones(len(centers), dtype=bool)
        for number, place in zip(objects, places, strict=True):
            shape = rotated_outline_at_origin(
                view.object_prism(number), np.asarray(view.object_pose(number)[0][:2]), 0.0
            )
            offsets = centers + place * np.asarray(axis)
            heights = rest_heights_at_offsets(shape, obstacles, offsets, 0.01)
            inside = ((offsets >= bounds[:2, 0]) & (offsets <= bounds[:2, 1])).all(axis=1)
            good &= inside & (heights < 0.002) & ReachTest(lift, view.arm)(offsets, heights)
        if good.any():
            best = centers[good][np.linalg.norm(centers[good] - middle, axis=1).argmin()]
            spots = best + places[:, None] * np.asarray(axis)
            return {number: (float(x), float(y)) for number, (x, y) in zip(objects, spots, strict=True)}
    return None
