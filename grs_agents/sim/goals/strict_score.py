"""How far goals hold at the end of an episode, strictly: height, support, upright, one object a target.

The published score (``task_accounting``) ignores height and tilt, lets two objects claim one target and keeps credit
for what was undone later. Here every goal is judged on the scene as it stands. An object counts where the published
score counts it and, besides,

* it rests at the height that the target says: its centre or its underside is within ``pos_eps`` of the target; or the
  target lies in or on another object and it rests on that object (a plate's rim is higher than its bottom), or within
  it on the table (a fixture, a mark); or it rests on objects that hold their own targets, as far below it as those are
  below its own (levels a little higher than the blocks); in a zone, its underside lies no higher than the zone's top;
  things that share a target or a zone may rest on each other;
* where the target lies between the walls of a container, it lies in that container, as a typed goal would ask;
* it stands no more than ``rot_eps`` more tilted than at the start, and lies still, let go by the robot;
* no other object claims its target, unless the goal lets objects share.

An object that later goals speak of too is judged there. Other objects that were knocked over lower the whole score.
"""

import math
from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.relation_rules import WHOLE, explain_goal_shortfalls, explain_not_inside
from grs_agents.sim.goals.scene_report import describe_goal, format_point, measure_object_motions
from grs_agents.sim.goals.scene_view import (
    SceneView,
    describe_tilt,
    enclosing_object_ids,
    has_toppled,
    is_at_rest,
    is_target_tilted,
    mark_ids_under_object,
    supporting_object_ids,
)
from grs_agents.sim.goals.task_accounting import ScoredTask, symmetric_yaw_difference
from grs_agents.sim.instance.episode import EndState, GoalOutcome
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.world.collision_volumes import volume_share_in_zones
from grs_agents.sim.world.footprints import margins_inside_outline, object_prism_at_pose
from grs_agents.sim.world.tabletop import Tabletop

_HEIGHT: Final = 0.015
"""Farthest from the height that a target says, metres, whatever ``pos_eps`` is; less than half the least of levels."""

_WALLS: Final = 0.025
"""Lower walls (m) are rims: things lie on plates and trays."""


class StrictScorer:
    """Scores how a scene stands, strictly, against where every object stood once the scene had settled."""

    def __init__(self, task: ScoredTask, table: Tabletop) -> None:
        self.task, self.table = task, table

    def measure_scene(self) -> EndState:
        """How the scene stands now."""
        view = SceneView(self.table, self.task.grs.stated, self.task.goals)
        published = self.task.grs.published_reward_shares()
        notes: dict[int, str] = {}
        outcomes: list[GoalOutcome] = []
        final: dict[int, float] = {}
        for goal, earned in zip(reversed(self.task.grs.stated), reversed(published), strict=True):
            outcomes.insert(0, self._build_goal_outcome(goal, earned, view, final, notes))
        value = min(1.0, sum(outcome.worth * outcome.strict for outcome in outcomes))
        standing, fallen = self._split_bystanders_by_toppled(view, final)
        notes.update({number: f"{view.object_label(number)} was knocked over" for number in fallen})
        return EndState(
            reward=self.task.grs.total,
            complete=bool(outcomes) and not self.task.goals,
            strict=round(value * (1 - len(fallen) / max(1, len(standing) + len(fallen))), 9),
            weakest=0.0 if fallen else round(min((outcome.strict for outcome in outcomes), default=0.0), 9),
            shortfalls=tuple(notes.values()),
            goals=tuple(outcomes),
            motions=measure_object_motions(view),
            placed=sum(score > WHOLE for score in final.values()),
            wanted=len(final),
        )

    def _split_bystanders_by_toppled(self, view: SceneView, wanted: Collection[int]) -> tuple[list[int], list[int]]:
        """Ids of the movable objects that no goal speaks of: those that stand as they did, and those knocked over."""
        sorted_ids: tuple[list[int], list[int]] = ([], [])
        for number in view.object_ids:
            if view.is_object_movable(number) and number not in wanted:
                sorted_ids[has_toppled(number, view, self.task.rot_eps)].append(number)
        return sorted_ids

    def _build_goal_outcome(
        self, goal: Goal, earned: float, view: SceneView, final: dict[int, float], notes: dict[int, str]
    ) -> GoalOutcome:
        """How a goal stands; ``final`` has the scores of the objects of later goals and gains those that it lacks.

        ``notes`` gains a clause for each of the latter that falls short.
        """
        rows: list[float] = []
        clauses: list[str] = []
        for number, (score, trouble) in zip(goal.objects, self._score_goal_objects(goal, view), strict=True):
            rows.append(max(score, final.get(number, 0.0)))
            if trouble:
                moved_on = ", where a later goal wants it" if number in final and rows[-1] > score else ""
                clauses.append(f"{view.object_label(number)} {trouble}{moved_on}")
                if number not in final:
                    notes.setdefault(number, clauses[-1])
            final.setdefault(number, rows[-1])
        strict = float(np.mean(rows))
        if strict > earned == 0.0 and goal is not self.task.goals[0]:
            clauses.append("it earns nothing as long as a goal before it is open")
        return GoalOutcome(
            goal=describe_goal(goal, view, self.task.pos_eps),
            worth=goal.max_reward,
            published=earned,
            strict=strict,
            shortfalls=tuple(clauses),
        )

    def _score_goal_objects(self, goal: Goal, view: SceneView) -> list[tuple[float, str]]:
        """For each object of a goal its score, and why that is not 1."""
        if goal.relation is not None:
            clauses = explain_goal_shortfalls(goal, view, self.task.rot_eps)
            return [(float(not clause), clause) for clause in clauses]
        claimed = self._assign_targets_to_rows(goal, view)
        return [self._score_object(goal, row, claimed, view) for row in range(len(goal.objects))]

    def _score_object(self, goal: Goal, row: int, claimed: dict[int, int], view: SceneView) -> tuple[float, str]:
        number = goal.objects[row]
        if has_toppled(number, view, self.task.rot_eps) and not self._is_tilted_as_target(goal, row, view):
            return 0.0, f"does not stand upright: {describe_tilt(number, view)}"
        if not is_at_rest(number, view):
            return 0.0, "does not lie still"
        if goal.metric == "zone":
            return self._score_zone_object(goal, number, view)
        if row not in claimed:
            return 0.0, self._explain_missed_target(goal, row, view)
        target = goal.targets[claimed[row]]
        if self.task.sixdof and is_target_tilted(target):  # its height and tilt tell that it hangs in there
            return 1.0, ""
        trouble = _explain_not_in_its_container(number, target, view)
        return float(not trouble), trouble

    def _is_tilted_as_target(self, goal: Goal, row: int, view: SceneView) -> bool:
        """Whether an object lies as tilted as a tilted target of a task of six degrees of freedom, and that way."""
        up = transforms.quaternion_to_matrix(view.object_pose(goal.objects[row])[1])[:, 2]
        tilted = [goal.targets[index] for index in goal.allowed_target_indices(row) if goal.metric == "pose"]
        return self.task.sixdof and any(
            is_target_tilted(target)
            and float(up @ transforms.quaternion_to_matrix(target[1])[:, 2]) > math.cos(self.task.rot_eps)
            for target in tilted
        )

    def _explain_missed_target(self, goal: Goal, row: int, view: SceneView) -> str:
        """How an object misses every target that will do for it."""
        number = goal.objects[row]
        pose, low = view.object_pose(number), view.object_prism(number).low
        claimed = [
            index
            for index in goal.allowed_target_indices(row)
            if self.task.is_match(pose, goal.targets[index], goal.symmetries[row])
        ]
        if not claimed:
            return self._explain_distance_to_target(goal, row, pose)
        if any(self._has_reached_target(goal, row, index, view) for index in claimed):
            return "is at a target that another object has"
        heights = [goal.targets[index][0][2] for index in claimed]
        wanted = min(heights, key=lambda height: abs(height - pose[0][2]))
        unsupported = _would_be_unsupported(number, pose, wanted - pose[0][2] + low, view)
        return (
            f"is at its target but for the height: it reaches from {abs(low):.3f} m up, the target is at {wanted:.3f} m"
            f"{', where nothing would hold it' if unsupported else ''}"
        )

    def _explain_distance_to_target(self, goal: Goal, row: int, pose: Pose) -> str:
        """How far an object is from the nearest of its targets."""
        targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
        if not targets:
            return "has no target: its row of matches is all zeros"
        away, nearest = min((math.dist(target[0][:2], pose[0][:2]), target) for target in targets)
        where = f"its target at {format_point(nearest[0])}"
        if away >= self.task.pos_eps:
            return f"is {away:.3f} m from {where}, {self.task.pos_eps:.3g} m are allowed"
        turn = symmetric_yaw_difference(
            transforms.yaw_of_quaternion(pose[1]), transforms.yaw_of_quaternion(nearest[1]), goal.symmetries[row]
        )
        most = math.degrees(self.task.rot_eps)
        return f"is turned by {math.degrees(turn):.0f} degrees against {where}, {most:.0f} are allowed"

    def _score_zone_object(self, goal: Goal, number: int, view: SceneView) -> tuple[float, str]:
        ceiling = float(self.task.zone_bounds[2, 1])
        share = volume_share_in_zones(view.object_volume(number), view.object_pose(number), goal.zones, ceiling)
        if share < 0.01:
            return 0.0, f"is not in its zone, it is at {format_point(view.object_pose(number)[0])}"
        top = max(zone.pose[0][2] + zone.size[2] / 2 for zone in goal.zones)
        high = view.object_prism(number).low > max(0.0, top) + _HEIGHT
        if high and not self._is_supported_only_by(number, self._objects_with_same_zones(goal), view):
            return 0.0, f"rests at {view.object_prism(number).low:.2f} m, above its zone"
        return (1.0, "") if share > 0.985 else (share, f"is {share:.0%} in its zone")

    def _assign_targets_to_rows(self, goal: Goal, view: SceneView) -> dict[int, int]:
        """Row to target for ``pose`` goals: as many rows as can have a target that holds them, each its own."""
        if goal.metric != "pose":
            return {}
        options = [
            [index for index in goal.allowed_target_indices(row) if self._has_reached_target(goal, row, index, view)]
            for row in range(len(goal.objects))
        ]
        if goal.replace:
            return {row: targets[0] for row, targets in enumerate(options) if targets}
        return match_rows_to_targets(options)

    def _has_reached_target(self, goal: Goal, row: int, index: int, view: SceneView) -> bool:
        number, target = goal.objects[row], goal.targets[index]
        pose = view.object_pose(number)
        if not self.task.is_match(pose, target, goal.symmetries[row]):
            return False
        heights = (pose[0][2], view.object_prism(number).low)
        if any(abs(height - target[0][2]) <= _HEIGHT for height in heights):
            return True
        half, under = heights[0] - heights[1] + _HEIGHT, supporting_object_ids(number, view)
        if any(
            self._is_target_in_or_on_object(other, target, half)
            for other in under or mark_ids_under_object(number, view)
        ):
            return True
        if any(self._is_target_in_or_on_object(other, target, 0.0) for other in enclosing_object_ids(number, view)):
            return True
        if under and all(self._is_support_at_lower_target(other, number, target, view) for other in under):
            return True
        return self._is_supported_only_by(number, self._objects_sharing_target(goal, number, target), view)

    def _is_support_at_lower_target(self, under: int, number: int, target: Pose, view: SceneView) -> bool:
        """Whether what carries an object holds a target, as far below the object's own as it is below the object."""
        rises = (
            view.object_pose(number)[0][2] - view.object_pose(under)[0][2],
            view.object_prism(number).low - view.object_prism(under).low,
        )
        if rises[1] <= 0:
            return False
        return any(
            any(abs(target[0][2] - goal.targets[index][0][2] - rise) <= _HEIGHT for rise in rises)
            and self._has_reached_target(goal, goal.objects.index(under), index, view)
            for goal in self.task.grs.stated
            if goal.metric == "pose" and under in goal.objects
            for index in goal.allowed_target_indices(goal.objects.index(under))
        )

    def _is_target_in_or_on_object(self, number: int, target: Pose, half: float) -> bool:
        """Whether a target lies in an object as it stood at the start, or on it, ``half`` above its top at most."""
        start = object_prism_at_pose(self.table.object_model(number), self.table.places[number])
        aside = -margins_inside_outline(np.zeros((1, 2)), start.outline, np.array([target[0][:2]]))[0]
        return bool(aside <= self.task.pos_eps and start.low <= target[0][2] <= start.high + half)

    def _objects_with_same_zones(self, goal: Goal) -> set[int]:
        """Objects that goals want in the same zones or at the same targets."""
        return {
            number
            for other in self.task.grs.stated
            if other is goal or (other.zones and other.zones == goal.zones)
            for number in other.objects
        }

    def _objects_sharing_target(self, goal: Goal, number: int, target: Pose) -> set[int]:
        """Objects that goals want at the same place: one target for all of them, or equal ones."""
        sharers = set(goal.objects) if goal.replace else set[int]()
        for other in self.task.grs.stated:
            for row, index in np.argwhere(other.matches).tolist():
                if other is not goal or other.targets[index] is not target:
                    apart = np.abs(np.subtract(other.targets[index][0], target[0]))
                    if (apart <= (self.task.pos_eps, self.task.pos_eps, _HEIGHT)).all():
                        sharers.add(other.objects[int(row)])
        return sharers - {number}

    def _is_supported_only_by(self, number: int, fellows: set[int], view: SceneView) -> bool:
        under = supporting_object_ids(number, view)
        return bool(under) and all(other in fellows for other in under)


def _explain_not_in_its_container(number: int, target: Pose, view: SceneView) -> str:
    """Why an object at a target between the walls of a container does not lie in that; "" where it does."""
    half = view.object_pose(number)[0][2] - view.object_prism(number).low
    for other in view.object_ids:
        if other != number and view.is_object_hollow(other) and view.is_point_over_object(other, target[0]):
            walls = view.object_prism(other)
            if _is_solid_below(other, target, walls.high, view):
                continue
            if walls.high - walls.low > _WALLS and target[0][2] - half < walls.high - _HEIGHT:
                return explain_not_inside(number, other, view)
    return ""


def _is_solid_below(number: int, target: Pose, top: float, view: SceneView) -> bool:
    """Whether what is under a target reaches as high as its rim (m), as a pallet's deck does: nothing goes into it."""
    point = np.array([target[0][:2]])
    return any(
        prism.high > top - _HEIGHT and margins_inside_outline(np.zeros((1, 2)), prism.outline, point)[0] >= 0
        for prism in view.collider_prisms(number)
    )


def _would_be_unsupported(number: int, pose: Pose, low: float, view: SceneView) -> bool:
    """Whether an object with its underside at a height (m), where it is now, would have nothing under it."""
    point = np.array([pose[0][:2]])
    return low > _HEIGHT and not any(
        abs(prism.high - low) <= _HEIGHT and margins_inside_outline(np.zeros((1, 2)), prism.outline, point)[0] >= 0
        for prism in view.prisms_of_other_objects(number)
    )


def match_rows_to_targets(options: Sequence[Sequence[int]]) -> dict[int, int]:
    """Give as many rows as can be a target of their own out of their options: row to target."""
    holder: dict[int, int] = {}

    def place(row: int, tried: set[int]) -> bool:
        for target in options[row]:
            if target not in tried:
                tried.add(target)
                if target not in holder or place(holder[target], tried):
                    holder[target] = row
                    return True
        return False

    for row in range(len(options)):
        place(row, set())
    return {row: target for target, row in holder.items()}
