"""Task instances and the trusted oracle's rollouts of them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from grs_agents.files import write_json
from grs_agents.nodes.services import Services
from grs_agents.sim import Rollout, TaskInstance
from grs_agents.trace import Rollout as RolloutEvent


@dataclass(frozen=True)
class SolvedInstances:
    """What trusted code measured of a program."""

    instances: tuple[TaskInstance, ...]  # one validated task instance for each seed that gave one
    failures: tuple[str, ...]
    rollouts: tuple[Rollout, ...]


def solve_task_instances(simulation: str, services: Services, background: str | None = None) -> SolvedInstances:
    """Instantiate ``simulation`` for each audit seed in the sandbox, then solve each instance in a process that has
    never imported it; as many at a time as the sandbox has workers.

    The program has the ``background`` around it and cannot name it: its asset is put around every instance here, and
    whatever came out of the sandbox in its place is overwritten.
    """
    roots = [str(root) for root in services.library.roots]
    seeds = [services.config.seed + step for step in range(services.config.audit.seeds)]
    around = {"library_roots": roots, "robot": services.robot_name_or_path, "background": background}
    result = services.run_tool("instantiate", simulation=simulation, seeds=seeds, **around)
    failures = [f"seed {failure.seed}: {failure.outcome}: {failure.message}" for failure in result.failures]
    for stale in (services.folder / "instances").glob("seed_*"):  # of the program before this one
        stale.unlink()
    instances = [TaskInstance.model_validate({**instance, "background": background}) for instance in result.instances]
    for instance in instances:
        write_json(services.folder / _instance_file_name(instance, "json"), instance.model_dump(mode="json"))
    rollouts: list[Rollout] = []

    def solve(instance: TaskInstance) -> Any:
        return services.run_tool(
            "rollout",
            instance=instance.model_dump(mode="json"),
            library_roots=roots,
            robot=services.robot_name_or_path,
            recording=str((services.folder / _instance_file_name(instance, "npz")).resolve()),
        )

    with ThreadPoolExecutor(services.config.workers) as pool:
        outcomes = pool.map(solve, instances)
        for instance, outcome in zip(instances, outcomes, strict=True):
            if outcome.rollout is None:
                failures.append(f"seed {instance.seed}: rollout {outcome.outcome}: {outcome.error}")
                continue
            update = {"recording": _instance_file_name(instance, "npz")}
            rollouts.append(Rollout.model_validate(outcome.rollout).model_copy(update=update))
            services.log.append(_make_rollout_event(instance, rollouts[-1]))
    return SolvedInstances(tuple(instances), tuple(failures), tuple(rollouts))


def _instance_file_name(instance: TaskInstance, suffix: str) -> str:
    """The name of what is kept of an instance, relative to the run folder."""
    return f"instances/seed_{instance.seed}.{suffix}"


def _make_rollout_event(instance: TaskInstance, rollout: Rollout) -> RolloutEvent:
    return RolloutEvent(
        seed=instance.seed,
        reward=rollout.episode.reward,
        outcome=rollout.episode.outcome,
        steps=rollout.episode.steps,
        moved=rollout.moved,
        idle_reward=rollout.idle_reward,
        recording=rollout.recording,
        instance=_instance_file_name(instance, "json"),
    )
