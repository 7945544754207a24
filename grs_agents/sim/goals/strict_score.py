"""How far goals hold at the end of an episode, strictly: height, support, upright, one object a target.

The published score (``task_accounting``) ignores height and tilt, lets two objects claim one target and keeps credit
for what was undone later. Here every goal is judged on the scene as it stands. An object counts where the published
score counts it and, besides,

* it rests at the height that the target says: its centre or its underside is within ``pos_eps`` of the target; or the
  target lies in or on another object and it rests on that object (a plate's rim is higher than its bottom), or within
  it on the table (a fixture, a mark); or it rests on objects that hold their own targets, as far below it as those are
  below its own (levels a little higher than the blocks); in a zone, its underside lies no higher than the zone's top;
  things that share a target or a zone may rest on each other;
* it stands no more than ``rot_eps`` more tilted than at the start, and lies still, let go by the robot;
* no other object claims its target, unless the goal lets objects share.

An object that later goals speak of too is judged there. Other objects that were knocked over lower the whole score.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.sim.goals.relation_rules import explain_goal_shortfalls
from grs_agents.sim.goals.scene_view import (
    SceneView,
    enclosing_object_ids,
    has_toppled,
    is_at_rest,
    mark_ids_under_object,
    supporting_object_ids,
)
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance import Goal
from grs_agents.sim.world import Tabletop, margins_inside_outline, object_prism_at_pose, volume_share_in_zones

_HEIGHT: Final = 0.015
"""Farthest from the height that a target says, metres, whatever ``pos_eps`` is; less than half the least of levels."""


@dataclass(frozen=True)
class StrictScore:
    """``value`` and ``weakest``, of the goal that holds least, 0..1; one clause for each object that falls short."""

    value: float
    weakest: float
    shortfalls: tuple[str, ...] = ()


class StrictScorer:
    """Scores how a scene stands, strictly, against ``places``, where every object stood before anything acted."""

    def __init__(self, task: ScoredTask, table: Tabletop, places: Mapping[int, Pose]) -> None:
        self.task, self.table = task, table
        self._outlines = {
            number: object_prism_at_pose(table.object_model(number), pose) for number, pose in places.items()
        }

    def score_scene(self) -> StrictScore:
        """The score of the scene as it stands now."""
        view = SceneView(self.table, self.task.grs.stated, self.task.goals)
        notes: dict[int, str] = {}
        value, shares = 0.0, list[float]()
        final: dict[int, float] = {}
        for goal in reversed(self.task.grs.stated):
            rows = self._score_goal_objects(
                goal, view, {number for number in goal.objects if number not in final}, notes
            )
            for row, number in enumerate(goal.objects):
                rows[row] = max(rows[row], final.get(number, 0.0))
                final.setdefault(number, rows[row])
            shares.append(float(np.mean(rows)))
            value += goal.max_reward * shares[-1]
        bystanders = [number for number in view.object_ids if view.is_object_movable(number) and number not in final]
        fallen = [number for number in bystanders if has_toppled(number, view, self.task.rot_eps)]
        weakest = min(shares, default=0.0)
        if fallen:
            notes.update({number: f"{view.object_name(number)} was knocked over" for number in fallen})
            return StrictScore(
                round(min(1.0, value) * (1 - len(fallen) / len(bystanders)), 9), 0.0, tuple(notes.values())
            )
        return StrictScore(round(min(1.0, value), 9), round(weakest, 9), tuple(notes.values()))

    def _score_goal_objects(self, goal: Goal, view: SceneView, last: set[int], notes: dict[int, str]) -> list[float]:
        """The score of each object of one goal; ``notes`` gains a clause for each of ``last`` that falls short."""
        if goal.relation is not None:
            clauses = explain_goal_shortfalls(goal, view, self.task.rot_eps)
            notes_of = dict(zip(goal.objects, clauses, strict=True))
            for number in last:
                if notes_of[number]:
                    notes.setdefault(number, f"{view.object_name(number)} {notes_of[number]}")
            return [float(not clause) for clause in clauses]
        claimed = self._assign_targets_to_rows(goal, view)
        scores: list[float] = []
        for row, number in enumerate(goal.objects):
            share, trouble = self._score_object(goal, row, claimed, view)
            scores.append(share)
            if trouble and number in last:
                notes.setdefault(number, f"{view.object_name(number)} {trouble}")
        return scores

    def _score_object(self, goal: Goal, row: int, claimed: dict[int, int], view: SceneView) -> tuple[float, str]:
        number = goal.objects[row]
        if has_toppled(number, view, self.task.rot_eps):
            return 0.0, "does not stand upright"
        if not is_at_rest(number, view):
            return 0.0, "does not lie still"
        if goal.metric == "zone":
            return self._score_zone_object(goal, number, view)
        return (1.0, "") if row in claimed else (0.0, self._explain_missed_target(goal, row, view))

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
            return "is at none of its targets"
        if any(self._has_reached_target(goal, row, index, view) for index in claimed):
            return "is at a target that another object has"
        heights = [goal.targets[index][0][2] for index in claimed]
        wanted = min(heights, key=lambda height: abs(height - pose[0][2]))
        unsupported = _would_be_unsupported(number, pose, wanted - pose[0][2] + low, view)
        return (
            f"is at its target but for the height: it reaches from {abs(low):.3f} m up, the target is at {wanted:.3f} m"
            f"{', where nothing would hold it' if unsupported else ''}"
        )

    def _score_zone_object(self, goal: Goal, number: int, view: SceneView) -> tuple[float, str]:
        ceiling = float(self.task.zone_bounds[2, 1])
        share = volume_share_in_zones(view.object_volume(number), view.object_pose(number), goal.zones, ceiling)
        if share < 0.01:
            return 0.0, "is not in its zone"
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
        start = self._outlines[number]
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
