"""Where the oracle puts an object that a ``pose`` goal speaks of."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from grs_agents.base import Pose
from grs_agents.sim import utils
from grs_agents.sim.episode import Stop
from grs_agents.sim.geometry import Prism, gaps, inside_margin, rest_heights
from grs_agents.sim.goals import Goal
from grs_agents.sim.placement import Spot, turned
from grs_agents.sim.reach import TALLEST_STACK, Blocked, FloatArray, Suits, Target, at, reach_note, wrap
from grs_agents.sim.scene_view import SceneView

if TYPE_CHECKING:
    from grs_agents.sim.task import Task


def pose_target(goal: Goal, row: int, task: "Task", view: SceneView, lift: float) -> Target:
    """The best of the target poses that will do for an object."""
    number = goal.objs[row]
    pose = view.pose(number)
    allowed = [int(index) for index in np.flatnonzero(goal.matches[row])]
    free = allowed if goal.replace else [index for index in allowed if not _claimed(goal, index, row, task, view)]
    free.sort(key=lambda index: (round(goal.targ_poses[index][0][2], 3), _distance(goal.targ_poses[index], pose)))
    reasons: list[Target] = []
    for index in free or allowed:
        target = _at_pose(goal.targ_poses[index], number, goal.symmetries[row], task, view, lift)
        if isinstance(target, Spot):
            return target
        reasons.append(target)
    blocked = [reason for reason in reasons if isinstance(reason, Blocked)]
    if blocked:
        return blocked[0]
    return reasons[0] if reasons else Stop(
        "error", f"no target pose matches {view.name(number)}: its row of matches is all zeros", (view.name(number),)
    )  # fmt: skip


def _distance(target: Pose, pose: Pose) -> float:
    return float(np.hypot(target[0][0] - pose[0][0], target[0][1] - pose[0][1]))


def _claimed(goal: Goal, index: int, row: int, task: "Task", view: SceneView) -> bool:
    return any(
        other != row
        and goal.matches[other][index]
        and task.is_match(view.pose(number), goal.targ_poses[index], goal.symmetries[other])
        for other, number in enumerate(goal.objs)
    )


def _at_pose(target: Pose, number: int, symmetry: float, task: "Task", view: SceneView, lift: float) -> Target:
    name, pose, body = view.name(number), view.pose(number), view.outline(number)
    offset = np.array([[target[0][0], target[0][1]]])
    turn = utils.yaw_of(target[1]) - view.yaw(number)
    turns = [wrap(turn, symmetry)] if symmetry > 0 else [0.0, wrap(turn), wrap(turn + np.pi / 2)]
    others = view.others(number)
    best: tuple[float, float] | None = None
    for angle in turns:
        shape = turned(body, np.asarray(pose[0][:2]), angle)
        height = float(rest_heights(shape, others, offset, -0.0005)[0])
        if best is None or height < best[0] - 0.005:
            best = (height, angle)
    height, angle = best or (0.0, 0.0)
    tip = (target[0][0], target[0][1], height + lift)
    if not Suits(lift, view.env.arm)(offset, np.array([height]))[0]:
        return Stop("unreachable", f"target of {name} at {at(target[0])} {reach_note(tip, view.env.arm)}", (name,))
    shape = turned(body, np.asarray(pose[0][:2]), angle)
    wanted = target[0][2] - (pose[0][2] - body.low)
    blocker = _blocker(shape, offset, others, height, max(0.0, wanted) + 0.02, view)
    if blocker is None or _stackable(blocker, shape, target, height, task, view):
        return Spot((target[0][0], target[0][1]), angle, height)
    if not view.is_free(blocker):
        return Spot((target[0][0], target[0][1]), angle, height)
    moved = Prism(shape.outline + offset, 0.0, 1.0, number)
    return Blocked(blocker, (moved,))


def _blocker(
    shape: Prism, offset: FloatArray, others: Sequence[Prism], height: float, wanted: float, view: SceneView
) -> int | None:
    """What holds the object higher than the target asks for; None if nothing does."""
    if height <= wanted:
        return None
    top = [
        prism.owner for prism in others
        if prism.high > height - 0.005 and gaps(shape.outline, prism.outline, offset)[0] < -0.0005
    ]  # fmt: skip
    movable = [owner for owner in top if view.is_free(owner) and not view.hollow(owner)]
    return movable[0] if movable else None


def _stackable(blocker: int, shape: Prism, target: Pose, height: float, task: "Task", view: SceneView) -> bool:
    """Whether to stand an object on what is in its way: that is wanted there too, and its top is wide and flat."""
    wanted = [
        place
        for goal, _ in view.stated_goals if blocker in goal.objs
        for place in (goal.targ_poses if goal.metric == "pose" else [zone[0] for zone in goal.params])
    ]  # fmt: skip
    there = any(_distance(place, target) < task.pos_eps for place in wanted)
    if not there or height + (shape.high - shape.low) >= TALLEST_STACK:
        return False
    center = np.array([[target[0][0], target[0][1]]])
    tops = [prism.outline for prism in view.prisms if prism.owner == blocker and prism.high > height - 0.003]
    return any(
        float(np.ptp(top, axis=0).min()) > 0.05 and inside_margin(np.zeros((1, 2)), top, center)[0] > 0.02
        for top in tops
    )
