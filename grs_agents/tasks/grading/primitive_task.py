"""A task at the level of primitives: one decision is which object to carry, to where, and how turned.

How it is taken, the hand knows: it looks for the flattest free point on the object's top.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.errors import GrsError
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.instance.episode import Episode, make_stop_from_error
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion.grasp import find_grasp
from grs_agents.sim.rollouts import InstanceTask
from grs_agents.sim.world.footprints import object_prism_at_pose, rest_heights_at_offsets
from grs_agents.tasks.grading.primitive_policy import Demonstration, PrimitivePolicy

SOLVED: Final = 0.99
"""Strict and published score from which on an episode is a success."""
_MET: Final = 0.985
_STAGES: Final = 16
"""Goals that are told apart by how many are met; of more, the last ones look alike."""
_BUDGET: Final = 10**12
Frame = tuple[float, float, float]
"""x, y (m) and yaw (rad) in the robot frame."""


@dataclass(frozen=True)
class Decision:
    """What to do next: an object, and where it is to be then."""

    object: int  # id in the instance
    place: tuple[float, float]  # of its origin, metres, robot frame
    yaw: float  # of its own axes, radians


@dataclass(frozen=True)
class ExpertChoice:
    """A decision of the expert, and what a policy would have been told before."""

    features: FloatArray  # (F,)
    waiting: list[bool]  # for each candidate whether a goal waited for it
    decision: Decision
    place: Frame  # of the decision, as seen from the goal that waited


class PrimitiveTask:
    """Episodes of instances that have the same objects, one decision at a time.

    What a policy is told are ``features``: of each object that the task lets move its pose, its pose in the frame of
    the goal that waits for it, and whether any does; and how many goals are met.
    """

    def __init__(self, instance: TaskInstance, library: Library) -> None:
        self._env = Environment(library=library, seed=instance.seed, budget=_BUDGET, robot=instance.robot)
        self.candidates: tuple[int, ...] = ()
        self.reset(instance)

    def reset(self, instance: TaskInstance) -> None:
        """Begin an episode of an instance. Raises ``GrsError``: it cannot be set up."""
        self.instance, env = instance, self._env
        self._task = InstanceTask(instance)
        env.set_task(self._task)
        env.timestep = instance.timestep
        env.reset()
        self._done = False
        loose = [item.id for item in instance.task_objects if env.is_object_movable(self._task.ids[item.id])]
        self.candidates = tuple(loose)

    @property
    def is_over(self) -> bool:
        """Whether all goals are met, or the steps used up."""
        return self._done

    @property
    def episode(self) -> Episode:
        """How the episode stands."""
        return self._env.current_episode

    @property
    def is_solved(self) -> bool:
        """Whether every goal is met strictly."""
        return min(self.episode.strict, self.episode.reward) >= SOLVED

    def object_frame(self, number: int) -> Frame:
        """Where an object is, and its yaw."""
        return _pose_to_frame(self._env.get_object_pose(self._task.ids[number]))

    def goal_frame(self, number: int) -> tuple[Frame, bool]:
        """The frame of the first goal that waits for an object, and whether any waits; the robot's where none does."""
        own, frame = self._task.ids[number], (0.0, 0.0, 0.0)
        for goal in self._task.grs.stated:
            if own in goal.objects:
                row = goal.objects.index(own)
                frame = self._frame_of_goal(goal, row)
                if self._is_goal_unmet(goal) and self._task.grs.score_goal_objects(goal)[row] < _MET:
                    return frame, True
        return frame, False

    def _is_goal_unmet(self, goal: Goal) -> bool:
        return any(goal is one for one in self._task.goals)

    def _frame_of_goal(self, goal: Goal, row: int) -> Frame:
        if goal.relation is not None:
            other = goal.relation.reference
            if goal.relation_kind == "stacked" and row:
                other = goal.objects[row - 1]
            return (0.0, 0.0, 0.0) if other is None else _pose_to_frame(self._env.get_object_pose(other))
        if goal.zones:
            return _pose_to_frame(goal.zones[0].pose)
        allowed = goal.allowed_target_indices(row)
        return _pose_to_frame(goal.targets[allowed[0]]) if allowed else (0.0, 0.0, 0.0)

    @property
    def waiting(self) -> list[bool]:
        """For each candidate whether a goal waits for it."""
        return [self.goal_frame(number)[1] for number in self.candidates]

    def features(self) -> FloatArray:
        """What a policy is told, (13 for each candidate and 16,)."""
        rows: list[float] = []
        for number in self.candidates:
            x, y, yaw = self.object_frame(number)
            z = self._env.get_object_pose(self._task.ids[number])[0][2]
            frame, waits = self.goal_frame(number)
            aside = relative_frame(frame, (x, y, yaw))
            rows += [x, y, z, math.sin(yaw), math.cos(yaw)]
            rows += [aside[0], aside[1], math.sin(aside[2]), math.cos(aside[2])]
            rows += [float(waits), frame[0], frame[1], math.sin(frame[2])]
        met = len(self._task.grs.stated) - len(self._task.goals)
        return np.concatenate([rows, np.eye(_STAGES)[min(met, _STAGES - 1)]])

    def carry(self, decision: Decision) -> None:
        """Carry out a decision; what the simulation refuses ends the episode."""
        try:
            self._step_environment(self._action_for_decision(decision))
        except GrsError as error:
            self._env.recorder.stop, self._done = make_stop_from_error(error), True

    def _step_environment(self, action: dict[str, Pose]) -> None:
        self._done = self._env.step(action)[2]

    def _action_for_decision(self, decision: Decision) -> dict[str, Pose]:
        """Poses of the cup: the hand takes the object at its best free point, and lowers it until it rests."""
        env, number = self._env, self._task.ids[decision.object]
        position, rotation = env.get_object_pose(number)
        prism = env.object_prism(number)
        others = [other for other in env.collider_prisms() if other.owner != number]
        hold = find_grasp(env.physics, number, prism, others).point or (position[0], position[1], prism.high)
        turn = _wrap_angle(decision.yaw - transforms.yaw_of_quaternion(rotation))
        about = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, turn))
        there: Pose = ((*decision.place, position[2]), transforms.multiply_quaternions(about, rotation))
        body = object_prism_at_pose(env.object_model(number), there, number)
        ground = float(rest_heights_at_offsets(body, others, np.zeros((1, 2)), 0.0)[0])
        dx, dy, _ = transforms.quaternion_to_matrix(about) @ (hold[0] - position[0], hold[1] - position[1], 0.0)
        place = (decision.place[0] + float(dx), decision.place[1] + float(dy), ground + hold[2] - prism.low)
        return {"pose0": (hold, transforms.IDENTITY), "pose1": (place, about)}

    def expert_decisions(self, noise: float = 0.0, rng: np.random.Generator | None = None) -> Iterator["ExpertChoice"]:
        """Let the expert act; yields what a policy would have been told, and what the expert decided.

        With ``noise`` (m) the hand puts down beside where the expert meant, so that the expert shows how to mend that.
        """
        expert = self._task.oracle(self._env)
        while not self._done:
            action = expert.act()
            if action is None:
                return
            told, waiting = self.features(), self.waiting
            before = {number: (self.object_frame(number), self.goal_frame(number)[0]) for number in self.candidates}
            done = dict(action)
            if rng is not None and noise:
                (x, y, z), turn = action["pose1"]
                dx, dy = rng.normal(0.0, noise, 2)
                done["pose1"] = ((x + float(dx), y + float(dy), z), turn)
            self._step_environment(done)
            taken = self._env.recorder.actions[-1].object
            own = next((number for number in self.candidates if self._task.ids[number] == taken), None)
            if own is not None:
                start, goal = before[own]
                decision = _decision_from_action(own, action, start)
                yield ExpertChoice(told, waiting, decision, relative_frame(goal, (*decision.place, decision.yaw)))


def _decision_from_action(number: int, action: dict[str, Pose], before: Frame) -> Decision:
    """Where an object comes to be that stood at ``before`` and is carried as an action says."""
    (x0, y0, _), _ = action["pose0"]
    (x1, y1, _), rotation = action["pose1"]
    turn = transforms.yaw_of_quaternion(rotation)
    cos, sin, dx, dy = math.cos(turn), math.sin(turn), before[0] - x0, before[1] - y0
    return Decision(number, (x1 + cos * dx - sin * dy, y1 + sin * dx + cos * dy), before[2] + turn)


def _pose_to_frame(pose: Pose) -> Frame:
    return pose[0][0], pose[0][1], transforms.yaw_of_quaternion(pose[1])


def _wrap_angle(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def relative_frame(frame: Frame, other: Frame) -> Frame:
    """``other`` as seen from ``frame``."""
    dx, dy = other[0] - frame[0], other[1] - frame[1]
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    return cos * dx + sin * dy, cos * dy - sin * dx, other[2] - frame[2]


def absolute_frame(frame: Frame, other: Frame) -> Frame:
    """The robot frame's view of ``other``, given as seen from ``frame``."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    x, y = frame[0] + cos * other[0] - sin * other[1], frame[1] + sin * other[0] + cos * other[1]
    return x, y, frame[2] + other[2]


def demonstrate(
    task: PrimitiveTask, instance: TaskInstance, noise: float = 0.0, rng: np.random.Generator | None = None
) -> Demonstration | None:
    """The expert's decisions in one episode; None where it does not solve the instance, or has nothing to do."""
    try:
        task.reset(instance)
        shown = list(task.expert_decisions(noise, rng))
    except GrsError:
        return None
    if not shown or not task.is_solved:
        return None
    return Demonstration(
        features=np.array([one.features for one in shown]),
        waiting=np.array([one.waiting for one in shown]),
        objects=np.array([task.candidates.index(one.decision.object) for one in shown]),
        places=np.array([one.place for one in shown]),
    )


def decide(policy: PrimitivePolicy, task: PrimitiveTask) -> Decision:
    """What a learned policy decides."""
    index, place = policy(task.features(), task.waiting)
    number = task.candidates[index]
    x, y, yaw = absolute_frame(task.goal_frame(number)[0], place)
    return Decision(number, (x, y), yaw)


def random_decision(task: PrimitiveTask, rng: np.random.Generator) -> Decision:
    """Any of the objects to anywhere on the table, turned anyhow."""
    number = task.candidates[int(rng.integers(len(task.candidates)))]
    x, y = rng.uniform((0.25, -0.5), (0.75, 0.5)).tolist()
    return Decision(number, (x, y), float(rng.uniform(-math.pi, math.pi)))


def evaluate_policy(task: PrimitiveTask, instance: TaskInstance, choose: Callable[[PrimitiveTask], Decision]) -> bool:
    """Whether a policy solves an instance strictly, in as many steps as the task allows."""
    try:
        task.reset(instance)
    except GrsError:
        return False
    while not task.is_over and task.candidates:
        task.carry(choose(task))
    return task.is_solved
