"""Rollouts: the trusted oracle solves a task instance, and the audit's measurements are taken."""

import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from grs_agents.base import Frozen, Pose
from grs_agents.base.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.goals.contacts import Overlap, Support, measure_overlaps, measure_supports
from grs_agents.sim.goals.planning_scene import PlanningScene, enclosing_object_ids, supporting_object_ids
from grs_agents.sim.goals.relation_rules import gap_between_objects
from grs_agents.sim.instance.episode import Episode, make_stop_from_error
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion.placement import ReachTest
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.tabletop_episode import (
    PICKS,
    GoalTask,
    InstanceEpisode,
    SteppedEpisode,
    follow_oracle,
    open_instance_episode,
)
from grs_agents.sim.world.context import PROCESS_CONTEXT
from grs_agents.sim.world.recording import MotionRecording

LEAST_IDLE: Final = 2.0
"""Least simulated time without the robot, seconds, in which objects that fall into place by themselves are seen."""
_UNREST: Final = 0.05
"""Speed from which on an object is not at rest and may still come to its goal without any robot, m/s."""
_BESIDE: Final = 0.1
"""Largest gap to a neighbour that a pose goal may refer to, as in "to the left of the milk", metres."""
_TRIAL_SOLVED: Final = 0.9
"""Score above which a trial of a hand that misses counts as solved."""
HAND_NOISE: Final = (0.005, 0.01)
"""Errors of the hand (m): a task must bear the first; the second is reported. `grs grade` goes further."""


class NoisyTrial(Frozen):
    """An episode of the oracle whose hand misses each pose of each action by up to ``noise``, in any direction."""

    noise: float  # metres
    score: float  # 0..1: the lower of the published and the strict one; 0 unless every goal was met


class Rollout(Frozen):
    """The trusted oracle's run of an instance."""

    seed: int
    episode: Episode
    # reward of all goals together after ``idle_seconds`` without actions; 1 if the scene does not come to rest
    idle_reward: float
    idle_scores: tuple[float, ...] = ()  # score of each goal then, 0..1; objects count by the last goal they have
    idle_seconds: float = LEAST_IDLE  # simulated time of the oracle's episode
    moved: tuple[str, ...]  # assets that the robot picked or pushed and that end more than 2 cm or 15 degrees away
    handled: tuple[tuple[int, ...], ...] = ()  # for each action the ids of the objects picked or pushed, in their order
    initial: dict[int, Pose]  # by object id, after settling
    final: dict[int, Pose]
    reachable: tuple[int, ...]  # ids of rigid objects
    overlaps: tuple[Overlap, ...] = ()  # as the instance places its objects, before they settle
    supports: tuple[Support, ...] = ()  # of each loose object of the task at the end
    neighbours: tuple[int, ...] = ()  # ids of the objects that goals' objects end on, in or (pose goals) close beside
    trials: tuple[NoisyTrial, ...] = ()
    recording: str | None = None  # .npz file
    warnings: tuple[str, ...] = ()  # assumptions of the runtime, also those made while the program set the scene up

    @property
    def reward(self) -> float:
        """The published reward at the end, 0..1."""
        return self.episode.reward

    @property
    def strict_score(self) -> float:
        """The strict score at the end, 0..1."""
        return self.episode.strict


def rollout(
    instance: TaskInstance, library: Library | None = None, recording: Path | None = None, trials: int = 0
) -> Rollout:
    """Let the oracle solve an instance; the program it came from is not needed.

    ``recording`` is an .npz file to write: ``times`` (N,), ``positions`` (N, B, 3), ``quaternions`` (N, B, 4, xyzw),
    ``names`` (B,) ("object_<id>" or a robot link), ``tool`` (N, 3). ``trials`` is how often it solves the instance
    again with the least noise of the hand.
    """
    return solve_episode(open_instance_episode(instance, library or PROCESS_CONTEXT.get_library()), recording, trials)


def solve_episode(run: InstanceEpisode, recording: Path | None = None, trials: int = 0) -> Rollout:
    """As ``rollout``, in episodes of an instance on a table that exists already."""
    sim, task = run.sim, run.task
    instance = task.instance
    oracle = task.oracle(sim)
    initial: dict[int, Pose] = {}
    begin = 0.0
    reachable: tuple[int, ...] = ()
    overlaps: tuple[Overlap, ...] = ()
    recorder: MotionRecording | None = None
    try:
        run.set_up_scene()
        instance_ids = _instance_ids(run)
        overlaps = tuple(
            Overlap(first=instance_ids[pair.first], second=instance_ids[pair.second], depth=pair.depth)
            for pair in measure_overlaps(sim)
        )
        run.reset()
        initial = _object_poses(run)
        reachable = tuple(key for key, number in task.ids.items() if _is_top_reachable(sim, number))
        recorder = MotionRecording(sim.physics, task.ids) if recording is not None else None
        begin = float(sim.physics.data.time)
        follow_oracle(oracle, run)
    except GrsError as error:
        sim.recorder.stop = make_stop_from_error(error)
    final = _object_poses(run) if initial else {}
    if recorder is not None and recording is not None:
        recorder.save(recording)
    episode, instance_ids = sim.current_episode, _instance_ids(run)
    acted_on = [(action.object, *action.pushed) for action in episode.actions]
    touched = {number for row in acted_on for number in row}
    done = Rollout(
        seed=instance.seed,
        episode=episode,
        idle_reward=1.0,
        moved=tuple(motion.asset for motion in episode.motions if motion.moved and motion.object in touched),
        handled=tuple(
            tuple(dict.fromkeys(instance_ids[number] for number in row if number in instance_ids)) for row in acted_on
        ),
        initial=initial,
        final=final,
        reachable=reachable,
        overlaps=overlaps,
        recording=str(recording) if recorder is not None else None,
        warnings=tuple(dict.fromkeys((*instance.warnings, *sim.warnings))),
    )
    if not initial:  # a scene that cannot be set up is not measured, and must not count as left to do
        return done
    seconds = max(float(sim.physics.data.time) - begin, LEAST_IDLE)
    if episode.outcome == "success":
        done = done.model_copy(update=_measure_supports_and_neighbours(run))
        done = done.model_copy(update={"trials": tuple(_run_noisy_trials(run, oracle, trials))})
    return done.model_copy(update=_measure_idle_episode(run, seconds))


def run_oracle(
    env: SteppedEpisode,
    task: GoalTask,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    oracle: Oracle | None = None,
) -> None:
    """Let the oracle act in a reset environment until it is done or stops; ``env.current_episode`` says how it went.

    ``noise`` and ``rng`` as ``follow_oracle``.
    """
    follow_oracle(oracle or task.oracle(env), env, noise, rng)


def _run_noisy_trials(run: InstanceEpisode, oracle: Oracle, count: int) -> list[NoisyTrial]:
    """``count`` episodes with the least noise of the hand; if several, then a single episode with each larger noise.

    Stops where fewer than half succeed.
    """
    trials: list[NoisyTrial] = []
    run.task.max_steps = PICKS * run.task.instance.max_steps
    for noise in HAND_NOISE:
        scores: list[float] = []
        for trial in range(count):
            try:
                run.reset()
                rng = np.random.default_rng((run.task.instance.seed, int(1000 * noise), trial))
                follow_oracle(oracle, run, noise, rng)
            except GrsError as error:
                run.recorder.stop = make_stop_from_error(error)
            episode = run.sim.current_episode
            scores.append(min(episode.reward, episode.strict) if episode.outcome == "success" else 0.0)
            trials.append(NoisyTrial(noise=noise, score=scores[-1]))
        if 2 * sum(score > _TRIAL_SOLVED for score in scores) < len(scores):
            break
        count = min(1, count // 2) if noise == HAND_NOISE[0] else count
    return trials


def _measure_supports_and_neighbours(run: InstanceEpisode) -> dict[str, Any]:
    """Fields of a ``Rollout`` about a solved scene: supports of its objects, and neighbours of its goals' objects."""
    sim, task, instance_ids = run.sim, run.task, _instance_ids(run)
    supports = [
        support.model_copy(update={"object": instance_ids[support.object]}) for support in measure_supports(sim)
    ]
    view = PlanningScene(sim, task.grs.stated, task.goals)
    neighbours: set[int] = set()
    for goal in task.grs.stated:
        for number in goal.objects:
            neighbours |= supporting_object_ids(number, view) | enclosing_object_ids(number, view)
            if goal.metric == "pose":
                rest = set(view.object_ids) - {number}
                neighbours |= {other for other in rest if gap_between_objects(number, other, view) < _BESIDE}
    return {"supports": tuple(supports), "neighbours": tuple(sorted(instance_ids[number] for number in neighbours))}


def _measure_idle_episode(run: InstanceEpisode, seconds: float) -> dict[str, Any]:
    """Fields of a ``Rollout`` about an episode without actions, for a simulated time in seconds."""
    sim, task = run.sim, run.task
    idle: dict[str, Any] = {"idle_seconds": seconds}
    try:
        run.reset()
        for _ in range(math.ceil(seconds / LEAST_IDLE)):
            sim.step_simulation(int(LEAST_IDLE / sim.timestep))
            if sim.physics.is_asleep:  # nothing moves any more without the robot
                break
    except GrsError:
        return idle  # the reward stays 1
    scores = score_goals_by_latest_mention(task)
    idle["idle_scores"] = tuple(scores)
    if sim.physics.max_free_body_speed() <= _UNREST:
        # The published reward stops at the first goal that is open, though later ones may hold already.
        worth = sum(goal.max_reward * score for goal, score in zip(task.grs.stated, scores, strict=True))
        idle["idle_reward"] = float(min(1.0, max(worth, task.reward()[0])))
    return idle


def score_goals_by_latest_mention(task: GoalTask) -> list[float]:
    """Score of each goal now, 0..1; an object of several goals scores as the last of them asks."""
    last: dict[int, float] = {}
    means: list[float] = []
    for goal in reversed(task.grs.stated):
        for number, score in zip(goal.objects, task.grs.score_goal_objects(goal), strict=True):
            last.setdefault(number, score)
        means.insert(0, float(np.mean([last[number] for number in goal.objects])))
    return means


def _instance_ids(run: InstanceEpisode) -> dict[int, int]:
    """Id in the instance by id on the table."""
    return {number: key for key, number in run.task.ids.items()}


def _object_poses(run: InstanceEpisode) -> dict[int, Pose]:
    return {key: run.sim.get_object_pose(number) for key, number in run.task.ids.items()}


def _is_top_reachable(sim: TabletopSim, number: int) -> bool:
    """Whether an object can move and the arm reaches its top."""
    if not sim.is_object_movable(number):
        return False
    position, size = sim.get_object_pose(number)[0], sim.get_object_size(number)
    top = np.array([max(0.0, position[2] + size[2] / 2)])
    return bool(ReachTest(0.0, sim.arm)(np.array([position[:2]]), top)[0])
