"""The oracle: plans from ground truth towards the goals, clears blockers first, and reports why it stops.

A rope is placed bead by bead, by the move that is predicted to bring the whole chain nearest to its places.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.end_effectors import Grasps
from grs_agents.sim.expert.pose_placement import TRIES, choose_pose_target, find_tilted_place_pose
from grs_agents.sim.expert.relation_placement import RelationPlanner
from grs_agents.sim.expert.zone_packing import find_occupied_zone_target, pack_objects_into_zone, unplaced_zone_members
from grs_agents.sim.goals.planning_scene import (
    PlanningScene,
    carried_object_ids,
    describe_unmovables,
    has_toppled,
    make_oracle_stop,
)
from grs_agents.sim.goals.scores import MET
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import Stop, set_last_recorder
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.motion.placement import (
    BlockedTarget,
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
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.world.footprints import Prism, rest_heights_at_offsets

_CLIMB: Final = 0.012
"""Greatest rise of an object that is put aside, metres: never on top of its neighbours."""


@dataclass(frozen=True)
class PlannedSpot:
    """A spot, and the pose of its object at planning time: the turn is relative to that."""

    spot: Spot
    pose: Pose


class Planner:
    """Chooses targets; caches the packing of each zone."""

    def __init__(self) -> None:
        self._plans: dict[Zone, dict[int, PlannedSpot]] = {}
        self._relations = RelationPlanner()

    def choose_target(self, goal: Goal, row: int, task: ScoredTask, scene: PlanningScene, lift: float) -> Target:
        """Target of the object of a row of a goal, or the reason for none; it may share a zone with later goals.

        ``lift`` is from the object's lowest point to the tip that holds it, metres.
        """
        if goal.relation is not None:
            return self._relations.choose_target(goal, row, task, scene, lift)
        if goal.metric == "pose":
            return choose_pose_target(goal, row, task, scene, lift)
        number, reasons = goal.objects[row], list[Target]()
        for zone in goal.zones:
            planned = self._plans.get(zone, {}).get(number)
            if planned is not None and _is_plan_valid(planned, number, scene, lift):
                return planned.spot
            members = unplaced_zone_members(zone, task)
            plan = pack_objects_into_zone(zone, [number, *(other for other in members if other != number)], scene, lift)
            self._plans[zone] = {member: PlannedSpot(spot, scene.object_pose(member)) for member, spot in plan.items()}
            if number in plan:
                return plan[number]
            reasons.append(find_occupied_zone_target(zone, number, members, task, scene, lift))
        blocked = [reason for reason in reasons if isinstance(reason, Spot | BlockedTarget)]
        return blocked[0] if blocked else reasons[0]

    def goal_rows_to_move(self, goal: Goal, scene: PlanningScene) -> list[int]:
        """Rows of a ``stacked`` or ``aligned`` goal whose objects must move, in order."""
        return self._relations.goal_rows_to_move(goal, scene)


def _is_plan_valid(planned: PlannedSpot, number: int, scene: PlanningScene, lift: float) -> bool:
    """Whether an object is still where it was at planning time, and its spot still free."""
    pose, spot = scene.object_pose(number), planned.spot
    if (
        float(np.abs(np.subtract(pose[0], planned.pose[0])).max()) > 0.003
        or abs(wrap_angle(transforms.yaw_of_quaternion(pose[1]) - transforms.yaw_of_quaternion(planned.pose[1]))) > 0.03
    ):
        return False
    shape = rotated_outline_at_origin(scene.object_prism(number), np.asarray(pose[0][:2]), spot.turn)
    offset = np.array([spot.center])
    height = rest_heights_at_offsets(shape, scene.prisms_of_other_objects(number), offset, 0.001)
    return bool(abs(height[0] - spot.height) < 0.01 and ReachTest(lift, scene.arm)(offset, height)[0])


def find_spot_aside(number: int, keep_free: Sequence[Prism], scene: PlanningScene, lift: float) -> Spot | None:
    """A spot out of the way, near the object: within its container if there is room, else on the table."""
    body, center = scene.object_prism(number), scene.object_pose(number)[0]
    reserved = [Prism(prism.outline, 0.0, 1.0) for prism in keep_free]
    for goal in scene.open_goals:  # targets of pose goals for other objects
        for other in goal.objects if goal.metric == "pose" else ():
            origin = np.asarray(scene.object_pose(other)[0][:2])
            for target in goal.targets if other != number else ():
                angle = transforms.yaw_of_quaternion(target[1]) - scene.object_yaw(other)
                shape = rotated_outline_at_origin(scene.object_prism(other), origin, angle)
                reserved.append(Prism(shape.outline + np.asarray(target[0][:2]), 0.0, 1.0))
    others = [other for other in scene.object_ids if other != number]
    holders = [other for other in others if scene.is_object_hollow(other) and scene.is_point_over_object(other, center)]
    taken = [*scene.obstacles_to_plan_around([number], holders), *reserved]
    receivers = [  # marks and containers, which goals fill
        scene.object_prism(other)
        for other in others
        if not scene.object_model(other).colliders or scene.is_object_hollow(other)
    ]
    unmarked = [*taken, *(Prism(mark.outline, 0.0, 1.0) for mark in receivers)]
    (x0, x1), (y0, y1), _ = scene.bounds.tolist()
    table = _region_from_bounds(x0, y0, x1, y1)
    tries = [(_region_from_bounds(*scene.object_prism(holder).bounding_box_xy), 0.003, taken) for holder in holders]
    for region, gap, obstacles in (*tries, (table, 0.03, unmarked), (table, 0.01, unmarked)):
        turns, suits = [0.0, np.pi / 2, np.pi / 4], ReachTest(lift, scene.arm)
        spot = find_free_spot(body, center, turns, region, obstacles, gap, suits, spread=True, near=center)
        if spot is not None and spot.height <= max(body.low, 0.0) + _CLIMB:
            return spot
    return None


def _region_from_bounds(x0: float, y0: float, x1: float, y1: float) -> Region:
    return Region(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0), 0.0)


_SAMPLES: Final = 24
_MISS: Final = 0.02
"""Extra cost of a bead out of tolerance, metres."""


def is_rope_goal(goal: Goal, scene: PlanningScene) -> bool:
    """Whether the objects of a goal are tied in a row, in order, each with its own target."""
    if goal.metric != "pose" or len(goal.objects) < 3 or len(goal.targets) != len(goal.objects):
        return False
    tied = {frozenset((tie.parent, tie.child)) for tie in scene.ties}
    return all(frozenset(pair) in tied for pair in pairwise(goal.objects)) and bool(_rope_targets_from_either_end(goal))


def _rope_targets_from_either_end(goal: Goal) -> list[FloatArray]:
    """Targets (N, 2) in the order of the beads, from either end, as far as the goal allows."""
    targets, count = np.array([pose[0][:2] for pose in goal.targets]), len(goal.objects)
    orders = (np.arange(count), np.arange(count)[::-1])
    return [targets[order] for order in orders if all(goal.matches[row][target] for row, target in enumerate(order))]


class RopePlanner:
    """Plans rope moves; remembers which end of each rope goes to which end of its targets."""

    def __init__(self) -> None:
        self._chosen: dict[tuple[int, ...], FloatArray] = {}

    def rank_bead_moves(
        self, goal: Goal, scene: PlanningScene, pos_eps: float, tries: Sequence[int]
    ) -> list[tuple[int, FloatArray]]:
        """Rows of beads to move and their targets (2,), metres, most useful first; empty once all are in place.

        ``tries`` counts the earlier moves of each row, which did not have the predicted effect.
        """
        beads = np.array([scene.object_pose(number)[0][:2] for number in goal.objects])
        key = goal.objects
        if key not in self._chosen:
            ways = _rope_targets_from_either_end(goal)
            self._chosen[key] = min(ways, key=lambda way: float(np.linalg.norm(way - beads, axis=1).sum()))
        wanted = self._chosen[key]
        now = _rope_placement_cost(beads, wanted, pos_eps)
        after = np.array(
            [
                _rope_placement_cost(predict_dragged_rope(beads, row, wanted[row]), wanted, pos_eps)
                for row in range(len(beads))
            ]
        )
        off = np.linalg.norm(wanted - beads, axis=1)
        after += _TRIED * np.asarray(tries)
        order = sorted(range(len(beads)), key=lambda row: (after[row] > now, round(float(after[row]), 4), -off[row]))
        return [(row, wanted[row]) for row in order if off[row] > 0.3 * pos_eps]


def predict_dragged_rope(beads: FloatArray, row: int, target: FloatArray) -> FloatArray:
    """Positions of beads (N, 2) after dragging a bead straight to a target (2,), metres.

    Model: a chain of rods on a rough table, each following the rod ahead.
    """
    points = beads.copy()
    lengths = np.linalg.norm(np.diff(beads, axis=0), axis=1)
    for share in np.linspace(0.0, 1.0, _SAMPLES)[1:]:
        points[row] = beads[row] + share * (target - beads[row])
        for index in range(row + 1, len(points)):
            points[index] = _restore_bead_spacing(points[index], points[index - 1], lengths[index - 1])
        for index in range(row - 1, -1, -1):
            points[index] = _restore_bead_spacing(points[index], points[index + 1], lengths[index])
    return points


def _restore_bead_spacing(point: FloatArray, leader: FloatArray, length: float) -> FloatArray:
    x, y = point[0] - leader[0], point[1] - leader[1]
    scale = length / max(float((x * x + y * y) ** 0.5), 1e-9)
    return np.array([leader[0] + scale * x, leader[1] + scale * y])


def _rope_placement_cost(beads: FloatArray, wanted: FloatArray, pos_eps: float) -> float:
    off = np.linalg.norm(beads - wanted, axis=1)
    return float((off + _MISS * np.clip(off / (0.7 * pos_eps) - 0.4, 0.0, 1.0)).sum())


_TRIED: Final = 0.02
"""Extra cost of moving a bead again, per earlier move, metres."""
Action = dict[str, Pose]
_ATTEMPTS: Final = 4
_DROPS: Final = (0.0, 0.03, 0.06)
"""Heights above a spot from which an object is let go, metres: where the hand finds no room lower down, as in a box."""


class Oracle:
    """Solves a task with what the environment knows.

    Example::

        agent = task.oracle(env)
        obs = env.reset()
        info = env.info
        for _ in range(task.max_steps):
            act = agent.act(obs, info)
            if act is None:
                break
            obs, reward, done, info = env.step(act)
            if done:
                break
    """

    def __init__(self, task: ScoredTask, table: TabletopSim) -> None:
        self.task, self.table = task, table
        self._episode: Any = None
        self._last: tuple[int, int] | None = None  # the attempt of the last action
        self.packings: dict[Any, Any] = {}  # see ``PlanningScene``; may be shared
        self._reset_episode_memory()

    def act(self, obs: Any = None, info: Any = None) -> Action | None:
        """The next pick and place; None if nothing is left to do or nothing can be done."""
        del obs, info
        if self._episode is not self.table.recorder:
            self._episode = self.table.recorder
            self._reset_episode_memory()
        attempt, actions = self._last, self.table.recorder.actions
        if attempt is not None and actions:  # an action repeated with the same outcome is hopeless: no further attempt
            last = actions[-1]
            known = (attempt, last.note, *np.round((last.pick, last.place), 3).ravel().tolist())
            if known in self._known:
                self._attempts[attempt] = _ATTEMPTS
            self._known.add(known)
            self._last = None
        self.table.recorder.stop = None
        if not self.task.grs.stated:
            decision = Stop("nothing_to_do", "the task states no goal: its reset() never calls add_goal")
        elif not self.task.goals:
            decision = Stop("success", "every goal is met")
        else:
            scene = PlanningScene(self.table, self.task.grs.stated, self.task.goals, self.packings)
            decision = self._plan_for_unmet_goals(scene)
        if isinstance(decision, Stop):
            self.table.recorder.stop = decision
            set_last_recorder(self.table.recorder)
            return None
        return decision

    def _reset_episode_memory(self) -> None:
        """Forget the attempts of the last episode."""
        self._attempts: dict[tuple[int, int], int] = {}
        self._known: set[tuple[Any, ...]] = set()
        self._last = None
        self._planner = Planner()
        self._ropes = RopePlanner()

    def _plan_for_unmet_goals(self, scene: PlanningScene) -> Action | Stop:
        """The next action for open goals, or the reason for none."""
        for goal in self.task.goals:
            if is_rope_goal(goal, scene):  # the most useful bead that can be picked
                tries = [self._attempts.get((len(self.task.goals), number), 0) for number in goal.objects]
                for row, target in self._ropes.rank_bead_moves(goal, scene, self.task.pos_eps, tries):
                    attempt = (len(self.task.goals), goal.objects[row])
                    tried = self._attempts.get(attempt, 0)
                    holds = self.find_holds(attempt[1], scene, tried + 1) if tried < _ATTEMPTS else None
                    spot = Spot((float(target[0]), float(target[1])), 0.0, 0.0)
                    if isinstance(holds, tuple):
                        reachable = ReachTest(holds[0][0][2], self.table.arm)(np.array([spot.center]), np.zeros(1))
                        if reachable[0]:
                            return self._make_action_for_attempt(attempt, holds, spot, scene)
            reasons: list[Stop] = []
            for row in self._unplaced_rows_in_order(goal, scene):
                plan = self._plan_object_action(goal, row, scene, ())
                if not isinstance(plan, Stop):
                    return plan
                reasons.append(plan)
            if reasons:
                return reasons[0]
        return self._make_nothing_to_move_stop()

    def _make_nothing_to_move_stop(self) -> Stop:
        """The stop when goals are open, yet no object is left to move."""
        if not self.table.recorder.actions:
            return Stop("nothing_to_do", "every object is at its target already, before the robot does anything")
        clauses = self.table.recorder.build_episode().shortfalls
        why = f": {clauses[0]}" if clauses else ""
        return Stop("partial", f"no object is left to move, yet {len(self.task.goals)} goals are not met{why}")

    def _make_action_for_attempt(
        self, attempt: tuple[int, int], holds: Sequence[Pose], spot: Spot, scene: PlanningScene
    ) -> Action:
        """Carry the object of an attempt to a spot, keeping the hand's place on it; the attempt counts.

        Of ``holds`` it takes the first, after a failure a later one.
        """
        self._count_attempt(attempt)
        number = attempt[1]
        hold = holds[(self._attempts[attempt] - 1) % len(holds)]  # another one after a failure
        return {"pose0": hold, "pose1": _carry_to_spot(hold, number, spot, scene)}

    def _count_attempt(self, attempt: tuple[int, int]) -> None:
        self._attempts[attempt] = self._attempts.get(attempt, 0) + 1
        self._last = attempt

    def _unplaced_rows_in_order(self, goal: Goal, scene: PlanningScene) -> list[int]:
        """Rows of the goal whose objects are not placed yet: low targets and big objects first."""
        scores = self.task.grs.score_goal_objects(goal)
        if goal.relation_kind in ("stacked", "aligned"):
            met = min(scores) >= MET
            return [] if met else self._planner.goal_rows_to_move(goal, scene)
        rows = [row for row, score in enumerate(scores) if score < MET]

        def key(row: int) -> tuple[float, float, int]:
            heights = [goal.targets[index][0][2] for index in goal.allowed_target_indices(row)]
            lowest = min(heights, default=0.0) if goal.metric == "pose" else 0.0
            size = scene.object_extent_xy(goal.objects[row])
            return (round(lowest, 3), -size[0] * size[1], row)

        return sorted(rows, key=key)

    def _plan_object_action(
        self, goal: Goal, row: int, scene: PlanningScene, waiting: tuple[int, ...]
    ) -> Action | Stop:
        """The action that brings an object of a goal nearer to its target, or the reason for none.

        ``waiting`` are the objects that wait for this one to move, the first of them for all others.
        """
        number = goal.objects[row]
        attempt = (len(self.task.goals), number)
        if self._attempts.get(attempt, 0) >= _ATTEMPTS:
            name = scene.object_label(number)
            tries = [action for action in self.table.recorder.actions if action.object in (number, None)]
            trouble = tries[-1].trouble if tries else None
            last = f"; last: {tries[-1].note}" if tries else ""
            point = format_point(scene.object_pose(number)[0])
            detail = f"{name} was not brought to its target, it is at {point}{last}"
            toppled = has_toppled(number, scene, np.pi / 4)
            return make_oracle_stop("toppled" if toppled else trouble or "dropped", detail, scene, number)
        holds = self.find_holds(number, scene)
        if isinstance(holds, Stop):
            return holds
        if isinstance(holds, BlockedTarget):
            return self._plan_blocker_removal(holds, number, scene, waiting)
        tilted = find_tilted_place_pose(goal, row, self.task, scene, holds[0])
        if tilted is not None and self._attempts.get(attempt, 0) < TRIES:
            self._count_attempt(attempt)
            return {"pose0": holds[0], "pose1": tilted}
        lift = holds[0][0][2] - scene.object_prism(number).low
        target = self._planner.choose_target(goal, row, self.task, scene, lift)
        if isinstance(target, BlockedTarget):
            cleared = self._plan_blocker_removal(target, number, scene, waiting)
            if target.otherwise is None or not isinstance(cleared, Stop):
                return cleared
            target = target.otherwise
        if isinstance(target, Stop):
            return target
        served = self._find_holds_for_spot(attempt, holds, target, scene)
        if isinstance(served, BlockedTarget):
            return self._plan_blocker_removal(served, number, scene, waiting)
        return served if isinstance(served, Stop) else self._make_action_for_attempt(attempt, *served, scene)

    def find_holds(self, number: int, scene: PlanningScene, wanted: int = 1) -> tuple[Pose, ...] | BlockedTarget | Stop:
        """Poses of the tip that take an object, best first, or the object in their way, or why it cannot be picked.

        The search ends with ``wanted`` of them.
        """
        carried = carried_object_ids(number, scene)
        immovable = self._stop_if_object_immovable(number, carried, scene)
        if immovable is not None:
            return immovable
        if carried and not scene.is_object_hollow(number):
            return BlockedTarget(carried[0])
        found = self.table.end_effector.find_grasps(
            scene.physics, number, scene.object_prism(number), scene.prisms_of_other_objects(number), wanted
        )
        return found.poses or self._explain_missing_grasps(found, number, scene)

    def _find_holds_for_spot(
        self, attempt: tuple[int, int], holds: tuple[Pose, ...], spot: Spot, scene: PlanningScene
    ) -> tuple[tuple[Pose, ...], Spot] | BlockedTarget | Stop:
        """Holds with which the hand has room at a spot, and the spot, or a little above it; else as ``find_holds``.

        There are as many as the next try of an attempt needs.
        """
        hand, first, number = self.table.end_effector, Grasps(()), attempt[1]
        wanted = self._attempts.get(attempt, 0) + 1
        for drop in _DROPS:
            above = replace(spot, height=spot.height + drop)

            def carry(hold: Pose, above: Spot = above) -> Pose:
                return _carry_to_spot(hold, number, above, scene)

            found = hand.find_grasps_for_place(scene.physics, number, Grasps(holds), carry, wanted)
            if found.poses:
                return found.poses, above
            first = found if drop == 0.0 else first
        return self._explain_missing_grasps(first, number, scene)

    def _explain_missing_grasps(self, found: Grasps, number: int, scene: PlanningScene) -> BlockedTarget | Stop:
        """The object that is in the way of all grasps, if it can be moved, else the reason why there are none."""
        movable = [other for other in found.hindered_by if scene.may_robot_move(other)]
        if movable:  # off it altogether: moved within it, it would cover it again
            return BlockedTarget(movable[0], (scene.object_prism(number),))
        name = scene.object_label(number)
        if found.why:
            blocked = f": {describe_unmovables(found.hindered_by, scene)}" if found.hindered_by else ""
            detail = found.why.format(name=name) + blocked
            return make_oracle_stop(found.trouble or "unreachable", detail, scene, number, *found.hindered_by)
        over = [other for other in found.hindered_by if other in found.covered_by]
        beside = [other for other in found.hindered_by if other not in found.covered_by]
        reasons = [f"the top of {name} is covered by {describe_unmovables(over, scene)}"] if over else []
        if beside:
            reasons.append(f"{name} leaves no room for the cup beside {describe_unmovables(beside, scene)}")
        return make_oracle_stop("unreachable", "; ".join(reasons), scene, number, *found.hindered_by)

    def _stop_if_object_immovable(self, number: int, carried: Sequence[int], scene: PlanningScene) -> Stop | None:
        """The stop for an object that, with its load, cannot be moved at all; None if it can."""
        name, position = scene.object_label(number), scene.object_pose(number)[0]
        if not scene.is_object_movable(number):
            return make_oracle_stop("error", f"{name} is 'fixed' and cannot be moved; add it as 'rigid'", scene, number)
        top = (position[0], position[1], scene.object_prism(number).high)
        if not self.table.arm.can_reach_point(top):
            detail = f"object {name} at {format_point(position)} {describe_out_of_reach(top, self.table.arm)}"
            return make_oracle_stop("unreachable", detail, scene, number)
        staying = [other for other in carried if not scene.may_robot_move(other)]
        if staying:
            detail = f"{name} cannot be moved: it carries {describe_unmovables(staying, scene)}"
            return make_oracle_stop("unreachable", detail, scene, number, *staying)
        return None

    def _plan_blocker_removal(
        self, blocked: BlockedTarget, number: int, scene: PlanningScene, waiting: tuple[int, ...]
    ) -> Action | Stop:
        """Move a blocker: to its own target if it has one and does not wait in turn, else aside."""
        blocker, attempt, waiting = blocked.blocker, (-1, blocked.blocker), (*waiting, number)

        def make_blocked_stop(why: str) -> Stop:
            taken = f"{scene.object_label(number)}: its way or target is occupied by {scene.object_label(blocker)}"
            return make_oracle_stop(
                "target_occupied", f"{taken}, which cannot be moved aside: {why}", scene, number, blocker
            )

        vain = self._attempts.get(attempt, 0) >= _ATTEMPTS
        if vain or waiting.count(blocker) > 1:
            return make_blocked_stop("it was tried in vain" if vain else "each of the two is in the other's way")
        for goal in self.task.goals if blocker not in waiting else ():
            scores = self.task.grs.score_goal_objects(goal)
            if blocker in goal.objects and scores[goal.objects.index(blocker)] < MET:
                plan = self._plan_object_action(goal, goal.objects.index(blocker), scene, waiting)
                if not isinstance(plan, Stop):
                    return plan
        holds = self.find_holds(blocker, scene)
        if isinstance(holds, BlockedTarget):
            return self._plan_blocker_removal(holds, blocker, scene, waiting)
        if isinstance(holds, Stop):
            return make_blocked_stop(holds.detail)
        spot = find_spot_aside(blocker, blocked.keep_free, scene, holds[0][0][2] - scene.object_prism(blocker).low)
        if spot is None:
            return make_blocked_stop("no place on the table is free for it")
        served = self._find_holds_for_spot(attempt, holds, spot, scene)
        if not isinstance(served, tuple):
            return make_blocked_stop("the hand has no room beside a free place for it")
        return self._make_action_for_attempt(attempt, *served, scene)


def _carry_to_spot(hold: Pose, number: int, spot: Spot, scene: PlanningScene) -> Pose:
    """Pose of the tip that brings an object, held at ``hold``, to a spot."""
    (x, y, z), rotation = hold
    center = scene.object_pose(number)[0]
    x, y = x - center[0], y - center[1]
    cos, sin = float(np.cos(spot.turn)), float(np.sin(spot.turn))
    lift = z - scene.object_prism(number).low
    place = (spot.center[0] + cos * x - sin * y, spot.center[1] + sin * x + cos * y, spot.height + lift)
    turn = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, spot.turn))
    return place, turn if rotation == transforms.IDENTITY else transforms.multiply_quaternions(turn, rotation)
