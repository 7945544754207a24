"""The strict score of a scene: every goal judged as the scene stands, with height, support, tilt and rest.

The published score (``task_accounting``) ignores height and tilt, lets two objects claim the same target and keeps
credit for a goal that was undone later. An object counts here if the published score counts it and, besides,

* it rests at the height of the target: its centre or its underside is within 15 mm of it; or the target lies in or on
  another object and it rests on that object (a plate's rim is higher than its bottom), or within it on the table (a
  fixture, a mark); or it rests on objects that hold their own targets, as far below it as those are below its own
  (levels a little higher than the blocks); in a zone, its underside lies no higher than the zone's top; objects that
  share a target or a zone may rest on each other;
* if the target lies between the walls of a container, it lies in that container, as a typed goal would ask;
* it stands no more than ``rot_eps`` more tilted than at the start, and lies still, let go by the robot;
* no other object claims its target, unless the goal lets objects share.

An object that later goals name is judged by the last of them. Other objects that were knocked over lower the whole
score.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.planning_scene import (
    PlanningScene,
    describe_tilt,
    enclosing_object_ids,
    has_toppled,
    is_at_rest,
    is_target_tilted,
    mark_ids_under_object,
    supporting_object_ids,
)
from grs_agents.sim.goals.relation_rules import explain_goal_shortfalls, explain_not_inside
from grs_agents.sim.goals.scene_report import describe_goal, format_point, measure_object_motions
from grs_agents.sim.goals.scores import MET
from grs_agents.sim.goals.task_accounting import ScoredTask, symmetric_yaw_difference
from grs_agents.sim.instance.episode import EndState, GoalOutcome
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.world.collision_volumes import volume_share_in_zones
from grs_agents.sim.world.footprints import margins_inside_outline, object_prism_at_pose

_POINT: Final = np.zeros((1, 2))
_HEIGHT: Final = 0.015
"""Tolerance on the height of a target, metres, whatever ``pos_eps`` is: less than half the lowest level of a stack."""
_WALLS: Final = 0.025
"""Containers with lower walls (m) are plates and trays: objects rest on their rims."""


class StrictScorer:
    """Scores a scene strictly, against the poses in which every object had settled."""

    def __init__(self, task: ScoredTask, table: TabletopSim) -> None:
        self.task, self.table = task, table

    def measure_scene(self) -> EndState:
        """The state of goals and objects now."""
        scene = PlanningScene(self.table, self.task.grs.stated, self.task.goals)
        published = self.task.grs.published_reward_shares()
        notes: dict[int, str] = {}
        outcomes: list[GoalOutcome] = []
        final: dict[int, float] = {}
        for goal, earned in zip(reversed(self.task.grs.stated), reversed(published), strict=True):
            outcomes.insert(0, self._build_goal_outcome(goal, earned, scene, final, notes))
        value = min(1.0, sum(outcome.worth * outcome.strict for outcome in outcomes))
        bystanders = [number for number in scene.object_ids if scene.is_object_movable(number) and number not in final]
        fallen = [number for number in bystanders if has_toppled(number, scene, self.task.rot_eps)]
        notes.update({number: f"{scene.object_label(number)} was knocked over" for number in fallen})
        return EndState(
            reward=self.task.grs.total,
            complete=bool(outcomes) and not self.task.goals,
            strict=round(value * (1 - len(fallen) / max(1, len(bystanders))), 9),
            weakest=0.0 if fallen else round(min((outcome.strict for outcome in outcomes), default=0.0), 9),
            shortfalls=tuple(notes.values()),
            goals=tuple(outcomes),
            motions=measure_object_motions(scene),
            placed=sum(score > MET for score in final.values()),
            wanted=len(final),
        )

    def _build_goal_outcome(
        self, goal: Goal, earned: float, scene: PlanningScene, final: dict[int, float], notes: dict[int, str]
    ) -> GoalOutcome:
        """The outcome of a goal, later goals first.

        Args:
            final: score by object in the last goal that names it; gains the objects of this goal that it lacks.
            notes: clause by object that falls short in its last goal; gains those of this goal.
        """
        if goal.relation is not None:
            explained = explain_goal_shortfalls(goal, scene, self.task.rot_eps)
            scored = [(float(not clause), clause) for clause in explained]
        else:
            claimed: dict[int, int] = {}  # row to target
            if goal.metric == "pose":
                options = [
                    [
                        column
                        for column in goal.allowed_target_indices(row)
                        if self._is_at_target(goal, row, column, scene)
                    ]
                    for row in range(len(goal.objects))
                ]
                free_choice = {row: columns[0] for row, columns in enumerate(options) if columns}
                claimed = free_choice if goal.replace else match_rows_to_targets(options)
            scored = [self._score_object(goal, row, claimed, scene) for row in range(len(goal.objects))]
        rows: list[float] = []
        clauses: list[str] = []
        for number, (score, trouble) in zip(goal.objects, scored, strict=True):
            rows.append(max(score, final.get(number, 0.0)))
            if trouble:
                moved_on = ", where a later goal wants it" if number in final and rows[-1] > score else ""
                clauses.append(f"{scene.object_label(number)} {trouble}{moved_on}")
                if number not in final:
                    notes.setdefault(number, clauses[-1])
            final.setdefault(number, rows[-1])
        strict = float(np.mean(rows))
        if strict > earned == 0.0 and goal is not self.task.goals[0]:
            clauses.append("it earns nothing as long as a goal before it is open")
        return GoalOutcome(
            goal=describe_goal(goal, scene, self.task.pos_eps),
            worth=goal.max_reward,
            published=earned,
            strict=strict,
            shortfalls=tuple(clauses),
        )

    def _score_object(self, goal: Goal, row: int, claimed: dict[int, int], scene: PlanningScene) -> tuple[float, str]:
        """Score of an object of a ``pose`` or ``zone`` goal, and a clause for a score below 1."""
        number = goal.objects[row]
        pose = scene.object_pose(number)
        toppled = has_toppled(number, scene, self.task.rot_eps)
        if toppled and self.task.sixdof and goal.metric == "pose":  # unless it has the tilt of a tilted target
            up = transforms.quaternion_to_matrix(pose[1])[:, 2]
            targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
            toppled = not any(
                is_target_tilted(target)
                and float(up @ transforms.quaternion_to_matrix(target[1])[:, 2]) > math.cos(self.task.rot_eps)
                for target in targets
            )
        if toppled:
            return 0.0, f"does not stand upright: {describe_tilt(number, scene)}"
        if not is_at_rest(number, scene):
            return 0.0, "does not lie still"
        if goal.metric == "zone":
            return self._score_zone_object(goal, number, scene)
        if row not in claimed:
            return 0.0, self._explain_missed_target(goal, row, scene)
        target = goal.targets[claimed[row]]
        if self.task.sixdof and is_target_tilted(target):  # height and tilt show that it hangs in its container
            return 1.0, ""
        trouble = _explain_not_in_its_container(number, target, scene)
        return float(not trouble), trouble

    def _score_zone_object(self, goal: Goal, number: int, scene: PlanningScene) -> tuple[float, str]:
        pose, low = scene.object_pose(number), scene.object_prism(number).low
        ceiling = float(self.task.zone_bounds[2, 1])
        share = volume_share_in_zones(scene.object_volume(number), pose, goal.zones, ceiling)
        if share < 0.01:
            return 0.0, f"is not in its zone, it is at {format_point(pose[0])}"
        top = max(zone.pose[0][2] + zone.size[2] / 2 for zone in goal.zones)
        same_zones = [
            stated for stated in self.task.grs.stated if stated is goal or (stated.zones and stated.zones == goal.zones)
        ]
        fellows = {member for stated in same_zones for member in stated.objects}
        if low > max(0.0, top) + _HEIGHT and not _is_supported_only_by(number, fellows, scene):
            return 0.0, f"rests at {low:.2f} m, above its zone"
        return (1.0, "") if share > MET else (share, f"is {share:.0%} in its zone")

    def _explain_missed_target(self, goal: Goal, row: int, scene: PlanningScene) -> str:
        """Clause on an object that holds none of its targets."""
        number = goal.objects[row]
        pose, low = scene.object_pose(number), scene.object_prism(number).low
        allowed = goal.allowed_target_indices(row)
        if not allowed:
            return "has no target: its row of matches is all zeros"
        reached = [index for index in allowed if self.task.is_match(pose, goal.targets[index], goal.symmetries[row])]
        if not reached:
            targets = [goal.targets[index] for index in allowed]
            away, nearest = min((math.dist(target[0][:2], pose[0][:2]), target) for target in targets)
            place = f"its target at {format_point(nearest[0])}"
            if away >= self.task.pos_eps:
                return f"is {away:.3f} m from {place}, {self.task.pos_eps:.3g} m are allowed"
            turn = symmetric_yaw_difference(
                transforms.yaw_of_quaternion(pose[1]), transforms.yaw_of_quaternion(nearest[1]), goal.symmetries[row]
            )
            most = math.degrees(self.task.rot_eps)
            return f"is turned by {math.degrees(turn):.0f} degrees against {place}, {most:.0f} are allowed"
        if any(self._is_at_target(goal, row, index, scene) for index in reached):
            return "is at a target that another object has"
        heights = [goal.targets[index][0][2] for index in reached]
        wanted = min(heights, key=lambda height: abs(height - pose[0][2]))
        underside, center = wanted - pose[0][2] + low, np.array([pose[0][:2]])
        supported = underside <= _HEIGHT or any(
            abs(prism.high - underside) <= _HEIGHT and margins_inside_outline(_POINT, prism.outline, center)[0] >= 0
            for prism in scene.prisms_of_other_objects(number)
        )
        return (
            f"is at its target but for the height: it reaches from {abs(low):.3f} m up, the target is at {wanted:.3f} m"
            f"{'' if supported else ', where nothing would hold it'}"
        )

    def _is_at_target(self, goal: Goal, row: int, index: int, scene: PlanningScene) -> bool:
        """Whether an object is at a target, its height included: see the rules at the top of the module."""
        number, target = goal.objects[row], goal.targets[index]
        pose = scene.object_pose(number)
        if not self.task.is_match(pose, target, goal.symmetries[row]):
            return False
        heights = (pose[0][2], scene.object_prism(number).low)
        if any(abs(height - target[0][2]) <= _HEIGHT for height in heights):
            return True
        half, under = heights[0] - heights[1] + _HEIGHT, supporting_object_ids(number, scene)
        if any(
            self._is_target_in_or_on_object(carrier, target, half)
            for carrier in under or mark_ids_under_object(number, scene)
        ):
            return True
        if any(self._is_target_in_or_on_object(walls, target, 0.0) for walls in enclosing_object_ids(number, scene)):
            return True
        if under and all(self._is_support_at_lower_target(carrier, number, target, scene) for carrier in under):
            return True
        sharers = set(goal.objects) if goal.replace else set[int]()  # objects wanted at this place or an equal target
        for stated in self.task.grs.stated:
            for member, column in np.argwhere(stated.matches).tolist():
                if stated is not goal or stated.targets[column] is not target:
                    apart = np.abs(np.subtract(stated.targets[column][0], target[0]))
                    if (apart <= (self.task.pos_eps, self.task.pos_eps, _HEIGHT)).all():
                        sharers.add(stated.objects[int(member)])
        return _is_supported_only_by(number, sharers - {number}, scene)

    def _is_support_at_lower_target(self, under: int, number: int, target: Pose, scene: PlanningScene) -> bool:
        """Whether the carrier of an object holds a target as far below the object's as it is below the object."""
        rises = (
            scene.object_pose(number)[0][2] - scene.object_pose(under)[0][2],
            scene.object_prism(number).low - scene.object_prism(under).low,
        )
        if rises[1] <= 0:
            return False
        return any(
            any(abs(target[0][2] - goal.targets[index][0][2] - rise) <= _HEIGHT for rise in rises)
            and self._is_at_target(goal, goal.objects.index(under), index, scene)
            for goal in self.task.grs.stated
            if goal.metric == "pose" and under in goal.objects
            for index in goal.allowed_target_indices(goal.objects.index(under))
        )

    def _is_target_in_or_on_object(self, number: int, target: Pose, half: float) -> bool:
        """Whether a target lies within an object at its start pose, or at most ``half`` (m) above its top."""
        start = object_prism_at_pose(self.table.object_model(number), self.table.places[number])
        aside = -margins_inside_outline(_POINT, start.outline, np.array([target[0][:2]]))[0]
        return bool(aside <= self.task.pos_eps and start.low <= target[0][2] <= start.high + half)


def _is_supported_only_by(number: int, fellows: set[int], scene: PlanningScene) -> bool:
    under = supporting_object_ids(number, scene)
    return bool(under) and under <= fellows


def _explain_not_in_its_container(number: int, target: Pose, scene: PlanningScene) -> str:
    """Clause on an object outside the container whose walls surround its target; "" if it lies inside, or none do."""
    half = scene.object_pose(number)[0][2] - scene.object_prism(number).low
    point = np.array([target[0][:2]])
    for container in scene.object_ids:
        if (
            container == number
            or not scene.is_object_hollow(container)
            or not scene.is_point_over_object(container, target[0])
        ):
            continue
        walls = scene.object_prism(container)
        if any(
            prism.high > walls.high - _HEIGHT and margins_inside_outline(_POINT, prism.outline, point)[0] >= 0
            for prism in scene.collider_prisms(container)
        ):
            continue  # solid up to its rim under the target, as the deck of a pallet
        if walls.high - walls.low > _WALLS and target[0][2] - half < walls.high - _HEIGHT:
            return explain_not_inside(number, container, scene)
    return ""


def match_rows_to_targets(options: Sequence[Sequence[int]]) -> dict[int, int]:
    """Maximum bipartite matching of rows to their optional targets: row to target."""
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
