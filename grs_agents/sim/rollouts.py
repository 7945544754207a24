"""From a task instance to a scored episode of the trusted oracle."""

from pathlib import Path
from typing import Final

import numpy as np

from grs_agents.base import Frozen, Pose
from grs_agents.errors import GrsError
from grs_agents.library import Library
from grs_agents.sim.cliport import Environment, Task, end_effectors
from grs_agents.sim.instance import Episode, Goal, TaskInstance, make_stop_from_error
from grs_agents.sim.motion import ReachTest
from grs_agents.sim.world import Recording

LEAST_IDLE: Final = 2.0
"""Simulated seconds: what falls into place by itself must be seen even if the robot stopped at once."""
_UNREST: Final = 0.05
"""Speed (m/s) of what is not at rest, and may come to where a goal wants it without any robot."""


class Rollout(Frozen):
    """The trusted oracle's run of an instance."""

    seed: int
    episode: Episode
    # what all goals together are worth after doing nothing for ``idle_seconds``; 1 if the scene does not come to
    # rest
    idle_reward: float
    # simulated time that all actions the task allows take at the oracle's pace, so that no episode is longer
    idle_seconds: float = LEAST_IDLE
    moved: tuple[str, ...]  # assets that the robot picked or pushed and that end more than 2 cm or 15 degrees away
    initial: dict[int, Pose]  # by object id, after settling
    final: dict[int, Pose]
    reachable: tuple[int, ...]  # ids of rigid objects
    recording: str | None = None  # .npz file
    warnings: tuple[str, ...] = ()  # what the runtime had to assume, when the program set the scene up too

    @property
    def reward(self) -> float:
        """The published reward at the end, 0..1."""
        return self.episode.reward

    @property
    def strict_score(self) -> float:
        """The strict score at the end, 0..1."""
        return self.episode.strict


class InstanceTask(Task):
    """A task that sets up what an instance says."""

    def __init__(self, instance: TaskInstance) -> None:
        super().__init__()
        self.instance = instance
        self.max_steps, self.sixdof = instance.max_steps, instance.sixdof
        self.pos_eps, self.rot_eps = instance.pos_eps, instance.rot_eps
        if instance.primitive == "push":
            self.ee, self.primitive = end_effectors.Spatula, end_effectors.push
        self.ids: dict[int, int] = {}

    def reset(self, env: Environment) -> None:
        """Add the instance's objects and goals."""
        super().reset(env)
        env.background = self.instance.background
        self.ids = {item.id: env.insert_object(item) for item in self.instance.objects}
        for tie in self.instance.ties:
            env.tie_objects(tie.model_copy(update={"parent": self.ids[tie.parent], "child": self.ids[tie.child]}))
        self.goals = [self._goal_with_env_ids(goal) for goal in self.instance.goals]
        self.lang_goals = [goal.language for goal in self.goals]

    def _goal_with_env_ids(self, goal: Goal) -> Goal:
        """The goal with the ids that its objects have in the environment."""
        relation = goal.relation
        if relation is not None and relation.reference is not None:
            relation = relation.model_copy(update={"reference": self.ids[relation.reference]})
        objects = tuple(self.ids[number] for number in goal.objects)
        own = goal.model_copy(update={"objects": objects, "relation": relation})
        own.check_relation()
        return own


def rollout(instance: TaskInstance, library: Library | None = None, recording: Path | None = None) -> Rollout:
    """Let the oracle solve an instance; nothing of the program it came from is needed.

    ``recording`` is an .npz file to write: ``times`` (N,), ``positions`` (N, B, 3), ``quaternions`` (N, B, 4, xyzw),
    ``names`` (B,) ("object_<id>" or a robot link), ``tool`` (N, 3).
    """
    task = InstanceTask(instance)
    env = Environment(task=task, library=library, seed=instance.seed)
    env.timestep = instance.timestep
    initial: dict[int, Pose] = {}
    begin = 0.0
    reachable: tuple[int, ...] = ()
    recorder: Recording | None = None
    try:
        env.reset()
        initial = _object_poses(env, task)
        reachable = _reachable_object_ids(env, task)
        recorder = Recording(env.physics, task.ids) if recording is not None else None
        begin = float(env.physics.data.time)
        run_oracle(env, task)
    except GrsError as error:
        env.recorder.stop = make_stop_from_error(error)
    final = _object_poses(env, task) if initial else {}
    if recorder is not None and recording is not None:
        recorder.save(recording)
    episode = env.current_episode
    done = Rollout(
        seed=instance.seed,
        episode=episode,
        idle_reward=1.0,
        moved=_moved_asset_names(episode),
        initial=initial,
        final=final,
        reachable=reachable,
        recording=str(recording) if recorder is not None else None,
        warnings=tuple(dict.fromkeys((*instance.warnings, *env.warnings))),
    )
    if not initial:  # what could not be set up is not measured, and must not count as left to do
        return done
    pace = (float(env.physics.data.time) - begin) / max(1, done.episode.steps)
    seconds = max(pace * instance.max_steps, LEAST_IDLE)
    return done.model_copy(update={"idle_reward": _reward_after_idling(env, task, seconds), "idle_seconds": seconds})


def run_oracle(env: Environment, task: Task) -> None:
    """Let the oracle act in a reset environment until it is done or stops; ``env.episode`` says how it went."""
    agent, done = task.oracle(env), False
    while not done:
        action = agent.act()
        if action is None:
            return
        _, _, done, _ = env.step(action)


def _reward_after_idling(env: Environment, task: Task, seconds: float) -> float:
    try:
        env.reset()
        env.step_simulation(int(seconds / env.timestep))
    except GrsError:
        return 1.0  # as above
    if env.physics.max_free_body_speed() > _UNREST:
        return 1.0
    # The published reward stops at the first goal that is open, though later ones may hold already.
    worth = sum(goal.max_reward * float(np.mean(task.grs.score_goal_objects(goal))) for goal in task.grs.stated)
    return float(min(1.0, max(worth, task.reward()[0])))


def _object_poses(env: Environment, task: InstanceTask) -> dict[int, Pose]:
    return {own: env.get_object_pose(number) for own, number in task.ids.items()}


def _reachable_object_ids(env: Environment, task: InstanceTask) -> tuple[int, ...]:
    ids: list[int] = []
    for own, number in task.ids.items():
        if env.is_object_movable(number):
            position, size = env.get_object_pose(number)[0], env.get_object_size(number)
            top = np.array([max(0.0, position[2] + size[2] / 2)])
            if ReachTest(0.0, env.arm)(np.array([position[:2]]), top)[0]:
                ids.append(own)
    return tuple(ids)


def _moved_asset_names(episode: Episode) -> tuple[str, ...]:
    acted_on = {number for action in episode.actions for number in (action.object, *action.pushed)}
    return tuple(motion.asset for motion in episode.motions if motion.moved and motion.object in acted_on)
