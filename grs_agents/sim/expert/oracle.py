"""The oracle: knows the truth, works from the goals, frees what is in the way, and says why it stops.

For ropes it chooses the bead whose move brings the others along as near to their places as can be.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.expert import placement_planner
from grs_agents.sim.expert.tilted_placement import TRIES, find_tilted_place_pose
from grs_agents.sim.goals.scene_view import (
    SceneView,
    carried_object_ids,
    describe_unmovables,
    has_toppled,
    make_oracle_stop,
)
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import Stop, set_last_recorder
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.motion.grasp import find_grasp
from grs_agents.sim.motion.placement import BlockedTarget, ReachTest, Spot, describe_out_of_reach, format_point
from grs_agents.sim.world.tabletop import Tabletop

_SAMPLES: Final = 24
_MISS: Final = 0.02
"""What a bead out of tolerance costs besides its distance, metres."""


def is_rope_goal(goal: Goal, view: SceneView) -> bool:
    """Whether the objects of a goal are tied in a row, in their order, and each has a place of its own."""
    if goal.metric != "pose" or len(goal.objects) < 3 or len(goal.targets) != len(goal.objects):
        return False
    tied = {frozenset((tie.parent, tie.child)) for tie in view.ties}
    return all(frozenset(pair) in tied for pair in pairwise(goal.objects)) and bool(_rope_targets_from_either_end(goal))


def _rope_targets_from_either_end(goal: Goal) -> list[FloatArray]:
    """Targets (N, 2) in the order of the beads: from either end, as far as the goal allows."""
    targets, count = np.array([pose[0][:2] for pose in goal.targets]), len(goal.objects)
    orders = (np.arange(count), np.arange(count)[::-1])
    return [targets[order] for order in orders if all(goal.matches[row][target] for row, target in enumerate(order))]


class RopePlanner:
    """Remembers from which end each rope is laid: a chain of rods on a rough table, each following the one before."""

    def __init__(self) -> None:
        self._chosen: dict[tuple[int, ...], FloatArray] = {}

    def rank_bead_moves(
        self, goal: Goal, view: SceneView, pos_eps: float, tries: Sequence[int]
    ) -> list[tuple[int, FloatArray]]:
        """Rows of beads to take and where to (2,), metres, the most useful first; empty: all are in place. What was
        tried before (``tries`` of each row) did not bring what the model of the rope promised."""
        beads = np.array([view.object_pose(number)[0][:2] for number in goal.objects])
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
    """Where beads (N, 2) come to lie when one of them is brought straight to a target (2,), metres."""
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
"""What each time that a bead was taken before counts against taking it again, metres."""
Action = dict[str, Pose]
_ATTEMPTS: Final = 4
_PLACED: Final = 0.985


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

    def __init__(self, task: ScoredTask, table: Tabletop) -> None:
        self.task, self.table = task, table
        self._episode: Any = None
        self._last: tuple[int, int] | None = None  # the attempt that the last action was
        self.packings: dict[Any, Any] = {}  # see ``SceneView``; others may share them
        self._reset_episode_memory()

    def act(self, obs: Any = None, info: Any = None) -> Action | None:
        """The next pick and place, or None when there is nothing to do or nothing that can be done."""
        del obs, info
        if self._episode is not self.table.recorder:
            self._episode = self.table.recorder
            self._reset_episode_memory()
        self._remember_last_action()
        self.table.recorder.stop = None
        decision = self._choose_action_or_stop()
        if isinstance(decision, Stop):
            self.table.recorder.stop = decision
            set_last_recorder(self.table.recorder)
            return None
        return decision

    def _reset_episode_memory(self) -> None:
        """A new episode begins."""
        self._attempts: dict[tuple[int, int], int] = {}
        self._known: set[tuple[Any, ...]] = set()
        self._last = None
        self._planner = placement_planner.Planner()
        self._ropes = RopePlanner()

    def _remember_last_action(self) -> None:
        """What has been done twice between the same points with the same outcome is hopeless: it is not tried again."""
        attempt, actions = self._last, self.table.recorder.actions
        if attempt is None or not actions:
            return
        last = actions[-1]
        known = (attempt, last.note, *np.round((last.pick, last.place), 3).ravel().tolist())
        if known in self._known:
            self._attempts[attempt] = _ATTEMPTS
        self._known.add(known)
        self._last = None

    def _choose_action_or_stop(self) -> Action | Stop:
        if not self.task.grs.stated:
            return Stop("nothing_to_do", "the task states no goal: its reset() never calls add_goal")
        if not self.task.goals:
            return Stop("success", "every goal is met")
        return self._plan_for_unmet_goals(SceneView(self.table, self.task.grs.stated, self.task.goals, self.packings))

    def _plan_for_unmet_goals(self, view: SceneView) -> Action | Stop:
        """The next action for the goals that are not met, or why there is none."""
        for goal in self.task.goals:
            if is_rope_goal(goal, view) and (plan := self._plan_rope_action(goal, view)) is not None:
                return plan
            reasons: list[Stop] = []
            for row in self._unplaced_rows_in_order(goal, view):
                plan = self._plan_object_action(goal, row, view, ())
                if not isinstance(plan, Stop):
                    return plan
                reasons.append(plan)
            if reasons:
                return reasons[0]
        return self._make_nothing_to_move_stop()

    def _make_nothing_to_move_stop(self) -> Stop:
        """Goals are open, yet no object is left to move."""
        if not self.table.recorder.actions:
            return Stop("nothing_to_do", "every object is at its target already, before the robot does anything")
        clauses = self.table.recorder.build_episode().shortfalls
        why = f": {clauses[0]}" if clauses else ""
        return Stop("partial", f"no object is left to move, yet {len(self.task.goals)} goals are not met{why}")

    def _plan_rope_action(self, goal: Goal, view: SceneView) -> Action | None:
        """Take the bead of a rope to its place that helps the most; None if none can be taken."""
        tries = [self._attempts.get((len(self.task.goals), number), 0) for number in goal.objects]
        for row, target in self._ropes.rank_bead_moves(goal, view, self.task.pos_eps, tries):
            number = goal.objects[row]
            attempt = (len(self.task.goals), number)
            hold = self.find_pick_point(number, view) if self._attempts.get(attempt, 0) < _ATTEMPTS else None
            spot = Spot((float(target[0]), float(target[1])), 0.0, 0.0)
            if isinstance(hold, tuple) and ReachTest(hold[2], self.table.arm)(np.array([spot.center]), np.zeros(1))[0]:
                return self._make_action_for_attempt(attempt, hold, spot, view)
        return None

    def _make_action_for_attempt(self, attempt: tuple[int, int], hold: Vec3, spot: Spot, view: SceneView) -> Action:
        """Carry the object that an attempt is about to a spot; the attempt counts."""
        self._count_attempt(attempt)
        return _make_pick_place_action(attempt[1], hold, spot, view)

    def _count_attempt(self, attempt: tuple[int, int]) -> None:
        self._attempts[attempt] = self._attempts.get(attempt, 0) + 1
        self._last = attempt

    def _unplaced_rows_in_order(self, goal: Goal, view: SceneView) -> list[int]:
        """Rows of the goal whose objects are not yet placed: low targets and big objects first."""
        scores = self.task.grs.score_goal_objects(goal)
        if goal.relation_kind in ("stacked", "aligned"):
            met = min(scores) >= _PLACED
            return [] if met else self._planner.goal_rows_to_move(goal, view)
        rows = [row for row, score in enumerate(scores) if score < _PLACED]

        def key(row: int) -> tuple[float, float, int]:
            heights = [goal.targets[index][0][2] for index in goal.allowed_target_indices(row)]
            lowest = min(heights, default=0.0) if goal.metric == "pose" else 0.0
            size = view.object_extent_xy(goal.objects[row])
            return (round(lowest, 3), -size[0] * size[1], row)

        return sorted(rows, key=key)

    def _plan_object_action(self, goal: Goal, row: int, view: SceneView, waiting: tuple[int, ...]) -> Action | Stop:
        """The action that brings one object of a goal nearer to its target, or why there is none.

        ``waiting`` are the objects that can move only after this one, first the one that waits for all others.
        """
        number = goal.objects[row]
        attempt = (len(self.task.goals), number)
        if self._attempts.get(attempt, 0) >= _ATTEMPTS:
            return self._make_giving_up_stop(number, view)
        hold = self.find_pick_point(number, view)
        if isinstance(hold, Stop):
            return hold
        if isinstance(hold, BlockedTarget):
            return self._plan_blocker_removal(hold, number, view, waiting)
        tilted = find_tilted_place_pose(goal, row, self.task, view, hold)
        if tilted is not None and self._attempts.get(attempt, 0) < TRIES:
            self._count_attempt(attempt)
            return {"pose0": (hold, transforms.IDENTITY), "pose1": tilted}
        return self._plan_upright_placement(goal, row, hold, view, waiting)

    def _plan_upright_placement(
        self, goal: Goal, row: int, hold: Vec3, view: SceneView, waiting: tuple[int, ...]
    ) -> Action | Stop:
        """Carry the object of a row of a goal, taken at ``hold`` (m), to a target, or free that first."""
        number = goal.objects[row]
        attempt = (len(self.task.goals), number)
        lift = hold[2] - view.object_prism(number).low
        target = self._planner.choose_target(goal, row, self.task, view, lift)
        if isinstance(target, Stop):
            return target
        if isinstance(target, BlockedTarget):
            cleared = self._plan_blocker_removal(target, number, view, waiting)
            if target.otherwise is None or not isinstance(cleared, Stop):
                return cleared
            target = target.otherwise
        return self._make_action_for_attempt(attempt, hold, target, view)

    def find_pick_point(self, number: int, view: SceneView) -> Vec3 | BlockedTarget | Stop:
        """Where to pick an object up, or what lies on it, or why it cannot be picked."""
        carried = carried_object_ids(number, view)
        immovable = self._stop_if_object_immovable(number, carried, view)
        if immovable is not None:
            return immovable
        if carried and not view.is_object_hollow(number):
            return BlockedTarget(carried[0])
        hold = find_grasp(view.physics, number, view.object_prism(number), view.prisms_of_other_objects(number))
        if hold.point is not None:
            return hold.point
        movable = [other for other in hold.covered_by if view.may_robot_move(other)]
        if movable:  # off it altogether: moved about in what it covers, it would cover that again
            return BlockedTarget(movable[0], (view.object_prism(number),))
        name = view.object_label(number)
        if hold.covered_by:
            detail = f"the top of {name} is covered by {describe_unmovables(hold.covered_by, view)}"
            return make_oracle_stop("unreachable", detail, view, number, *hold.covered_by)
        why = "is flat and wide enough for the cup to seal"
        if hold.trouble == "would_tip":
            why = "is so near to the middle of its weight that it would not tip off the cup"
        return make_oracle_stop(hold.trouble or "unreachable", f"no place on top of {name} {why}", view, number)

    def _stop_if_object_immovable(self, number: int, carried: Sequence[int], view: SceneView) -> Stop | None:
        """Why an object, with what it carries, cannot be moved at all; None if it can."""
        name, position = view.object_label(number), view.object_pose(number)[0]
        if not view.is_object_movable(number):
            return make_oracle_stop("error", f"{name} is 'fixed' and cannot be moved; add it as 'rigid'", view, number)
        top = (position[0], position[1], view.object_prism(number).high)
        if not self.table.arm.can_reach_point(top):
            detail = f"object {name} at {format_point(position)} {describe_out_of_reach(top, self.table.arm)}"
            return make_oracle_stop("unreachable", detail, view, number)
        staying = [other for other in carried if not view.may_robot_move(other)]
        if staying:
            detail = f"{name} cannot be moved: it carries {describe_unmovables(staying, view)}"
            return make_oracle_stop("unreachable", detail, view, number, *staying)
        return None

    def _plan_blocker_removal(
        self, blocked: BlockedTarget, number: int, view: SceneView, waiting: tuple[int, ...]
    ) -> Action | Stop:
        """Move what is in the way: to its own target if it has one, else aside, as when it waits in turn."""
        blocker, attempt, waiting = blocked.blocker, (-1, blocked.blocker), (*waiting, number)

        def make_blocked_stop(why: str) -> Stop:
            taken = f"{view.object_label(number)}: its way or target is occupied by {view.object_label(blocker)}"
            return make_oracle_stop(
                "target_occupied", f"{taken}, which cannot be moved aside: {why}", view, number, blocker
            )

        vain = self._attempts.get(attempt, 0) >= _ATTEMPTS
        if vain or waiting.count(blocker) > 1:
            return make_blocked_stop("it was tried in vain" if vain else "each of the two is in the other's way")
        for goal in self.task.goals if blocker not in waiting else ():
            scores = self.task.grs.score_goal_objects(goal)
            if blocker in goal.objects and scores[goal.objects.index(blocker)] < _PLACED:
                plan = self._plan_object_action(goal, goal.objects.index(blocker), view, waiting)
                if not isinstance(plan, Stop):
                    return plan
        hold = self.find_pick_point(blocker, view)
        if isinstance(hold, BlockedTarget):
            return self._plan_blocker_removal(hold, blocker, view, waiting)
        if isinstance(hold, Stop):
            return make_blocked_stop(hold.detail)
        spot = placement_planner.find_spot_aside(
            blocker, blocked.keep_free, view, hold[2] - view.object_prism(blocker).low
        )
        if spot is None:
            return make_blocked_stop("no place on the table is free for it")
        return self._make_action_for_attempt(attempt, hold, spot, view)

    def _make_giving_up_stop(self, number: int, view: SceneView) -> Stop:
        name = view.object_label(number)
        tries = [action for action in self.table.recorder.actions if action.object in (number, None)]
        trouble = tries[-1].trouble if tries else None
        last = f"; last: {tries[-1].note}" if tries else ""
        detail = f"{name} was not brought to its target, it is at {format_point(view.object_pose(number)[0])}{last}"
        toppled = has_toppled(number, view, np.pi / 4)
        return make_oracle_stop("toppled" if toppled else trouble or "dropped", detail, view, number)


def _make_pick_place_action(number: int, hold: Vec3, spot: Spot, view: SceneView) -> Action:
    """Cup poses that carry an object to a spot: the cup keeps its place on the object."""
    center = view.object_pose(number)[0]
    x, y = hold[0] - center[0], hold[1] - center[1]
    cos, sin = float(np.cos(spot.turn)), float(np.sin(spot.turn))
    lift = hold[2] - view.object_prism(number).low
    place = (spot.center[0] + cos * x - sin * y, spot.center[1] + sin * x + cos * y, spot.height + lift)
    return {
        "pose0": (hold, transforms.IDENTITY),
        "pose1": (place, transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, spot.turn))),
    }
