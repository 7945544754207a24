"""The task instances of a program that is audited, and the trusted oracle's rollouts of them."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.goal_sentences import name_instance_objects
from grs_agents.base.errors import GrsError
from grs_agents.base.files import write_json
from grs_agents.base.geometry.transforms import matrix_to_quaternion, to_vec3
from grs_agents.base.trace.events import Rollout as RolloutEvent
from grs_agents.graph.bystanders import program_tool_settings
from grs_agents.graph.services import Services
from grs_agents.perception.types import SceneDescription
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim.arms.arm_files import make_robot_path_relative
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.task_instance import InstanceCamera, InstanceLight, InstanceTable, TaskInstance
from grs_agents.sim.rollouts import HAND_NOISE, Rollout
from grs_agents.sim.world.bystanders import place_bystanders
from grs_agents.sim.world.spec import fill_in_masses_and_frictions

NOISY_TRIALS: Final = 4
"""Episodes with the least noise of the hand, shared out among distinct instances. If a single trial fails, a fifth
decides: four of five must be solved."""
_OTHER_KINDS: Final = 2
"""Bound on the instances of unforeseen seeds that are audited for being of another kind: random colours make many."""


@dataclass(frozen=True)
class AuditedPrograms:
    """Two programs, and the task and scene that they are measured against."""

    simulation: str  # source of the simulation program
    tests: str | None = None  # source of its tests, if there are any
    report: TestReport | None = None  # of those tests
    task: TaskDefinition | None = None  # None: no words are given
    original: TaskDefinition | None = None  # the task before it was revised
    scene: SceneDescription | None = None  # the photo; None: the program need not keep to a photo
    name: str = "task_code"  # another module name that the tests may import the program by


@dataclass(frozen=True)
class SolvedInstances:
    """The measurements that trusted code made of a program."""

    instances: tuple[TaskInstance, ...]  # a validated task instance for each seed that gave one
    failures: tuple[str, ...]
    rollouts: tuple[Rollout, ...]
    unforeseen: "SolvedInstances | None" = None  # the same of seeds that no program can name


def solve_task_instances(
    simulation: str, services: Services, scene: SceneDescription | None = None, unforeseen_seeds: Sequence[int] = ()
) -> SolvedInstances:
    """Instantiate ``simulation`` for each audit seed in the sandbox, then solve each instance in a process that has
    never imported it; as many at a time as the sandbox has workers. Instances that differ only in their seeds are
    solved once.

    Each instance is complete: it holds everything that simulates and shows it, independent of configuration and photo.
    Instances of ``unforeseen_seeds`` are not written. The first of them is solved, and those with scenes of another
    kind.
    """
    seeds = [services.config.seed + step for step in range(services.config.audit.seeds)]
    once = unforeseen_seeds[1:]
    drawn, failed = instantiate_program_for_seeds(simulation, [*seeds, *unforeseen_seeds[:1]], services, scene, once)
    instances = [instance for instance in drawn if instance.seed not in unforeseen_seeds]
    others = {instance.seed: instance for instance in drawn if instance.seed in unforeseen_seeds}
    extra = [others.pop(seed) for seed in unforeseen_seeds[:1] if seed in others]
    extra += _find_instances_of_other_kinds(list(others.values()), [*instances, *extra])
    _write_instances(instances, services)
    rollouts, unsolved = _solve_distinct_instances(instances, extra, services)
    failures = [*failed, *unsolved]
    solved = _select_seeds(instances, seeds, failures, rollouts)
    if not unforeseen_seeds:
        return solved
    # the other seeds may find no free place by chance
    required = [*unforeseen_seeds[:1], *(instance.seed for instance in extra)]
    return replace(solved, unforeseen=_select_seeds(extra, required, failures, rollouts))


def play_first_seed(simulation: str, services: Services, scene: SceneDescription | None = None) -> tuple[Rollout, ...]:
    """Play the first seed with the trusted oracle, and write and log the rollout.

    Returns:
        The rollout; nothing if the program gives no valid instance or the rollout fails.
    """
    instances, _ = instantiate_program_for_seeds(simulation, [services.config.seed], services, scene)
    _write_instances(instances, services)
    if not instances:
        return ()
    (played,) = _play_jobs([_make_rollout_job(instances, 0, 1, services, trials=0)], services)
    return () if isinstance(played, str) else tuple(_share_rollout(instances, played, instances, services))


def play_unrecorded(instance: TaskInstance, services: Services) -> Rollout | None:
    """The trusted oracle's rollout of an instance, neither recorded nor logged; None if it fails."""
    (played,) = _play_jobs([_make_rollout_job([instance], 0, 0, services)], services)
    return None if isinstance(played, str) else played


def _select_seeds(
    instances: Sequence[TaskInstance],
    seeds: Sequence[int],
    failures: Sequence[tuple[int, str]],
    rollouts: Sequence[Rollout],
) -> SolvedInstances:
    lines = [line for seed, line in failures if seed in seeds]
    return SolvedInstances(tuple(instances), tuple(lines), tuple(done for done in rollouts if done.seed in seeds))


def _write_instances(instances: Sequence[TaskInstance], services: Services) -> None:
    """Write the instances into the run folder in place of those of the previous program."""
    for stale in (services.folder / "instances").glob("seed_*"):
        stale.unlink()
    for instance in instances:
        write_instance(instance, services)


def write_instance(instance: TaskInstance, services: Services) -> None:
    """Write an instance into the run folder."""
    portable = make_robot_path_relative(instance, services.folder)
    write_json(services.folder / _instance_file_name(instance.seed, "json"), portable)


def _find_instances_of_other_kinds(
    instances: Sequence[TaskInstance], known: Sequence[TaskInstance]
) -> list[TaskInstance]:
    """The first few instances with assets, colours or goals that no known scene has. If the known instances differ only
    in their seeds, any difference makes another kind."""
    describe = _describe_scene_kind
    if len({_dump_without_seed(instance) for instance in known}) == 1:
        describe = _dump_without_seed
    kinds = {describe(instance) for instance in known}
    extra: list[TaskInstance] = []
    for instance in instances:
        kind = describe(instance)
        if kind not in kinds and len(extra) < _OTHER_KINDS:
            kinds.add(kind)
            extra.append(instance)
    return extra


def _dump_without_seed(instance: TaskInstance) -> str:
    return instance.model_dump_json(exclude={"seed"})


def _describe_scene_kind(instance: TaskInstance) -> str:
    """The objects and goals of an instance without positions and sizes."""
    things = {item.id: (item.asset, item.category, item.role, item.color) for item in instance.objects}
    goals = [
        (
            goal.metric,
            goal.relation_kind,
            [things[number] for number in goal.mentioned_object_ids],
            goal.matches,
            goal.replace,
            goal.rotations,
            len(goal.zones),
        )
        for goal in instance.goals
    ]
    return repr((sorted(things.values(), key=repr), goals))


def _solve_distinct_instances(
    instances: Sequence[TaskInstance], unforeseen: Sequence[TaskInstance], services: Services
) -> tuple[tuple[Rollout, ...], list[tuple[int, str]]]:
    """Solve ``instances``, which are filmed and share the noisy trials, and ``unforeseen``, which are not.

    Returns:
        A rollout for each solved instance, in the order of their seeds, and (seed, reason) of the others.
    """
    alike: dict[str, list[TaskInstance]] = {}
    for instance in [*instances, *unforeseen]:
        alike.setdefault(_dump_without_seed(instance), []).append(instance)
    firsts = [same[0] for same in alike.values()]
    filmed = sum(first in instances for first in firsts)
    played = _play_jobs([_make_rollout_job(firsts, rank, filmed, services) for rank in range(len(firsts))], services)
    solved = [rollout for rollout in played[:filmed] if not isinstance(rollout, str)]
    if len(solved) == filmed:
        least = services.config.audit.reward
        missed = [t for done in solved for t in done.trials if t.noise == HAND_NOISE[0] and t.score < least]
        if len(missed) == 1:
            rank = NOISY_TRIALS % filmed
            again = _make_rollout_job(firsts, rank, filmed, services, NOISY_TRIALS + 1)
            (played[rank],) = _play_jobs([again], services)
    rollouts: list[Rollout] = []
    failures: list[tuple[int, str]] = []
    for same, rollout in zip(alike.values(), played, strict=True):
        if isinstance(rollout, str):
            failures += [(instance.seed, f"seed {instance.seed}: {rollout}") for instance in same]
        else:
            rollouts += _share_rollout(same, rollout, instances, services)
    return tuple(sorted(rollouts, key=lambda done: done.seed)), failures


def _share_rollout(
    same: Sequence[TaskInstance], solved: Rollout, instances: Sequence[TaskInstance], services: Services
) -> list[Rollout]:
    """Copy a rollout to each instance that differs only in its seed; log an event for each of ``instances``."""
    if same[0] in instances:
        solved = solved.model_copy(update={"recording": _instance_file_name(same[0].seed, "npz")})
    # trials count once: they stay with the first
    copies = [solved.model_copy(update={"seed": instance.seed, "trials": ()}) for instance in same[1:]]
    log_rollouts(
        [done for instance, done in zip(same, [solved, *copies], strict=True) if instance in instances], services
    )
    return [solved, *copies]


def _make_rollout_job(
    instances: Sequence[TaskInstance], rank: int, filmed: int, services: Services, trials: int = NOISY_TRIALS
) -> dict[str, Any]:
    """The request of the tool ``rollout`` for ``instances[rank]``; the first ``filmed`` instances are recorded and
    share ``trials`` evenly."""
    instance = instances[rank]
    job: dict[str, Any] = {"instance": instance.model_dump(mode="json")}
    if rank < filmed:
        job["recording"] = str((services.folder / _instance_file_name(instance.seed, "npz")).resolve())
        job["trials"] = len(range(rank, trials, filmed))
    return job


def _play_jobs(jobs: Sequence[dict[str, Any]], services: Services) -> list[Rollout | str]:
    """The rollout of each job, or the reason why there is none; as many processes as the sandbox has workers share the
    jobs."""
    workers = services.config.workers

    def solve(first: int) -> list[Rollout | str]:
        job, *more = jobs[first::workers]
        result = services.run_tool("rollout", **job, more=more, **services.library_root_fields)
        return [
            f"rollout {done.outcome}: {done.error}" if done.rollout is None else Rollout.model_validate(done.rollout)
            for done in (result, *result.more)
        ]

    starts = range(min(workers, len(jobs)))
    played: list[Rollout | str] = [""] * len(jobs)
    with ThreadPoolExecutor(workers) as pool:
        for first, solved in zip(starts, pool.map(solve, starts), strict=True):
            played[first::workers] = solved
    return played


def instantiate_program_for_seeds(
    simulation: str,
    seeds: Sequence[int],
    services: Services,
    scene: SceneDescription | None,
    seeds_drawn_once: Sequence[int] = (),
) -> tuple[list[TaskInstance], list[tuple[int, str]]]:
    """Instantiate a program for each seed in the sandbox, and let trusted code complete the instances.

    The program has the background and the bystanders of the ``scene`` around it and cannot name them: they are put
    around every instance here, with arm, camera, light, table, mass and friction. Values of these from the sandbox are
    overwritten.

    Returns:
        The instances, and (seed, reason) of the seeds without one.
    """
    setup = program_tool_settings(scene, services)
    surroundings: dict[str, Any] = {
        "background": None if scene is None else scene.background,
        "robot": services.robot_name_or_path,
        "hand": services.config.hand,
        "camera": None if scene is None else _describe_camera(scene),
        "light": InstanceLight(),
        "table": InstanceTable() if scene is None else scene.instance_table,
        "instruction": "",
    }
    result = services.run_tool(
        "instantiate", simulation=simulation, seeds=seeds, seeds_drawn_once=seeds_drawn_once, **setup
    )
    failures = [
        (failure.seed, f"seed {failure.seed}: {failure.outcome}: {failure.message}") for failure in result.failures
    ]
    instances: list[TaskInstance] = []
    for drawn in result.instances:
        instance = TaskInstance.model_validate({**drawn, **surroundings})
        try:
            instance = place_bystanders(instance, setup["bystanders"])
            instance = name_instance_objects(instance, services.library, scene)
            instances.append(fill_in_masses_and_frictions(instance, services.library))
        except ValidationError as error:
            failures.append((instance.seed, f"seed {instance.seed}: invalid: {describe_first_error(error)}"))
        except (GrsError, ValueError) as error:  # an object that the library does not have, or cannot make
            failures.append((instance.seed, f"seed {instance.seed}: invalid: {error}"))
    return instances, failures


def _describe_camera(scene: SceneDescription) -> InstanceCamera | None:
    """The photo's camera in the robot frame; None if the scene has none, or its values are out of bounds."""
    if scene.camera is None:
        return None
    pose = np.asarray(scene.frame.T_robot_cam, dtype=np.float64)
    placed = (to_vec3(pose[:3, 3]), matrix_to_quaternion(pose[:3, :3]))
    robot_placed = scene.frame.origin != "calibrated"
    try:
        return InstanceCamera(**dict(scene.camera), pose=placed, robot_placed=robot_placed)
    except ValidationError:
        return None


def _instance_file_name(seed: int, suffix: str) -> str:
    """Name of a file of an instance, relative to the run folder."""
    return f"instances/seed_{seed}.{suffix}"


def log_rollouts(rollouts: Sequence[Rollout], services: Services) -> None:
    """Log an event for each rollout of an audit; its instance lies in the run folder."""
    for rollout in rollouts:
        services.log.append(
            RolloutEvent(
                seed=rollout.seed,
                reward=rollout.episode.reward,
                outcome=rollout.episode.outcome,
                steps=rollout.episode.steps,
                moved=rollout.moved,
                idle_reward=rollout.idle_reward,
                cause=rollout.episode.cause,
                recording=rollout.recording,
                instance=_instance_file_name(rollout.seed, "json"),
            )
        )
