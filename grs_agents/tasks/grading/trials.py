"""Trials: episodes of varied instances by the expert, by an expert whose hand misses, and by policies."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError
from grs_agents.sim.goals.scores import SOLVED
from grs_agents.sim.tabletop_episode import PICKS, follow_oracle, open_instance_episode
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.grading.primitive_policy import PrimitivePolicy
from grs_agents.tasks.grading.primitive_task import PrimitiveTask, decide, demonstrate, evaluate_policy, random_decision
from grs_agents.tasks.task_folder import TaskFolder, open_task_folder
from grs_agents.tasks.worker_pool import map_in_processes

NOISES: Final = (0.0, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.08)
"""Errors of the hand, metres, tried in this order."""
_UNSEEN: Final = 1_000_000
"""First seed of the instances used for grading; seeds of demonstrations begin at 0."""
_DEMONSTRATION_NOISE: Final = 0.005
"""Error of the hand in every second demonstration, metres."""
Count = Annotated[int, Field(ge=1, le=10_000)]
Show = Callable[[str, int, int], None]
"""Called with the stage, and the numbers of finished and of all episodes."""


class GradeOrder(Frozen):
    """Size of a grading."""

    episodes: Count = 30  # of each policy, on unseen instances
    demonstrations: Count = 60
    trials: Count = 12  # of the expert at each error of its hand
    variation: Variation = Variation(jitter=0.03, yaw=float(np.deg2rad(30)))
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0


@dataclass(frozen=True)
class ExpertEpisode:
    """Result of an episode of the expert with a hand that misses."""

    solved: bool
    moves: int


@dataclass(frozen=True)
class _Job:
    """An episode to simulate."""

    kind: Literal["expert", "demonstration", "random", "learned"]
    seed: int
    noise: float = 0.0


class Trials:
    """Runs episodes of varied instances, by experts and policies."""

    def __init__(self, folder: TaskFolder, order: GradeOrder, workers: int, show: Show) -> None:
        self._folder, self._order, self._workers, self._show = folder, order, workers, show

    def noise_levels(self) -> list[list[ExpertEpisode]]:
        """Episodes of the expert at each of ``NOISES``, up to the first at which it fails more than half of them."""
        levels: list[list[ExpertEpisode]] = []
        for noise in NOISES:
            jobs = [_Job("expert", _UNSEEN + index, noise) for index in range(self._order.trials)]
            levels.append(self._run_jobs(f"expert, hand off by {1000 * noise:g} mm", jobs))
            if 2 * sum(episode.solved for episode in levels[-1]) < sum(episode.solved for episode in levels[0]):
                break
        return levels

    def learned_success(self) -> tuple[float, int]:
        """Share of unseen instances that an imitating policy solves, and the number of its demonstrations.

        In every second demonstration the expert's hand misses by 5 mm, so that it shows corrections.
        """
        jobs = [
            _Job("demonstration", index, _DEMONSTRATION_NOISE * (index % 2))
            for index in range(self._order.demonstrations)
        ]
        shown = [result for result in self._run_jobs("demonstrations", jobs) if result is not None]
        shown = [result for result in shown if result.features.shape[1] == shown[0].features.shape[1]]
        if not shown:
            return 0.0, 0
        policy = PrimitivePolicy(shown, self._order.seed)
        jobs = [_Job("learned", _UNSEEN + index) for index in range(self._order.episodes)]
        return float(np.mean(self._run_jobs("learned policy", jobs, policy))), len(shown)

    def random_success(self) -> float:
        """Share of instances that random decisions solve."""
        jobs = [_Job("random", _UNSEEN + index) for index in range(self._order.episodes)]
        return float(np.mean(self._run_jobs("random policy", jobs)))

    def _run_jobs(self, stage: str, jobs: Sequence[_Job], policy: PrimitivePolicy | None = None) -> list[Any]:
        """Results of the jobs, in their order."""
        results: dict[_Job, Any] = {}
        for job, result in map_in_processes(
            _run_job, jobs, self._workers, _load_worker_state, (self._folder.path, self._order, policy)
        ):
            results[job] = result
            self._show(stage, len(results), len(jobs))
        return [results[job] for job in jobs]


@dataclass
class _WorkerState:
    """State that a process keeps between jobs."""

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
        run = open_instance_episode(instance, bench.folder.library)
        if job.noise:
            run.task.max_steps *= PICKS
        try:
            run.reset()
            follow_oracle(run.task.oracle(run.sim), run, job.noise, rng if job.noise else None)
        except GrsError:
            return job, ExpertEpisode(False, 0)
        episode = run.sim.current_episode
        return job, ExpertEpisode(min(episode.strict, episode.reward) >= SOLVED, len(episode.actions))
    if bench.task is None:
        bench.task = PrimitiveTask(instance, bench.folder.library)
    task, policy = bench.task, bench.policy
    if job.kind == "demonstration":
        return job, demonstrate(task, instance, job.noise, rng)
    if policy is not None:
        return job, evaluate_policy(task, instance, lambda now: decide(policy, now))
    return job, evaluate_policy(task, instance, lambda now: random_decision(now, rng))
