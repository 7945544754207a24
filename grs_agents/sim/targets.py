"""Where the oracle puts an object: at a target pose, or at a free spot of a zone."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.sim import kinematics, utils
from grs_agents.sim.episode import Stop
from grs_agents.sim.geometry import Prism, gaps, inside_margin, rest_heights
from grs_agents.sim.goals import Goal, Zone
from grs_agents.sim.placement import Region, Spot, find_spot, turned
from grs_agents.sim.scene_view import SceneView

if TYPE_CHECKING:
    from grs_agents.sim.task import Task

FloatArray = npt.NDArray[np.float64]
GAPS: Final = (0.025, 0.012, 0.006, 0.003)
"""Free space asked for between neighbours in a zone, metres: as generous as fits."""
_APPROACH: Final = 0.04
_TALLEST_STACK: Final = 0.32


@dataclass(frozen=True)
class Blocked:
    """The target is taken by something that can be moved away first."""

    blocker: int
    keep_free: tuple[Prism, ...] = ()


Target = Spot | Blocked | Stop


def wrap(angle: float, period: float = 2 * np.pi) -> float:
    """The angle nearest zero that differs by a multiple of ``period``."""
    return float(angle - period * np.round(angle / period))


@dataclass(frozen=True)
class Suits:
    """A test of offsets (N, 2) and rest heights (N,): can the arm bring the cup there and come down from above?"""

    lift: float

    def __call__(self, offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        tips = np.column_stack([offsets, heights + self.lift])
        above = tips + np.array([0.0, 0.0, _APPROACH])
        return kinematics.reachable(tips) & kinematics.reachable(above)


class Planner:
    """Chooses targets; remembers how the objects of a zone are to lie together."""

    def __init__(self) -> None:
        self._plans: dict[Zone, dict[int, Spot]] = {}

    def target(self, goal: Goal, row: int, task: "Task", view: SceneView, lift: float) -> Target:
        """Where the object of one row of a goal should go, or why nowhere.

        Args:
            goal: the current goal.
            row: of the object.
            task: whose later goals may share a zone.
            view: the scene.
            lift: from the object's lowest point to where the cup holds it, metres.
        """
        if goal.metric == "pose":
            return pose_target(goal, row, task, view, lift)
        return self._zone_target(goal, row, task, view, lift)

    def _zone_target(self, goal: Goal, row: int, task: "Task", view: SceneView, lift: float) -> Target:
        number, reasons = goal.objs[row], list[Target]()
        for zone in goal.params:
            planned = self._plans.get(zone, {}).get(number)
            if planned is not None and _still_free(planned, number, view, lift):
                return planned
            members = _members(zone, task)
            plan = pack(zone, [number, *(other for other in members if other != number)], view, lift)
            self._plans[zone] = plan
            if number in plan:
                return plan[number]
            reasons.append(_why_not(zone, number, members, view, lift))
        blocked = [reason for reason in reasons if isinstance(reason, Spot | Blocked)]
        return blocked[0] if blocked else reasons[0]


# --- pose goals ---------------------------------------------------------------------------------------------


def pose_target(goal: Goal, row: int, task: "Task", view: SceneView, lift: float) -> Target:
    """The best of the target poses that will do for an object."""
    number = goal.objs[row]
    pose = view.pose(number)
    allowed = [int(index) for index in np.flatnonzero(goal.matches[row])]
    free = allowed if goal.replace else [index for index in allowed if not _claimed(goal, index, row, task, view)]
    free.sort(key=lambda index: (round(goal.targ_poses[index][0][2], 3), _distance(goal.targ_poses[index], pose)))
    reasons: list[Target] = []
    for index in free or allowed:
        target = _at_pose(goal.targ_poses[index], number, goal.symmetries[row], view, lift)
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


def _at_pose(target: Pose, number: int, symmetry: float, view: SceneView, lift: float) -> Target:
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
    if not Suits(lift)(offset, np.array([height]))[0]:
        return Stop("unreachable", f"target of {name} at {_at(target[0])} {reach_note(tip)}", (name,))
    shape = turned(body, np.asarray(pose[0][:2]), angle)
    wanted = target[0][2] - (pose[0][2] - body.low)
    blocker = _blocker(shape, offset, others, height, max(0.0, wanted) + 0.02, view)
    if blocker is None or _stackable(blocker, shape, target, height, view):
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


def _stackable(blocker: int, shape: Prism, target: Pose, height: float, view: SceneView) -> bool:
    """Whether to stand an object on what is in its way: that is wanted there too, and its top is wide and flat."""
    wanted = {number for goal, _ in view.stated_goals for number in goal.objs}
    if blocker not in wanted or height + (shape.high - shape.low) >= _TALLEST_STACK:
        return False
    center = np.array([[target[0][0], target[0][1]]])
    tops = [prism.outline for prism in view.prisms if prism.owner == blocker and prism.high > height - 0.003]
    return any(
        float(np.ptp(top, axis=0).min()) > 0.05 and inside_margin(np.zeros((1, 2)), top, center)[0] > 0.02
        for top in tops
    )


# --- zone goals ---------------------------------------------------------------------------------------------


def region_of(zone: Zone) -> Region:
    """A zone seen from above."""
    (position, rotation), size = zone
    return Region((position[0], position[1]), (size[0], size[1]), utils.yaw_of(rotation))


def _members(zone: Zone, task: "Task") -> list[int]:
    """Objects that goals still want in a zone, and are not there yet."""
    found: list[int] = []
    for goal in task.goals:
        if goal.metric == "zone" and zone in goal.params:
            scores = task.scores(goal)
            found.extend(number for number, score in zip(goal.objs, scores, strict=True) if score < 0.985)
    return list(dict.fromkeys(found))


def turns_for(number: int, region: Region, view: SceneView) -> list[float]:
    """Turns (rad) worth trying: as it is if it is round, else along the region's sides."""
    aligned = wrap(region.yaw - view.yaw(number), np.pi / 2)
    width, depth = view.extent(number)
    across = [wrap(aligned + np.pi / 2, np.pi)] if abs(width - depth) > 0.002 else []
    round_ = all(shape.kind in ("cylinder", "sphere") for shape in view.model(number).colliders)
    return [0.0] if round_ and view.tilt(number) < 0.1 else [aligned, *across]


def pack(zone: Zone, members: Sequence[int], view: SceneView, lift: float) -> dict[int, Spot]:
    """Spots for as many members as fit together, the first one before all others; empty if it does not fit."""
    region = region_of(zone)
    first, rest = members[0], sorted(members[1:], key=lambda number: -float(np.prod(view.extent(number))))
    best: dict[int, Spot] = {}
    for gap in GAPS:
        for order in ([first, *rest], sorted(members, key=lambda number: -float(np.prod(view.extent(number))))):
            plan = _pack_once(region, order, view, lift, gap)
            if first in plan and len(plan) > len(best):
                best = plan
            if len(best) == len(members):
                return best
    return best


def _pack_once(region: Region, order: Sequence[int], view: SceneView, lift: float, gap: float) -> dict[int, Spot]:
    inner = Region(region.center, (region.size[0] - min(gap, 0.008), region.size[1] - min(gap, 0.008)), region.yaw)
    obstacles = view.others(*order)
    plan: dict[int, Spot] = {}
    for number in order:
        body, center = view.outline(number), view.pose(number)[0]
        standing = [*obstacles, *(prism for prism in view.prisms if prism.owner in order and prism.owner not in plan
                                  and prism.owner != number)]  # fmt: skip
        alone = len(order) == 1
        spot = find_spot(body, center, turns_for(number, region, view), inner, standing, gap, Suits(lift), spread=alone)
        if spot is None:
            continue
        plan[number] = spot
        shape = turned(body, np.asarray(center[:2]), spot.turn)
        obstacles.append(
            Prism(shape.outline + np.asarray(spot.center), spot.height, spot.height + body.high - body.low, number)
        )
    return plan


def _still_free(spot: Spot, number: int, view: SceneView, lift: float) -> bool:
    shape = turned(view.outline(number), np.asarray(view.pose(number)[0][:2]), spot.turn)
    offset = np.array([spot.center])
    height = rest_heights(shape, view.others(number), offset, 0.001)
    return bool(abs(height[0] - spot.height) < 0.01 and Suits(lift)(offset, height)[0])


def _why_not(zone: Zone, number: int, members: Sequence[int], view: SceneView, lift: float) -> Target:
    """Nothing is free: the zone is too small, out of reach, or taken; if taken, by what can be moved, or on what."""
    region, name, body = region_of(zone), view.name(number), view.outline(number)
    center, turns = view.pose(number)[0], turns_for(number, region, view)
    width, depth = view.extent(number)
    fixed = [prism for prism in view.others(number) if not view.is_free(prism.owner)]

    def anywhere(offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        del heights
        return np.ones(len(offsets), dtype=bool)

    size = f"{region.size[0]:.2f} x {region.size[1]:.2f} m"
    if find_spot(body, center, turns, region, fixed, 0.001, anywhere) is None:
        return Stop(
            "target_too_small", f"target zone {size} is too small for {name} ({width:.2f} x {depth:.2f} m)", (name,)
        )
    if find_spot(body, center, turns, region, fixed, 0.001, Suits(lift)) is None:
        tip = (region.center[0], region.center[1], lift)
        return Stop("unreachable", f"target zone of {name} at {_at(zone[0][0])} {reach_note(tip)}", (name,))
    return _taken(region, number, members, view, lift, size)


def _taken(region: Region, number: int, members: Sequence[int], view: SceneView, lift: float, size: str) -> Target:
    name, body, center = view.name(number), view.outline(number), view.pose(number)[0]
    inside = [
        other for other in view.ids
        if other != number and view.is_free(other)
        and gaps(view.outline(other).outline, region.outline, np.zeros((1, 2)))[0] < -0.002
    ]  # fmt: skip
    foreign = [other for other in inside if other in members or not _over_region(other, region, view)]
    wide = _wanted_nowhere(inside, view)
    for other in foreign or wide:
        return Blocked(other, (Prism(region.outline, 0.0, 1.0, number),))
    spot = find_spot(
        body, center, turns_for(number, region, view), region, view.others(number), 0.002, Suits(lift),
        spread=True, stack=True,
    )  # fmt: skip
    if spot is not None and spot.height + body.high - body.low < _TALLEST_STACK:
        return spot
    names = tuple(dict.fromkeys(view.name(other) for other in inside))
    return Stop(
        "target_occupied", f"no room for {name} in the target zone {size}: occupied by {', '.join(names)}",
        (name, *names),
    )  # fmt: skip


def _over_region(number: int, region: Region, view: SceneView) -> bool:
    """Whether an object lies wholly in a region."""
    return bool(inside_margin(view.outline(number).outline, region.outline, np.zeros((1, 2)))[0] > -0.01)


def _wanted_nowhere(numbers: Sequence[int], view: SceneView) -> list[int]:
    """Objects that no goal speaks of."""
    wanted = {number for goal, _ in view.stated_goals for number in goal.objs}
    return [number for number in numbers if number not in wanted]


def aside(number: int, keep_free: Sequence[Prism], view: SceneView, lift: float) -> Spot | None:
    """A spot out of the way, near where the object is: within what it stands in if there is room, else on the table."""
    bounds = view.env.bounds
    table = Region(
        (float(bounds[0].mean()), float(bounds[1].mean())),
        (float(np.ptp(bounds[0])), float(np.ptp(bounds[1]))), 0.0,
    )  # fmt: skip
    body, center = view.outline(number), view.pose(number)[0]
    reserved = [Prism(prism.outline, 0.0, 1.0) for prism in (*keep_free, *_goal_areas(view, number))]
    marks = [view.outline(other) for other in view.ids if not view.model(other).colliders]
    solid = [*view.others(number), *reserved, *(Prism(mark.outline, 0.0, 1.0) for mark in marks)]
    holders = [other for other in view.ids if other != number and view.hollow(other) and view.over(other, center)]
    regions = [_within(view.outline(other)) for other in holders]
    turns = [0.0, np.pi / 2, np.pi / 4]
    for region, gap in (*((region, 0.003) for region in regions), (table, 0.03), (table, 0.01)):
        obstacles = [*view.others(number), *reserved] if region is not table else solid
        spot = find_spot(body, center, turns, region, obstacles, gap, Suits(lift), spread=True, near=center)
        if spot is not None:
            return spot
    return None


def _within(outline: Prism) -> Region:
    x0, y0, x1, y1 = outline.box
    return Region(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0), 0.0)


def _goal_areas(view: SceneView, number: int) -> list[Prism]:
    """Where unmet pose goals want other objects, kept free."""
    found: list[Prism] = []
    goals = view.env.task.goals if view.env.task is not None else []
    for goal in goals:
        for other in goal.objs if goal.metric == "pose" else ():
            center = np.asarray(view.pose(other)[0][:2])
            for target in goal.targ_poses if other != number else ():
                shape = turned(view.outline(other), center, utils.yaw_of(target[1]) - view.yaw(other))
                found.append(Prism(shape.outline + np.asarray(target[0][:2]), 0.0, 1.0))
    return found


def reach_note(tip: Sequence[float]) -> str:
    """How a point lies out of reach, in words."""
    distance = float(np.hypot(tip[0], tip[1]))
    if distance > kinematics.REACH:
        return f"is {distance:.2f} m from the base, reach is {kinematics.REACH:.2f} m"
    if distance < kinematics.NEAREST:
        return f"is {distance:.2f} m from the base, nearest is {kinematics.NEAREST:.2f} m"
    return f"cannot be reached at height {tip[2]:.2f} m with the tool down, {distance:.2f} m from the base"


def _at(point: Sequence[float]) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
