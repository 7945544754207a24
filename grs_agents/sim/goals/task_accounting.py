"""Accounts of a task's episode: stated goals, their words, and CLIPort's published score, blind to height and tilt."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.planning_scene import PlanningScene
from grs_agents.sim.goals.relation_rules import explain_goal_shortfalls
from grs_agents.sim.goals.scene_report import describe_goal
from grs_agents.sim.instance.episode import GoalOutcome, SimulationError
from grs_agents.sim.instance.goal import LONGEST_SENTENCE, Goal, normalise_goal_rewards
from grs_agents.sim.instance.task_instance import (
    LARGEST_POS_EPS,
    LARGEST_ROT_EPS,
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
)
from grs_agents.sim.tabletop import TabletopSim, is_number
from grs_agents.sim.world.collision_volumes import volume_share_in_zones


def symmetric_yaw_difference(first: float, second: float, symmetry: float) -> float:
    """Smallest turn (rad) between two yaws of an object that repeats every ``symmetry``; 0 = any yaw."""
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
    """The attributes of a task that scores and oracles read; programs may override each of them."""

    goals: list[Goal]  # open goals
    lang_goals: list[str]  # a sentence for each of them
    lang_template: str  # for goals without a sentence
    pos_eps: float  # tolerance of ``pose`` goals, metres
    rot_eps: float  # the same, radians
    sixdof: bool  # targets ask for their tilt
    zone_bounds: npt.NDArray[np.float64]  # (3, 2) lowest and highest x, y, z that count as in a zone, metres
    grs: "TaskAccounting"

    def is_match(self, pose0: Pose, pose1: Pose, symmetry: float) -> bool:
        """Whether two poses agree."""
        ...


class TaskAccounting:
    """Accounts of a task in an object of their own, so that a program may use any attribute name."""

    def __init__(self, task: ScoredTask) -> None:
        self._task = task
        self.reset_in: TabletopSim | None = None
        self.stated: tuple[Goal, ...] = ()  # every goal of this episode, met or not
        self.told: tuple[Goal, ...] = ()  # goals whose descriptions replace those of the stated ones, first to last
        self.total = 0.0
        self.rng: np.random.Generator | None = None  # the program's own, None for the environment's

    @property
    def env(self) -> TabletopSim:
        """The environment of the last reset; raises ``SimulationError`` before."""
        if self.reset_in is None:
            raise SimulationError("the task was not reset yet", "call env.set_task(task) and env.reset()")
        return self.reset_in

    def begin_reset(self, env: TabletopSim) -> None:
        """Start a reset: no goal is stated."""
        self.reset_in, self.stated, self.told, self.total = env, (), (), 0.0

    def finish_reset(self, env: TabletopSim) -> None:
        """Finish a reset: state the goals, scale their rewards to 1, clamp the tolerances."""
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
        """The outcomes of the goals, each with its description."""
        scene, pos_eps = PlanningScene(self.env, self.stated, self._task.goals), self._task.pos_eps
        words = [describe_goal(goal, scene, pos_eps) for goal in self.told]
        words += [goal.goal for goal in goals[len(self.told) :]]
        return [goal.model_copy(update={"goal": text}) for goal, text in zip(goals, words, strict=False)]

    def score_goal_objects(self, goal: Goal) -> list[float]:
        """Published score, 0..1, of each object of a goal."""
        task, env = self._task, self.env
        if goal.relation is not None:
            scene = PlanningScene(env, self.stated, task.goals)
            return [float(not clause) for clause in explain_goal_shortfalls(goal, scene, task.rot_eps)]
        poses = [env.get_object_pose(number) for number in goal.objects]
        if goal.metric == "zone":
            ceiling = float(task.zone_bounds[2, 1])
            pairs = zip(goal.objects, poses, strict=True)
            return [
                volume_share_in_zones(env.object_collision_points(number), pose, goal.zones, ceiling)
                for number, pose in pairs
            ]
        return [
            float(
                any(
                    is_pose_at_target(pose, goal.targets[index], goal.symmetries[row], task.pos_eps, task.rot_eps)
                    for index in goal.allowed_target_indices(row)
                )
            )
            for row, pose in enumerate(poses)
        ]

    def published_reward_shares(self) -> list[float]:
        """Share of its reward, 0..1, that each stated goal has earned: open goals after the first earn nothing."""
        waiting = [id(goal) for goal in self._task.goals]
        return [
            1.0 if id(goal) not in waiting else float(np.mean(self.score_goal_objects(goal))) * (id(goal) == waiting[0])
            for goal in self.stated
        ]


def _clamp_tolerance_with_warning(env: TabletopSim, name: str, value: Any, bound: float) -> float:
    """A tolerance within its bounds, else its bound, with a warning."""
    numeric = is_number(value)
    if numeric and 0 < value <= bound:
        return float(value)
    shown = f"{value:.3g}" if numeric else repr(value)[:80]
    env.record_warning(f"{name}={shown} is not within 0..{bound:.3g}, taken as {bound:.3g}")
    return bound
