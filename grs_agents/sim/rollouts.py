"""From a task instance to a scored episode of the trusted oracle, and what else the audit judges by."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from grs_agents.base import Frozen, Pose
from grs_agents.base.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.sim.cliport import end_effectors
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import Task
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.goals.contacts import Overlap, Support, measure_overlaps, measure_supports
from grs_agents.sim.goals.relation_rules import gap_between_objects
from grs_agents.sim.goals.scene_view import SceneView, enclosing_object_ids, supporting_object_ids
from grs_agents.sim.instance.episode import Episode, make_stop_from_error
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion.placement import ReachTest
from grs_agents.sim.world.recording import Recording

LEAST_IDLE: Final = 2.0
"""Simulated seconds: what falls into place by itself must be seen even if the robot stopped at once."""
_UNREST: Final = 0.05
"""Speed (m/s) of what is not at rest, and may come to where a goal wants it without any robot."""

_PICKS: Final = 5
"""How often a hand that misses tries one pick: on tops 3 cm wide, 2 of 3 misses by 5 mm find no seal."""
_BESIDE: Final = 0.1
"""Metres: a pose goal may speak of a neighbour so far away, as "to the left of the milk" does."""
HAND_NOISE: Final = (0.005, 0.01)
"""How far the hand may miss (m): what a task must bear, and twice that, which is reported. `grs grade` goes further."""


class NoisyTrial(Frozen):
    """An episode of the oracle whose hand misses each pose of each action by up to ``noise``, in any direction."""

    noise: float  # metres
    score: float  # 0..1: the lower of the published and the strict one; 0 unless every goal was met


class Rollout(Frozen):
    """The trusted oracle's run of an instance."""

    seed: int
    episode: Episode
    # what all goals together are worth after doing nothing for ``idle_seconds``; 1 if the scene does not come to
    # rest
    idle_reward: float
    idle_scores: tuple[float, ...] = ()  # how far each goal holds then, 0..1; objects count by the last goal they have
    idle_seconds: float = LEAST_IDLE  # simulated time of the oracle's episode
    moved: tuple[str, ...]  # assets that the robot picked or pushed and that end more than 2 cm or 15 degrees away
    handled: tuple[tuple[int, ...], ...] = ()  # for each action the ids of what it picked or pushed, in their order
    initial: dict[int, Pose]  # by object id, after settling
    final: dict[int, Pose]
    reachable: tuple[int, ...]  # ids of rigid objects
    overlaps: tuple[Overlap, ...] = ()  # as the instance places its objects, before they settle
    supports: tuple[Support, ...] = ()  # of each loose object of the task at the end
    neighbours: tuple[int, ...] = ()  # ids of what the objects of goals end on, in or (of pose goals) close beside
    trials: tuple[NoisyTrial, ...] = ()
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


def rollout(
    instance: TaskInstance, library: Library | None = None, recording: Path | None = None, trials: int = 0
) -> Rollout:
    """Let the oracle solve an instance; nothing of the program it came from is needed.

    ``recording`` is an .npz file to write: ``times`` (N,), ``positions`` (N, B, 3), ``quaternions`` (N, B, 4, xyzw),
    ``names`` (B,) ("object_<id>" or a robot link), ``tool`` (N, 3). ``trials`` is how often it solves the instance
    again with the least noise of the hand.
    """
    task = InstanceTask(instance)
    env = Environment(task=task, library=library, seed=instance.seed, robot=instance.robot)
    env.timestep = instance.timestep
    oracle = task.oracle(env)
    initial: dict[int, Pose] = {}
    begin = 0.0
    reachable: tuple[int, ...] = ()
    overlaps: tuple[Overlap, ...] = ()
    recorder: Recording | None = None
    try:
        env.reset(settle=False)
        overlaps = _map_overlaps_to_instance_ids(measure_overlaps(env), task)
        env.reset()
        initial = _object_poses(env, task)
        reachable = _reachable_object_ids(env, task)
        recorder = Recording(env.physics, task.ids) if recording is not None else None
        begin = float(env.physics.data.time)
        run_oracle(env, task, oracle=oracle)
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
        handled=_object_ids_per_action(episode, task),
        initial=initial,
        final=final,
        reachable=reachable,
        overlaps=overlaps,
        recording=str(recording) if recorder is not None else None,
        warnings=tuple(dict.fromkeys((*instance.warnings, *env.warnings))),
    )
    if not initial:  # what could not be set up is not measured, and must not count as left to do
        return done
    seconds = max(float(env.physics.data.time) - begin, LEAST_IDLE)
    if episode.outcome == "success":
        done = done.model_copy(update=_measure_supports_and_neighbours(env, task))
        done = done.model_copy(update={"trials": tuple(_run_noisy_trials(env, task, oracle, trials))})
    return done.model_copy(update=_measure_idle_episode(env, task, seconds))


def run_oracle(
    env: Environment,
    task: Task,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    oracle: Oracle | None = None,
) -> None:
    """Let the oracle act in a reset environment until it is done or stops; ``env.episode`` says how it went. One that
    has solved the task before remembers what it planned.

    With ``rng`` the hand misses each pose of an action by up to ``noise`` metres, alike in all directions; what it does
    not get hold of it tries to take again, as a robot does that feels no vacuum.
    """
    agent, done = oracle or task.oracle(env), False
    while not done:
        action = agent.act()
        if action is None:
            return
        for _ in range(1 if rng is None else _PICKS):
            missed = action if rng is None else {key: _displace_pose(pose, noise, rng) for key, pose in action.items()}
            _, _, done, _ = env.step(missed)
            if done or env.recorder.actions[-1].object is not None:
                break


def _displace_pose(pose: Pose, noise: float, rng: np.random.Generator) -> Pose:
    (x, y, z), rotation = pose
    angle, away = rng.uniform(0, 2 * np.pi), noise * float(np.sqrt(rng.uniform()))
    return (x + away * float(np.cos(angle)), y + away * float(np.sin(angle)), z), rotation


def _run_noisy_trials(env: Environment, task: InstanceTask, oracle: Oracle, count: int) -> Iterator[NoisyTrial]:
    """``count`` episodes with the least noise, and where these are several one with each larger one, until fewer than
    half succeed."""
    task.max_steps = _PICKS * task.instance.max_steps
    for noise in HAND_NOISE:
        scores: list[float] = []
        for trial in range(count):
            try:
                env.reset()
                rng = np.random.default_rng((task.instance.seed, int(1000 * noise), trial))
                run_oracle(env, task, noise, rng, oracle)
            except GrsError as error:
                env.recorder.stop = make_stop_from_error(error)
            episode = env.current_episode
            scores.append(min(episode.reward, episode.strict) if episode.outcome == "success" else 0.0)
            yield NoisyTrial(noise=noise, score=scores[-1])
        if 2 * sum(score > 0.9 for score in scores) < len(scores):
            return
        count = min(1, count // 2) if noise == HAND_NOISE[0] else count


def _measure_supports_and_neighbours(env: Environment, task: InstanceTask) -> dict[str, Any]:
    """Fields of a ``Rollout`` about a solved scene: how it is held up, and what its goals' objects are at."""
    own = {number: key for key, number in task.ids.items()}
    supports = [one.model_copy(update={"object": own[one.object]}) for one in measure_supports(env)]
    view = SceneView(env, task.grs.stated, task.goals)
    neighbours: set[int] = set()
    for goal in task.grs.stated:
        for number in goal.objects:
            neighbours |= supporting_object_ids(number, view) | enclosing_object_ids(number, view)
            if goal.metric == "pose":
                others = set(view.object_ids) - {number}
                neighbours |= {one for one in others if gap_between_objects(number, one, view) < _BESIDE}
    return {"supports": tuple(supports), "neighbours": tuple(sorted(own[number] for number in neighbours))}


def _map_overlaps_to_instance_ids(overlaps: Sequence[Overlap], task: InstanceTask) -> tuple[Overlap, ...]:
    own = {number: key for key, number in task.ids.items()}
    return tuple(Overlap(first=own[one.first], second=own[one.second], depth=one.depth) for one in overlaps)


def _measure_idle_episode(env: Environment, task: Task, seconds: float) -> dict[str, Any]:
    """Fields of a ``Rollout`` about doing nothing for so many simulated seconds."""
    idle: dict[str, Any] = {"idle_seconds": seconds}
    try:
        env.reset()
        for _ in range(math.ceil(seconds / LEAST_IDLE)):
            env.step_simulation(int(LEAST_IDLE / env.timestep))
            if env.physics.is_asleep:  # until the robot comes, which it does not
                break
    except GrsError:
        return idle  # the reward stays 1
    scores = score_goals_by_latest_mention(task)
    idle["idle_scores"] = tuple(scores)
    if env.physics.max_free_body_speed() <= _UNREST:
        # The published reward stops at the first goal that is open, though later ones may hold already.
        worth = sum(goal.max_reward * score for goal, score in zip(task.grs.stated, scores, strict=True))
        idle["idle_reward"] = float(min(1.0, max(worth, task.reward()[0])))
    return idle


def score_goals_by_latest_mention(task: Task) -> list[float]:
    """How far each goal holds now, 0..1; an object that a later goal speaks of too counts as it stands to that one."""
    last: dict[int, float] = {}
    means: list[float] = []
    for goal in reversed(task.grs.stated):
        for number, score in zip(goal.objects, task.grs.score_goal_objects(goal), strict=True):
            last.setdefault(number, score)
        means.insert(0, float(np.mean([last[number] for number in goal.objects])))
    return means


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


def _object_ids_per_action(episode: Episode, task: InstanceTask) -> tuple[tuple[int, ...], ...]:
    own = {number: key for key, number in task.ids.items()}
    acted_on = ((action.object, *action.pushed) for action in episode.actions)
    return tuple(tuple(dict.fromkeys(own[number] for number in row if number in own)) for row in acted_on)


def _moved_asset_names(episode: Episode) -> tuple[str, ...]:
    acted_on = {number for action in episode.actions for number in (action.object, *action.pushed)}
    return tuple(motion.asset for motion in episode.motions if motion.moved and motion.object in acted_on)
