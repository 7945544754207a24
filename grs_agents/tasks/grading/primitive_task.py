"""A task at the level of primitives: a decision is an object to carry, its place and its yaw.

The hand itself finds the flattest free point on the object's top.
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
from grs_agents.sim.goals.scores import MET, SOLVED
from grs_agents.sim.instance.episode import Episode, make_stop_from_error
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion.grasp import find_grasp
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.tabletop_episode import change_instance
from grs_agents.sim.world.footprints import object_prism_at_pose, rest_heights_at_offsets
from grs_agents.tasks.grading.primitive_policy import PrimitiveDemonstration, PrimitivePolicy

_STAGES: Final = 16
"""Size of the one-hot number of met goals; larger numbers count as the largest."""
_BUDGET: Final = 10**12
Frame = tuple[float, float, float]
"""x, y (m) and yaw (rad) in the robot frame."""


@dataclass(frozen=True)
class CarryDecision:
    """The next move: an object and its place."""

    object: int  # id in the instance
    place: tuple[float, float]  # of its origin, metres, robot frame
    yaw: float  # of its own axes, radians


@dataclass(frozen=True)
class ExpertChoice:
    """A decision of the expert, and the policy's inputs before it."""

    features: FloatArray  # (F,)
    waiting: list[bool]  # for each candidate whether a goal waited for it
    decision: CarryDecision
    place: Frame  # of the decision, in the frame of the goal that waited


class PrimitiveTask:
    """Episodes of instances with the same objects, decision by decision.

    A policy's inputs are ``features``: for each movable object its pose, its pose in the frame of the goal that waits
    for it, and whether any goal waits; and the number of met goals.
    """

    def __init__(self, instance: TaskInstance, library: Library) -> None:
        self._sim = TabletopSim(library, seed=instance.seed, budget=_BUDGET, robot=instance.robot, hand=instance.hand)
        self.candidates: tuple[int, ...] = ()
        self.reset(instance)

    def reset(self, instance: TaskInstance) -> None:
        """Begin an episode of an instance. Raises ``GrsError``: it cannot be set up."""
        self.instance, self._episode = instance, change_instance(self._sim, instance)
        self._episode.reset()
        self._task = self._episode.task
        self._done = False
        self.candidates = tuple(
            item.id for item in instance.task_objects if self._sim.is_object_movable(self._task.ids[item.id])
        )

    @property
    def is_over(self) -> bool:
        """True if all goals are met or the steps are used up."""
        return self._done

    @property
    def episode(self) -> Episode:
        """Record of the episode so far."""
        return self._sim.current_episode

    @property
    def is_solved(self) -> bool:
        """True if every goal is met strictly."""
        return min(self.episode.strict, self.episode.reward) >= SOLVED

    def object_frame(self, number: int) -> Frame:
        """Position and yaw of an object."""
        return _pose_to_frame(self._sim.get_object_pose(self._task.ids[number]))

    def goal_frame(self, number: int) -> tuple[Frame, bool]:
        """Frame of the first goal that waits for an object, and whether any waits; else of its last goal."""
        on_table, frame = self._task.ids[number], (0.0, 0.0, 0.0)
        for goal in self._task.grs.stated:
            if on_table in goal.objects:
                row = goal.objects.index(on_table)
                frame = self._frame_of_goal(goal, row)
                unmet = any(goal is waiting for waiting in self._task.goals)
                if unmet and self._task.grs.score_goal_objects(goal)[row] < MET:
                    return frame, True
        return frame, False

    def _frame_of_goal(self, goal: Goal, row: int) -> Frame:
        if goal.relation is not None:
            reference = goal.relation.reference
            if goal.relation_kind == "stacked" and row:
                reference = goal.objects[row - 1]
            return (0.0, 0.0, 0.0) if reference is None else _pose_to_frame(self._sim.get_object_pose(reference))
        if goal.zones:
            return _pose_to_frame(goal.zones[0].pose)
        allowed = goal.allowed_target_indices(row)
        return _pose_to_frame(goal.targets[allowed[0]]) if allowed else (0.0, 0.0, 0.0)

    @property
    def waiting(self) -> list[bool]:
        """For each candidate whether a goal waits for it."""
        return [self.goal_frame(number)[1] for number in self.candidates]

    def features(self) -> FloatArray:
        """A policy's inputs, (13 for each candidate + 16,)."""
        rows: list[float] = []
        for number in self.candidates:
            x, y, yaw = self.object_frame(number)
            z = self._sim.get_object_pose(self._task.ids[number])[0][2]
            frame, waits = self.goal_frame(number)
            aside = relative_frame(frame, (x, y, yaw))
            rows += [x, y, z, math.sin(yaw), math.cos(yaw)]
            rows += [aside[0], aside[1], math.sin(aside[2]), math.cos(aside[2])]
            rows += [float(waits), frame[0], frame[1], math.sin(frame[2])]
        met = len(self._task.grs.stated) - len(self._task.goals)
        return np.concatenate([rows, np.eye(_STAGES)[min(met, _STAGES - 1)]])

    def carry(self, decision: CarryDecision) -> None:
        """Carry out a decision; an error of the simulation ends the episode."""
        try:
            sim, number = self._sim, self._task.ids[decision.object]
            position, rotation = sim.get_object_pose(number)
            prism = sim.object_prism(number)
            others = [neighbour for neighbour in sim.collider_prisms() if neighbour.owner != number]
            hold = find_grasp(sim.physics, number, prism, others).point or (position[0], position[1], prism.high)
            turn = (decision.yaw - transforms.yaw_of_quaternion(rotation) + math.pi) % (2 * math.pi) - math.pi
            about = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, turn))
            there: Pose = ((*decision.place, position[2]), transforms.multiply_quaternions(about, rotation))
            body = object_prism_at_pose(sim.object_model(number), there, number)
            ground = float(rest_heights_at_offsets(body, others, np.zeros((1, 2)), 0.0)[0])
            dx, dy, _ = transforms.quaternion_to_matrix(about) @ (hold[0] - position[0], hold[1] - position[1], 0.0)
            place = (decision.place[0] + float(dx), decision.place[1] + float(dy), ground + hold[2] - prism.low)
            self._step({"pose0": (hold, transforms.IDENTITY), "pose1": (place, about)})
        except GrsError as error:
            self._sim.recorder.stop, self._done = make_stop_from_error(error), True

    def _step(self, action: dict[str, Pose]) -> None:
        self._done = self._episode.step(action)[2]

    def expert_decisions(self, noise: float = 0.0, rng: np.random.Generator | None = None) -> Iterator["ExpertChoice"]:
        """Let the expert act; yields a policy's inputs and the expert's decision for each action.

        With ``noise`` (m) the hand puts objects down beside the expert's place, so that the expert shows corrections.
        """
        expert = self._task.oracle(self._sim)
        while not self._done:
            action = expert.act()
            if action is None:
                return
            features, waiting = self.features(), self.waiting
            before = {
                number: (self._sim.get_object_pose(self._task.ids[number]), self.goal_frame(number)[0])
                for number in self.candidates
            }
            action_done = dict(action)
            if rng is not None and noise:
                (x, y, z), turn = action["pose1"]
                dx, dy = rng.normal(0.0, noise, 2)
                action_done["pose1"] = ((x + float(dx), y + float(dy), z), turn)
            self._step(action_done)
            picked = self._sim.recorder.actions[-1].object
            moved = next((number for number in self.candidates if self._task.ids[number] == picked), None)
            if moved is not None:  # the decision is where the action carries the object to
                pose, goal = before[moved]
                motion = transforms.compose_poses(action["pose1"], transforms.invert_pose(action["pose0"]))
                x, y, yaw = _pose_to_frame(transforms.compose_poses(motion, pose))
                decision = CarryDecision(moved, (x, y), yaw)
                yield ExpertChoice(features, waiting, decision, relative_frame(goal, (x, y, yaw)))


def _pose_to_frame(pose: Pose) -> Frame:
    return pose[0][0], pose[0][1], transforms.yaw_of_quaternion(pose[1])


def relative_frame(frame: Frame, target: Frame) -> Frame:
    """``target`` in the frame ``frame``."""
    dx, dy = target[0] - frame[0], target[1] - frame[1]
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    return cos * dx + sin * dy, cos * dy - sin * dx, target[2] - frame[2]


def absolute_frame(frame: Frame, relative: Frame) -> Frame:
    """``relative``, given in the frame ``frame``, in the robot frame."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    x, y = frame[0] + cos * relative[0] - sin * relative[1], frame[1] + sin * relative[0] + cos * relative[1]
    return x, y, frame[2] + relative[2]


def demonstrate(
    task: PrimitiveTask, instance: TaskInstance, noise: float = 0.0, rng: np.random.Generator | None = None
) -> PrimitiveDemonstration | None:
    """The expert's decisions in an episode; None if it does not solve the instance or has nothing to do."""
    try:
        task.reset(instance)
        shown = list(task.expert_decisions(noise, rng))
    except GrsError:
        return None
    if not shown or not task.is_solved:
        return None
    return PrimitiveDemonstration(
        features=np.array([choice.features for choice in shown]),
        waiting=np.array([choice.waiting for choice in shown]),
        objects=np.array([task.candidates.index(choice.decision.object) for choice in shown]),
        places=np.array([choice.place for choice in shown]),
    )


def decide(policy: PrimitivePolicy, task: PrimitiveTask) -> CarryDecision:
    """CarryDecision of a learned policy."""
    index, place = policy(task.features(), task.waiting)
    number = task.candidates[index]
    x, y, yaw = absolute_frame(task.goal_frame(number)[0], place)
    return CarryDecision(number, (x, y), yaw)


def random_decision(task: PrimitiveTask, rng: np.random.Generator) -> CarryDecision:
    """Random decision: any object to any place on the table at any yaw."""
    number = task.candidates[int(rng.integers(len(task.candidates)))]
    x, y = rng.uniform((0.25, -0.5), (0.75, 0.5)).tolist()
    return CarryDecision(number, (x, y), float(rng.uniform(-math.pi, math.pi)))


def evaluate_policy(
    task: PrimitiveTask, instance: TaskInstance, choose: Callable[[PrimitiveTask], CarryDecision]
) -> bool:
    """Whether a policy solves an instance strictly within the task's steps."""
    try:
        task.reset(instance)
    except GrsError:
        return False
    while not task.is_over and task.candidates:
        task.carry(choose(task))
    return task.is_solved
