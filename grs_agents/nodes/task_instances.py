"""What is audited: two programs, their task instances, and the trusted oracle's rollouts of them."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from grs_agents.agents import TaskDefinition
from grs_agents.files import write_json
from grs_agents.nodes.bystanders import setup_of_programs
from grs_agents.nodes.services import Services
from grs_agents.perception import SceneDescription
from grs_agents.sandbox import TestReport
from grs_agents.sim import Rollout, TaskInstance, describe_first_error, place_bystanders
from grs_agents.trace import Rollout as RolloutEvent

NOISY_TRIALS = 5
"""Episodes with the least noise of the hand, shared out among different instances."""


@dataclass(frozen=True)
class AuditedPrograms:
    """What is audited, and what it is measured against."""

    simulation: str  # source of the simulation program
    tests: str | None = None  # source of its tests, if there are any
    report: TestReport | None = None  # of those tests
    task: TaskDefinition | None = None  # None: no words are given
    original: TaskDefinition | None = None  # the task before it was revised
    scene: SceneDescription | None = None  # the photo; None: the program need not keep to one
    name: str = "task_code"  # another module name that the tests may import the program by


@dataclass(frozen=True)
class SolvedInstances:
    """What trusted code measured of a program."""

    instances: tuple[TaskInstance, ...]  # one validated task instance for each seed that gave one
    failures: tuple[str, ...]
    rollouts: tuple[Rollout, ...]


def solve_task_instances(simulation: str, services: Services, scene: SceneDescription | None = None) -> SolvedInstances:
    """Instantiate ``simulation`` for each audit seed in the sandbox, then solve each instance in a process that has
    never imported it; as many at a time as the sandbox has workers. Instances that differ in their seeds alone are
    solved once.

    The program has the background and the bystanders of the ``scene`` around it and cannot name them: they are put
    around every instance here, and whatever came out of the sandbox in their place is overwritten.
    """
    instances, failures = _draw_instances(simulation, services, scene)
    for stale in (services.folder / "instances").glob("seed_*"):  # of the program before this one
        stale.unlink()
    for instance in instances:
        write_json(services.folder / _instance_file_name(instance, "json"), instance.model_dump(mode="json"))
    rollouts, unsolved = _solve_different_instances(instances, services)
    return SolvedInstances(tuple(instances), (*failures, *unsolved), rollouts)


def _solve_different_instances(
    instances: Sequence[TaskInstance], services: Services
) -> tuple[tuple[Rollout, ...], list[str]]:
    """A rollout for each instance, in the order of their seeds, and why there is none for the others."""
    alike: dict[str, list[TaskInstance]] = {}
    for instance in instances:
        alike.setdefault(instance.model_dump_json(exclude={"seed"}), []).append(instance)
    rollouts: list[Rollout] = []
    failures: list[str] = []

    def solve(rank: int, instance: TaskInstance) -> Any:
        return services.run_tool(
            "rollout",
            instance=instance.model_dump(mode="json"),
            recording=str((services.folder / _instance_file_name(instance, "npz")).resolve()),
            trials=len(range(rank, NOISY_TRIALS, len(alike))),
            **services.simulator_setup,
        )

    with ThreadPoolExecutor(services.config.workers) as pool:
        outcomes = pool.map(solve, range(len(alike)), [same[0] for same in alike.values()])
        for same, outcome in zip(alike.values(), outcomes, strict=True):
            if outcome.rollout is None:
                failures += [f"seed {one.seed}: rollout {outcome.outcome}: {outcome.error}" for one in same]
                continue
            update = {"recording": _instance_file_name(same[0], "npz")}
            solved = Rollout.model_validate(outcome.rollout).model_copy(update=update)
            # What was measured once counts once: the trials stay with the first.
            again = [solved.model_copy(update={"seed": one.seed, "trials": ()}) for one in same[1:]]
            for instance, done in zip(same, [solved, *again], strict=True):
                rollouts.append(done)
                services.log.append(_make_rollout_event(instance, done))
    return tuple(sorted(rollouts, key=lambda done: done.seed)), failures


def _draw_instances(
    simulation: str, services: Services, scene: SceneDescription | None
) -> tuple[list[TaskInstance], list[str]]:
    """The instance of each audit seed as trusted code completes it, and why others have none."""
    setup = setup_of_programs(scene, services)
    seeds = [services.config.seed + step for step in range(services.config.audit.seeds)]
    result = services.run_tool("instantiate", simulation=simulation, seeds=seeds, **setup)
    failures = [f"seed {failure.seed}: {failure.outcome}: {failure.message}" for failure in result.failures]
    instances: list[TaskInstance] = []
    for drawn in result.instances:
        instance = TaskInstance.model_validate({**drawn, "background": setup["background"]})
        try:
            instances.append(place_bystanders(instance, setup["bystanders"]))
        except ValidationError as error:
            failures.append(f"seed {instance.seed}: invalid: {describe_first_error(error)}")
    return instances, failures


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
