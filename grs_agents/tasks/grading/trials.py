"""Episodes of varied instances: of the expert, of its hand when it misses, and of policies; in processes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import InstanceTask, run_oracle
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.grading.primitive_policy import PrimitivePolicy
from grs_agents.tasks.grading.primitive_task import (
    SOLVED,
    PrimitiveTask,
    decide,
    demonstrate,
    evaluate_policy,
    random_decision,
)
from grs_agents.tasks.task_folder import TaskFolder, open_task_folder
from grs_agents.tasks.worker_pool import map_in_processes

NOISES: Final = (0.0, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.08)
"""Metres by which the hand may miss, tried from the least on."""
_PICKS: Final = 5
_UNSEEN: Final = 1_000_000
"""Seeds of instances to be graded on begin here, those of demonstrations at 0."""
Count = Annotated[int, Field(ge=1, le=10_000)]
Show = Callable[[str, int, int], None]
"""Told the stage, and how many of how many are done."""


class GradeOrder(Frozen):
    """How much is tried."""

    episodes: Count = 30  # of each policy, on instances that no demonstration is of
    demonstrations: Count = 60
    trials: Count = 12  # of the expert at each noise of its hand
    variation: Variation = Variation(jitter=0.03, yaw=float(np.deg2rad(30)))
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0


@dataclass(frozen=True)
class ExpertEpisode:
    """An episode of the expert with a hand that misses."""

    solved: bool
    moves: int


@dataclass(frozen=True)
class _Job:
    """One episode to be simulated."""

    kind: Literal["expert", "demonstration", "random", "learned"]
    seed: int
    noise: float = 0.0


class Trials:
    """Episodes of varied instances, by experts and policies."""

    def __init__(self, folder: TaskFolder, order: GradeOrder, workers: int, show: Show) -> None:
        self._folder, self._order, self._workers, self._show = folder, order, workers, show

    def noise_levels(self) -> list[list[ExpertEpisode]]:
        """Episodes of the expert at each of ``NOISES``, up to the first at which it fails more than half of them."""
        levels: list[list[ExpertEpisode]] = []
        for noise in NOISES:
            jobs = [_Job("expert", _UNSEEN + index, noise) for index in range(self._order.trials)]
            levels.append(self._run_jobs(f"expert, hand off by {1000 * noise:g} mm", jobs))
            if 2 * sum(one.solved for one in levels[-1]) < sum(one.solved for one in levels[0]):
                break
        return levels

    def learned_success(self) -> tuple[float, int]:
        """The share of unseen instances that a policy solves which learned from demonstrations, and how many it had.

        Every second one is of an expert whose hand misses by 5 mm, and who mends it.
        """
        jobs = [_Job("demonstration", index, 0.005 * (index % 2)) for index in range(self._order.demonstrations)]
        shown = [one for one in self._run_jobs("demonstrations", jobs) if one is not None]
        shown = [one for one in shown if one.features.shape[1] == shown[0].features.shape[1]]
        if not shown:
            return 0.0, 0
        policy = PrimitivePolicy(shown, self._order.seed)
        jobs = [_Job("learned", _UNSEEN + index) for index in range(self._order.episodes)]
        return float(np.mean(self._run_jobs("learned policy", jobs, policy))), len(shown)

    def random_success(self) -> float:
        """The share of instances that random decisions solve."""
        jobs = [_Job("random", _UNSEEN + index) for index in range(self._order.episodes)]
        return float(np.mean(self._run_jobs("random policy", jobs)))

    def _run_jobs(self, stage: str, jobs: Sequence[_Job], policy: PrimitivePolicy | None = None) -> list[Any]:
        """The results of jobs, in their order."""
        results: dict[_Job, Any] = {}
        for job, result in map_in_processes(
            _run_job, jobs, self._workers, _load_worker_state, (self._folder.path, self._order, policy)
        ):
            results[job] = result
            self._show(stage, len(results), len(jobs))
        return [results[job] for job in jobs]


@dataclass
class _WorkerState:
    """What a process keeps between jobs."""

    folder: TaskFolder
    order: GradeOrder
    policy: PrimitivePolicy | None
    task: PrimitiveTask | None = None


_bench: list[_WorkerState] = []


def _load_worker_state(path: Path, order: GradeOrder, policy: PrimitivePolicy | None) -> None:
    known = _bench[0] if _bench and (_bench[0].folder.path, _bench[0].order) == (path, order) else None
    folder = known.folder if known else open_task_folder(path, accepted=False)
    _bench[:] = [_WorkerState(folder, order, policy, known.task if known else None)]


def _run_job(job: _Job) -> tuple[_Job, Any]:
    bench = _bench[0]
    rng = np.random.default_rng((bench.order.seed, job.seed, int(1e6 * job.noise)))
    seeds = bench.folder.seeds
    base = bench.folder.read_instance(seeds[job.seed % len(seeds)])
    drawn = np.random.default_rng((bench.order.seed, job.seed))
    try:
        instance = vary_instance(base, bench.order.variation, drawn, bench.folder.library)
    except GrsError:
        return job, {"expert": ExpertEpisode(False, 0), "demonstration": None}.get(job.kind, False)
    if job.kind == "expert":
        return job, _run_expert(instance, bench, job.noise, rng)
    if bench.task is None:
        bench.task = PrimitiveTask(instance, bench.folder.library)
    task, policy = bench.task, bench.policy
    if job.kind == "demonstration":
        return job, demonstrate(task, instance, job.noise, rng)
    if policy is not None:
        return job, evaluate_policy(task, instance, lambda one: decide(policy, one))
    return job, evaluate_policy(task, instance, lambda one: random_decision(one, rng))


def _run_expert(instance: TaskInstance, bench: _WorkerState, noise: float, rng: np.random.Generator) -> ExpertEpisode:
    """The expert with a hand that misses, and that tries a pick again which it missed."""
    task = InstanceTask(instance)
    env = Environment(task=task, library=bench.folder.library, seed=instance.seed, robot=instance.robot)
    env.timestep = instance.timestep
    if noise:
        task.max_steps *= _PICKS
    try:
        env.reset()
        run_oracle(env, task, noise, rng if noise else None)
    except GrsError:
        return ExpertEpisode(False, 0)
    episode = env.current_episode
    return ExpertEpisode(min(episode.strict, episode.reward) >= SOLVED, len(episode.actions))
