"""Placement planning for ``pose`` goals: at the targets, turned and shifted to fit between neighbours."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.expert.zone_packing import unplaced_objects
from grs_agents.sim.goals.planning_scene import (
    OVERLAP,
    PlanningScene,
    describe_unmovables,
    is_placement_stable,
    is_target_tilted,
    make_oracle_stop,
)
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

TRIES: Final = 2
"""Tilted placements to try before placing upright, in case the arm cannot tilt so far."""


def find_tilted_place_pose(goal: Goal, row: int, task: ScoredTask, scene: PlanningScene, hold: Pose) -> Pose | None:
    """Pose of the tip that brings an object, held upright at ``hold``, to its nearest target with the target's tilt.

    None for goals with upright targets, and for tasks that place upright only.
    """
    if goal.metric != "pose" or not task.sixdof:
        return None
    pose = scene.object_pose(goal.objects[row])
    targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
    if not targets or not all(map(is_target_tilted, targets)):
        return None
    nearest = min(targets, key=lambda target: float(np.linalg.norm(np.subtract(target[0], pose[0]))))
    moved = transforms.compose_poses(nearest, transforms.invert_pose(pose))
    return transforms.compose_poses(moved, hold)


_ROOM: Final = 0.002
"""Clearance between neighbours, metres: blocks at targets a block's width apart do not jam."""
_FLAT, _LOOSE = 0.006, 0.02
"""How far above its target an object may come to rest, metres: on the table, and on other objects, whose heights
programs know less well."""
_STEP: Final = 0.005
"""Rest heights closer than this count as equal, metres."""
_BESIDE: Final = 0.003
"""Clearance below which placing an object shoves its neighbour, metres."""
_NUDGE: Final = 0.0045
"""Largest shift from the target to gain clearance, metres."""
_AROUND, _LEVEL = 0.2, 0.015
"""Targets this close to each other, and in height, are spread together, metres."""


def choose_pose_target(goal: Goal, row: int, task: ScoredTask, scene: PlanningScene, lift: float) -> Target:
    """The best target pose of those allowed for an object: free, low and near."""
    number = goal.objects[row]
    pose = scene.object_pose(number)
    free = allowed = goal.allowed_target_indices(row)
    if not goal.replace:
        rivals = [(other, scene.object_pose(id_)) for other, id_ in enumerate(goal.objects) if other != row]
        free = [
            index
            for index in allowed
            if not any(
                goal.matches[other][index] and task.is_match(rival, goal.targets[index], goal.symmetries[other])
                for other, rival in rivals
            )
        ]
    free.sort(key=lambda index: (round(goal.targets[index][0][2], 3), _planar_distance(goal.targets[index], pose)))
    reasons: list[Target] = []
    for index in free or allowed:
        target = _plan_placement_at_target(goal, index, row, task, scene, lift)
        if isinstance(target, Spot):
            return target
        reasons.append(target)
    blocked = [reason for reason in reasons if isinstance(reason, BlockedTarget)]
    if blocked:
        return blocked[0]
    if reasons:
        return reasons[0]
    detail = f"no target pose matches {scene.object_label(number)}: its row of matches is all zeros"
    return make_oracle_stop("error", detail, scene, number)


def _planar_distance(target: Pose, pose: Pose) -> float:
    return float(np.hypot(target[0][0] - pose[0][0], target[0][1] - pose[0][1]))


def _plan_placement_at_target(
    goal: Goal, index: int, row: int, task: ScoredTask, scene: PlanningScene, lift: float
) -> Target:
    target, number = goal.targets[index], goal.objects[row]
    pose, body = scene.object_pose(number), scene.object_prism(number)
    others = scene.prisms_of_other_objects(number)
    wanted = max(0.0, target[0][2] - (pose[0][2] - body.low))
    fit = _find_lowest_stable_fit(number, target, goal.symmetries[row], wanted, task, scene)
    height, angle, offset = fit.height, fit.angle, fit.offset
    spot = Spot((float(offset[0, 0]), float(offset[0, 1])), angle, height)
    tip = (*spot.center, height + lift)
    if not ReachTest(lift, scene.arm)(offset, np.array([height]))[0]:
        place = f"target of {scene.object_label(number)} at {format_point(target[0])}"
        return make_oracle_stop("unreachable", f"{place} {describe_out_of_reach(tip, scene.arm)}", scene, number)
    shape = rotated_outline_at_origin(body, np.asarray(pose[0][:2]), angle)
    keep_free = (Prism(shape.outline + offset, 0.0, 1.0, number),)
    below: list[int] = []  # ids of its carriers there, if it would rest too high
    if height > wanted + (_LOOSE if wanted > _FLAT else _FLAT):
        carriers = [
            prism.owner
            for prism in others
            if prism.high > height - _STEP and signed_outline_gaps(shape.outline, prism.outline, offset)[0] < OVERLAP
        ]
        below = list(dict.fromkeys(carriers))
    staying = [other for other in below if scene.is_bystander(other)]
    if staying:
        taken = f"target of {scene.object_label(number)} at {format_point(target[0])} is occupied"
        return make_oracle_stop(
            "target_occupied", f"{taken} by {describe_unmovables(staying, scene)}", scene, number, *staying
        )
    for other in below:
        if scene.is_object_movable(other) and not _may_rest_on_blocker(
            other, number, shape, target, height, task, scene
        ):
            return BlockedTarget(other, keep_free)
    tight = _find_conflicting_neighbour(number, fit, target, task, scene)
    return spot if tight is None else BlockedTarget(tight, keep_free, spot)


@dataclass(frozen=True)
class _Fit:
    """A candidate placement of an object."""

    angle: float  # turn from its current yaw, radians
    parts: list[Prism]
    offset: FloatArray  # of its parts, (1, 2)
    height: float
    stands: bool = True  # stable there


def _find_lowest_stable_fit(
    number: int, target: Pose, symmetry: float, wanted: float, task: ScoredTask, scene: PlanningScene
) -> _Fit:
    """The placement at which an object comes to rest lowest, of those at which it does not tip."""
    others, (position, rotation) = scene.prisms_of_other_objects(number), scene.object_pose(number)
    center = np.asarray(position[:2])
    company = [*others, *_predict_neighbour_prisms(number, target, task, scene)]
    volume = scene.object_volume(number)
    mass_center = transforms.transform_points((position, rotation), (volume.points @ volume.weights)[:, None])
    mass = mass_center[:2, 0] - center

    def fit(angle: float) -> _Fit:
        parts = [rotated_outline_at_origin(part, center, angle) for part in scene.collider_prisms(number)]
        offset = _find_clear_offset(parts, target, company, task)
        return _Fit(angle, parts, offset, max(0.0, rest_height_of_prisms(parts, others, offset, OVERLAP)))

    def stands(option: _Fit) -> bool:
        parts = [Prism(part.outline + option.offset, part.low, part.high) for part in option.parts]
        return is_placement_stable(
            parts, option.height, option.offset[0] + rotation_matrix_2d(option.angle) @ mass, others
        )

    to_target = transforms.yaw_of_quaternion(target[1]) - scene.object_yaw(number)
    if symmetry > 0:
        turns = [wrap_angle(to_target, symmetry)]
    elif all(shape.kind in ("cylinder", "sphere") for shape in scene.object_model(number).colliders):
        turns = [0.0]
    else:  # along the target rather than askew, so that neighbours find room
        turns = [*_angles_at_quarter_turns(to_target), 0.0]
    options = [fit(angle) for angle in turns]
    if symmetry <= 0 and min(option.height for option in options) > wanted + _STEP:  # along its support at the target
        for other in scene.object_ids:
            solid = other != number and scene.object_model(other).colliders
            if solid and scene.is_point_over_object(other, target[0]):
                along = scene.object_yaw(other) - scene.object_yaw(number)
                options += [fit(angle) for angle in _angles_at_quarter_turns(along)]
    options.sort(key=lambda option: round(option.height / _STEP))
    return next(filter(stands, options), replace(options[0], stands=False))


def _angles_at_quarter_turns(angle: float) -> list[float]:
    return [wrap_angle(wrap_angle(angle, np.pi / 2) + quarter * np.pi / 2) for quarter in range(4)]


def _predict_neighbour_prisms(number: int, target: Pose, task: ScoredTask, scene: PlanningScene) -> list[Prism]:
    """Prisms of other objects at their targets around this target: the first to arrive leaves them room."""
    neighbours: list[Prism] = []
    for goal in task.goals:
        for index, place in enumerate(goal.targets):
            rows = [row for row, other in enumerate(goal.objects) if goal.matches[row][index] and other != number]
            if rows and place is not target and _planar_distance(place, target) < _AROUND:
                other = goal.objects[rows[0]]
                body = scene.object_prism(other)
                angle = wrap_angle(transforms.yaw_of_quaternion(place[1]) - scene.object_yaw(other), np.pi / 2)
                shape = rotated_outline_at_origin(body, np.asarray(scene.object_pose(other)[0][:2]), angle)
                low = place[0][2] - (body.high - body.low) / 2
                neighbours.append(Prism(shape.outline + place[0][:2], low, low + body.high - body.low, other))
    return neighbours


def _find_clear_offset(body: Sequence[Prism], target: Pose, obstacles: Sequence[Prism], task: ScoredTask) -> FloatArray:
    """The target's position (1, 2), or a point within half its tolerance with more clearance at its level, metres."""
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
    # preferred: the target drawn apart from those around it on its level
    peers = [place for goal in task.goals for place in goal.targets if abs(place[0][2] - target[0][2]) < _LEVEL]
    around = np.array([place[0][:2] for place in peers if _planar_distance(place, target) < _AROUND] or [target[0][:2]])
    outward = np.asarray(target[0][:2]) - around.mean(axis=0)
    reach = float(np.linalg.norm(around - around.mean(axis=0), axis=1).max())
    preferred = np.asarray(target[0][:2]) + outward * _NUDGE / max(reach, 20 * _NUDGE)
    cost = np.linalg.norm(offsets - preferred, axis=1) - 10 * np.minimum(room, _ROOM / 2)
    return offsets[[int(np.argmin(cost))]]


def _find_conflicting_neighbour(
    number: int, fit: _Fit, target: Pose, task: ScoredTask, scene: PlanningScene
) -> int | None:
    """Id of a neighbour that moves anyway and would be shoved by the placement, or would tip it; None without any."""
    waiting = unplaced_objects(task) - {number}
    up = fit.height - min(part.low for part in fit.parts)
    standing = [prism for prism in scene.prisms if prism.owner in waiting and prism.high > fit.height - _STEP]
    for part in fit.parts:
        for prism in find_nearby_prisms(part, standing, fit.offset[0].tolist(), _BESIDE):
            gap = signed_outline_gaps(part.outline, prism.outline, fit.offset)[0]
            level = prism.low < part.high + up and prism.high > max(part.low + up, fit.height + 0.003)
            shoved = gap < _BESIDE and level and not scene.is_point_over_object(prism.owner, target[0])
            tipped = not fit.stands and gap < OVERLAP and abs(prism.high - part.low - up) < _STEP
            if shoved or tipped:
                return prism.owner
    return None


def _may_rest_on_blocker(
    blocker: int, number: int, shape: Prism, target: Pose, height: float, task: ScoredTask, scene: PlanningScene
) -> bool:
    """Whether to place an object on, or in, the blocker of its target, which belongs there and can hold it."""
    places: list[Pose] = []  # intended poses of the blocker
    for goal in scene.stated_goals:
        if blocker in goal.objects:
            allowed = goal.allowed_target_indices(goal.objects.index(blocker))
            pose_goal = goal.metric == "pose"
            places += [goal.targets[index] for index in allowed] if pose_goal else [zone.pose for zone in goal.zones]
    # An object that no goal names and whose start is the target is meant as a support, unless it is a ball.
    ball = any(shape.kind == "sphere" for shape in scene.object_model(blocker).colliders)
    named = any(blocker in goal.mentioned_object_ids for goal in scene.stated_goals)
    if not ball and not named and blocker in scene.places:
        places.append(scene.places[blocker])
    there = any(_planar_distance(place, target) < task.pos_eps for place in places)
    if scene.is_object_hollow(blocker):
        held = margins_inside_outline(shape.outline, scene.object_prism(blocker).outline, np.array([target[0][:2]]))[0]
        return (there or bool(held > 0)) and blocker not in unplaced_objects(task) - {number}
    if not there or height + (shape.high - shape.low) >= TALLEST_STACK:
        return False
    center = np.array([[target[0][0], target[0][1]]])
    tops = [prism.outline for prism in scene.prisms if prism.owner == blocker and prism.high > height - 0.003]
    return any(
        float(np.ptp(top, axis=0).min()) > 0.025 and margins_inside_outline(np.zeros((1, 2)), top, center)[0] > 0.01
        for top in tops
    )
