"""Where the oracle puts an object that a ``pose`` goal speaks of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.expert.zone_packing import unplaced_objects
from grs_agents.sim.goals.scene_view import SceneView, describe_unmovables, is_placement_stable, make_oracle_stop
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.motion.placement import (
    TALLEST_STACK,
    BlockedTarget,
    FloatArray,
    ReachTest,
    Spot,
    Target,
    describe_out_of_reach,
    format_point,
    rotated_outline_at_origin,
    wrap_angle,
)
from grs_agents.sim.world.footprints import (
    Prism,
    find_nearby_prisms,
    margins_inside_outline,
    rest_height_of_prisms,
    rotation_matrix_2d,
    signed_outline_gaps,
)

_ROOM: Final = 0.002
"""Room that neighbours are given, metres: blocks at targets one width apart do not jam."""
_FLAT, _LOOSE = 0.006, 0.02
"""How much higher than its target asks an object may come to rest, metres: on the table, and on other things, whose
heights programs know less well."""
_STEP: Final = 0.005
"""Rest heights that differ by less than this are one, metres."""
_BESIDE: Final = 0.003
"""Nearer than this, what is put down shoves what stands there, metres."""
_NUDGE: Final = 0.0045
"""How far from its target an object may be put to that end, metres."""
_AROUND, _LEVEL = 0.2, 0.015
"""Targets within this of each other, level by level, are spread together, metres."""


def choose_pose_target(goal: Goal, row: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
    """The best of the target poses that will do for an object."""
    number = goal.objects[row]
    pose = view.object_pose(number)
    allowed = goal.allowed_target_indices(row)
    free = (
        allowed if goal.replace else [index for index in allowed if not _is_target_taken(goal, index, row, task, view)]
    )
    free.sort(key=lambda index: (round(goal.targets[index][0][2], 3), _planar_distance(goal.targets[index], pose)))
    reasons: list[Target] = []
    for index in free or allowed:
        target = _plan_placement_at_target(goal, index, row, task, view, lift)
        if isinstance(target, Spot):
            return target
        reasons.append(target)
    blocked = [reason for reason in reasons if isinstance(reason, BlockedTarget)]
    if blocked:
        return blocked[0]
    return (
        reasons[0]
        if reasons
        else make_oracle_stop(
            "error",
            f"no target pose matches {view.object_label(number)}: its row of matches is all zeros",
            view,
            number,
        )
    )


def _planar_distance(target: Pose, pose: Pose) -> float:
    return float(np.hypot(target[0][0] - pose[0][0], target[0][1] - pose[0][1]))


def _is_target_taken(goal: Goal, index: int, row: int, task: ScoredTask, view: SceneView) -> bool:
    return any(
        other != row
        and goal.matches[other][index]
        and task.is_match(view.object_pose(number), goal.targets[index], goal.symmetries[other])
        for other, number in enumerate(goal.objects)
    )


def _plan_placement_at_target(
    goal: Goal, index: int, row: int, task: ScoredTask, view: SceneView, lift: float
) -> Target:
    target, number = goal.targets[index], goal.objects[row]
    pose, body = view.object_pose(number), view.object_prism(number)
    others = view.prisms_of_other_objects(number)
    wanted = max(0.0, target[0][2] - (pose[0][2] - body.low))
    fit = _find_lowest_stable_fit(number, target, goal.symmetries[row], wanted, task, view)
    height, angle, offset = fit.height, fit.angle, fit.offset
    spot = Spot((float(offset[0, 0]), float(offset[0, 1])), angle, height)
    tip = (*spot.center, height + lift)
    if not ReachTest(lift, view.arm)(offset, np.array([height]))[0]:
        place = f"target of {view.object_label(number)} at {format_point(target[0])}"
        return make_oracle_stop("unreachable", f"{place} {describe_out_of_reach(tip, view.arm)}", view, number)
    shape = rotated_outline_at_origin(body, np.asarray(pose[0][:2]), angle)
    keep_free = (Prism(shape.outline + offset, 0.0, 1.0, number),)
    too_high = height > wanted + (_LOOSE if wanted > _FLAT else _FLAT)
    below = _objects_holding_up(shape, offset, others, height) if too_high else []
    staying = [other for other in below if view.is_bystander(other)]
    if staying:
        taken = f"target of {view.object_label(number)} at {format_point(target[0])} is occupied"
        return make_oracle_stop(
            "target_occupied", f"{taken} by {describe_unmovables(staying, view)}", view, number, *staying
        )
    for other in below:
        if view.is_object_movable(other) and not _may_rest_on_blocker(other, number, shape, target, height, task, view):
            return BlockedTarget(other, keep_free)
    tight = _find_conflicting_neighbour(number, fit, target, task, view)
    return spot if tight is None else BlockedTarget(tight, keep_free, spot)


@dataclass(frozen=True)
class _Fit:
    """A way to put an object."""

    angle: float  # it is turned by, radians
    parts: list[Prism]
    offset: FloatArray  # of its parts, (1, 2)
    height: float
    stands: bool = True  # whether it does not tip there


def _find_lowest_stable_fit(
    number: int, target: Pose, symmetry: float, wanted: float, task: ScoredTask, view: SceneView
) -> _Fit:
    """The turn with which an object comes to rest lowest, and does not tip."""
    others, center = view.prisms_of_other_objects(number), np.asarray(view.object_pose(number)[0][:2])
    company = [*others, *_predict_neighbour_prisms(number, target, task, view)]
    mass = _center_of_mass_offset(number, view)

    def fit(angle: float) -> _Fit:
        parts = [rotated_outline_at_origin(part, center, angle) for part in view.collider_prisms(number)]
        offset = _find_clear_offset(parts, target, company, task)
        return _Fit(angle, parts, offset, max(0.0, rest_height_of_prisms(parts, others, offset, -0.0005)))

    def stands(option: _Fit) -> bool:
        parts = [Prism(part.outline + option.offset, part.low, part.high) for part in option.parts]
        return is_placement_stable(
            parts, option.height, option.offset[0] + rotation_matrix_2d(option.angle) @ mass, others
        )

    options = [fit(angle) for angle in _allowed_yaw_turns(target, number, symmetry, view)]
    if min(option.height for option in options) > wanted + _STEP:
        options += [fit(angle) for angle in _yaw_turns_along_support(target, number, symmetry, view)]
    options.sort(key=lambda option: round(option.height / _STEP))
    return next(filter(stands, options), replace(options[0], stands=False))


def _center_of_mass_offset(number: int, view: SceneView) -> FloatArray:
    """Where (2,) the centre of mass of an object lies from its origin, seen from above as it stands."""
    volume, (position, rotation) = view.object_volume(number), view.object_pose(number)
    center = volume.points @ volume.weights
    return transforms.transform_points((position, rotation), center[:, None])[:2, 0] - np.asarray(position[:2])


def _allowed_yaw_turns(target: Pose, number: int, symmetry: float, view: SceneView) -> list[float]:
    """Turns (rad) that the target allows: along it rather than askew, so that neighbours find room."""
    asked = transforms.yaw_of_quaternion(target[1]) - view.object_yaw(number)
    if symmetry > 0:
        return [wrap_angle(asked, symmetry)]
    if all(shape.kind in ("cylinder", "sphere") for shape in view.object_model(number).colliders):
        return [0.0]
    return [*_angles_at_quarter_turns(asked), 0.0]


def _yaw_turns_along_support(target: Pose, number: int, symmetry: float, view: SceneView) -> list[float]:
    """Turns (rad) along what stands at the target, however that lies by now, if the target allows any."""
    hosts = [
        view.object_yaw(other) - view.object_yaw(number)
        for other in view.object_ids
        if other != number and view.object_model(other).colliders and view.is_point_over_object(other, target[0])
    ]
    return [turn for host in hosts for turn in _angles_at_quarter_turns(host)] if symmetry <= 0 else []


def _angles_at_quarter_turns(angle: float) -> list[float]:
    return [wrap_angle(wrap_angle(angle, np.pi / 2) + quarter * np.pi / 2) for quarter in range(4)]


def _predict_neighbour_prisms(number: int, target: Pose, task: ScoredTask, view: SceneView) -> list[Prism]:
    """Objects as they will stand at targets around this one: whoever comes first leaves them room."""
    neighbours: list[Prism] = []
    for goal in task.goals:
        for index, place in enumerate(goal.targets):
            rows = [row for row, other in enumerate(goal.objects) if goal.matches[row][index] and other != number]
            if rows and place is not target and _planar_distance(place, target) < _AROUND:
                other = goal.objects[rows[0]]
                body = view.object_prism(other)
                angle = wrap_angle(transforms.yaw_of_quaternion(place[1]) - view.object_yaw(other), np.pi / 2)
                shape = rotated_outline_at_origin(body, np.asarray(view.object_pose(other)[0][:2]), angle)
                low = place[0][2] - (body.high - body.low) / 2
                neighbours.append(Prism(shape.outline + place[0][:2], low, low + body.high - body.low, other))
    return neighbours


def _shift_target_outward(target: Pose, task: ScoredTask) -> FloatArray:
    """Where (2,) a target would be if those around it, on its level, were drawn apart by what tolerance allows."""
    places = [place for goal in task.goals for place in goal.targets if abs(place[0][2] - target[0][2]) < _LEVEL]
    around = np.array(
        [place[0][:2] for place in places if _planar_distance(place, target) < _AROUND] or [target[0][:2]]
    )
    middle = np.asarray(target[0][:2]) - around.mean(axis=0)
    reach = float(np.linalg.norm(around - around.mean(axis=0), axis=1).max())
    return np.asarray(target[0][:2]) + middle * _NUDGE / max(reach, 20 * _NUDGE)


def _find_clear_offset(body: Sequence[Prism], target: Pose, obstacles: Sequence[Prism], task: ScoredTask) -> FloatArray:
    """The target's (1, 2) or a point within half its tolerance that is clearer of what stands as high, metres."""
    center = np.array([[target[0][0], target[0][1]]])
    half = (max(part.high for part in body) - min(part.low for part in body)) / 2
    level = [
        prism for prism in obstacles if prism.high > target[0][2] + 0.003 - half and prism.low < target[0][2] + half
    ]
    beside = [
        (part.outline, prism.outline)
        for part in body
        for prism in find_nearby_prisms(part, level, center[0].tolist(), _ROOM)
        if -_ROOM - 2 * _NUDGE < signed_outline_gaps(part.outline, prism.outline, center)[0] < _ROOM
    ]
    if not beside:
        return center
    steps = np.linspace(-1, 1, 7) * min(_NUDGE, task.pos_eps / 2)
    offsets = center + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    room = np.min([signed_outline_gaps(part, other, offsets) for part, other in beside], axis=0)
    cost = np.linalg.norm(offsets - _shift_target_outward(target, task), axis=1) - 10 * np.minimum(room, _ROOM / 2)
    return offsets[[int(np.argmin(cost))]]


def _objects_holding_up(shape: Prism, offset: FloatArray, others: Sequence[Prism], height: float) -> list[int]:
    """Ids of what an object at a height (m) would rest on."""
    top = [
        prism.owner
        for prism in others
        if prism.high > height - 0.005 and signed_outline_gaps(shape.outline, prism.outline, offset)[0] < -0.0005
    ]
    return list(dict.fromkeys(top))


def _find_conflicting_neighbour(number: int, fit: _Fit, target: Pose, task: ScoredTask, view: SceneView) -> int | None:
    """What is to be moved anyway and would be shoved, or would tip the object off; None if nothing does."""
    waiting = unplaced_objects(task) - {number}
    up = fit.height - min(part.low for part in fit.parts)
    standing = [prism for prism in view.prisms if prism.owner in waiting and prism.high > fit.height - _STEP]
    for part in fit.parts:
        for prism in find_nearby_prisms(part, standing, fit.offset[0].tolist(), _BESIDE):
            gap = signed_outline_gaps(part.outline, prism.outline, fit.offset)[0]
            shoved = (
                gap < _BESIDE
                and _is_part_level_with_prism(part, up, prism, fit)
                and not view.is_point_over_object(prism.owner, target[0])
            )
            if shoved or _would_tip_off_prism(part, up, prism, fit, gap):
                return prism.owner
    return None


def _would_tip_off_prism(part: Prism, up: float, prism: Prism, fit: _Fit, gap: float) -> bool:
    """Whether an object that does not stand would come to lie half on another's prism, ``gap`` (m) away from it."""
    return not fit.stands and gap < -0.0005 and abs(prism.high - part.low - up) < _STEP


def _is_part_level_with_prism(part: Prism, up: float, prism: Prism, fit: _Fit) -> bool:
    """Whether a part of an object that is lifted by ``up`` (m) stands level with another object's prism."""
    return prism.low < part.high + up and prism.high > max(part.low + up, fit.height + 0.003)


def _may_rest_on_blocker(
    blocker: int, number: int, shape: Prism, target: Pose, height: float, task: ScoredTask, view: SceneView
) -> bool:
    """Whether to stand an object on, or in, what is at its target: that is meant to be there, and can hold it."""
    there = any(_planar_distance(place, target) < task.pos_eps for place in _intended_object_poses(blocker, view))
    if view.is_object_hollow(blocker):
        held = margins_inside_outline(shape.outline, view.object_prism(blocker).outline, np.array([target[0][:2]]))[0]
        return (there or bool(held > 0)) and blocker not in unplaced_objects(task) - {number}
    if not there or height + (shape.high - shape.low) >= TALLEST_STACK:
        return False
    center = np.array([[target[0][0], target[0][1]]])
    tops = [prism.outline for prism in view.prisms if prism.owner == blocker and prism.high > height - 0.003]
    return any(
        float(np.ptp(top, axis=0).min()) > 0.025 and margins_inside_outline(np.zeros((1, 2)), top, center)[0] > 0.01
        for top in tops
    )


def _intended_object_poses(number: int, view: SceneView) -> list[Pose]:
    """Where goals want an object; where it stood at the start if no goal speaks of it, unless it is a ball."""
    places: list[Pose] = []
    for goal in view.stated_goals:
        if number in goal.objects:
            allowed = goal.allowed_target_indices(goal.objects.index(number))
            places += (
                [goal.targets[index] for index in allowed]
                if goal.metric == "pose"
                else [zone.pose for zone in goal.zones]
            )
    # What stays where it is, and whose very place is the target, is what the object is to stand on.
    ball = any(shape.kind == "sphere" for shape in view.object_model(number).colliders)
    spoken_of = any(number in goal.mentioned_object_ids for goal in view.stated_goals)
    if not ball and not spoken_of and number in view.places:
        places.append(view.places[number])
    return places
