"""What the runtime keeps of a task's episode, apart from the names that programs know, set and override.

Also the published score of CLIPort: how far goals are met, where z and tilt do not count.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.relation_rules import explain_goal_shortfalls
from grs_agents.sim.goals.scene_report import describe_goal
from grs_agents.sim.goals.scene_view import SceneView
from grs_agents.sim.instance.episode import GoalOutcome, SimulationError
from grs_agents.sim.instance.goal import LONGEST_SENTENCE, Goal, normalise_goal_rewards
from grs_agents.sim.instance.task_instance import (
    LARGEST_POS_EPS,
    LARGEST_ROT_EPS,
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
)
from grs_agents.sim.world.collision_volumes import volume_share_in_zones
from grs_agents.sim.world.tabletop import Tabletop, is_number


def symmetric_yaw_difference(first: float, second: float, symmetry: float) -> float:
    """The smallest turn (rad) that aligns two yaws of something that repeats every ``symmetry``; 0 = any yaw."""
    if symmetry <= 0:
        return 0.0
    difference = abs(first - second) % symmetry
    return float(min(difference, symmetry - difference))


def is_pose_at_target(
    pose: Pose, target: Pose, symmetry: float, pos_eps: float = POSITION_TOLERANCE, rot_eps: float = ROTATION_TOLERANCE
) -> bool:
    """Whether ``pose`` is at ``target``: xy within ``pos_eps`` metres, yaw within ``rot_eps`` radians."""
    distance = float(np.hypot(pose[0][0] - target[0][0], pose[0][1] - target[0][1]))
    turn = symmetric_yaw_difference(
        transforms.yaw_of_quaternion(pose[1]), transforms.yaw_of_quaternion(target[1]), symmetry
    )
    return distance < pos_eps and turn < rot_eps


class ScoredTask(Protocol):
    """What scores and oracles read of a task; programs may override each of these."""

    goals: list[Goal]  # not met yet
    lang_goals: list[str]  # a sentence for each of them
    lang_template: str  # for goals without a sentence
    pos_eps: float  # tolerance of ``pose`` goals, metres
    rot_eps: float  # the same, radians
    sixdof: bool  # whether the tilt of a target is asked for
    zone_bounds: npt.NDArray[np.float64]  # (3, 2) lowest and highest x, y, z that count as in a zone, metres
    grs: "TaskAccounting"

    def is_match(self, pose0: Pose, pose1: Pose, symmetry: float) -> bool:
        """Whether two poses agree."""
        ...


class TaskAccounting:
    """The accounts of one task, apart from it, so that a program may use any name of its own."""

    def __init__(self, task: ScoredTask) -> None:
        self._task = task
        self.reset_in: Tabletop | None = None
        self.stated: tuple[Goal, ...] = ()  # every goal of this episode, met or not
        self.told: tuple[Goal, ...] = ()  # whose words goals say in place of their own, first to last
        self.total = 0.0
        self.rng: np.random.Generator | None = None  # the program's own, None for the environment's

    @property
    def env(self) -> Tabletop:
        """The environment of the last reset; raises ``SimulationError`` before."""
        if self.reset_in is None:
            raise SimulationError("the task was not reset yet", "call env.set_task(task) and env.reset()")
        return self.reset_in

    def begin_reset(self, env: Tabletop) -> None:
        """A reset begins: no goal is stated."""
        self.reset_in, self.stated, self.told, self.total = env, (), (), 0.0

    def finish_reset(self, env: Tabletop) -> None:
        """A reset is done: the goals are stated, their rewards add up to 1, tolerances are within bounds."""
        task, self.reset_in = self._task, env
        if not task.goals:
            env.record_warning("the task states no goal: its reset() never calls add_goal")
        goals, doubt = normalise_goal_rewards(task.goals)
        if doubt:
            env.record_warning(doubt)
        words = task.lang_goals or [task.lang_template]
        task.lang_goals = [words[min(index, len(words) - 1)] for index in range(len(goals))]
        task.goals = [
            goal.model_copy(update={"language": sentence[:LONGEST_SENTENCE]})
            for goal, sentence in zip(goals, task.lang_goals, strict=True)
        ]
        self.stated = tuple(task.goals)
        task.pos_eps = _clamp_tolerance_with_warning(env, "pos_eps", task.pos_eps, LARGEST_POS_EPS)
        task.rot_eps = _clamp_tolerance_with_warning(env, "rot_eps", task.rot_eps, LARGEST_ROT_EPS)

    def tell_goals(self, goals: Sequence[GoalOutcome]) -> list[GoalOutcome]:
        """How the goals stand, each with what it says."""
        view, pos_eps = SceneView(self.env, self.stated, self._task.goals), self._task.pos_eps
        words = [describe_goal(goal, view, pos_eps) for goal in self.told] + [
            one.goal for one in goals[len(self.told) :]
        ]
        return [goal.model_copy(update={"goal": text}) for goal, text in zip(goals, words, strict=False)]

    def score_goal_objects(self, goal: Goal) -> list[float]:
        """For each object of a goal, how far (0..1) it is where it should be."""
        task, env = self._task, self.env
        if goal.relation is not None:
            view = SceneView(env, self.stated, task.goals)
            return [float(not clause) for clause in explain_goal_shortfalls(goal, view, task.rot_eps)]
        poses = [env.get_object_pose(number) for number in goal.objects]
        if goal.metric == "zone":
            ceiling = float(task.zone_bounds[2, 1])
            pairs = zip(goal.objects, poses, strict=True)
            return [
                volume_share_in_zones(env.object_collision_points(number), pose, goal.zones, ceiling)
                for number, pose in pairs
            ]
        return [float(self._is_object_placed(goal, row, pose)) for row, pose in enumerate(poses)]

    def _is_object_placed(self, goal: Goal, row: int, pose: Pose) -> bool:
        eps, symmetry = (self._task.pos_eps, self._task.rot_eps), goal.symmetries[row]
        return any(
            is_pose_at_target(pose, goal.targets[index], symmetry, *eps) for index in goal.allowed_target_indices(row)
        )

    def published_reward_shares(self) -> list[float]:
        """For each stated goal what it has earned of its reward, 0..1: open goals after the first one earn nothing."""
        waiting = [id(goal) for goal in self._task.goals]
        return [
            1.0 if id(goal) not in waiting else float(np.mean(self.score_goal_objects(goal))) * (id(goal) == waiting[0])
            for goal in self.stated
        ]


def _clamp_tolerance_with_warning(env: Tabletop, name: str, value: Any, bound: float) -> float:
    """A tolerance within its bounds; noted where it was not."""
    known = is_number(value)
    if known and 0 < value <= bound:
        return float(value)
    shown = f"{value:.3g}" if known else repr(value)[:80]
    env.record_warning(f"{name}={shown} is not within 0..{bound:.3g}, taken as {bound:.3g}")
    return bound
