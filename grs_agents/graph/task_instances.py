"""What is audited: two programs, their task instances, and the trusted oracle's rollouts of them."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from grs_agents.agents.types import TaskDefinition
from grs_agents.base.errors import GrsError
from grs_agents.base.files import write_json
from grs_agents.base.geometry.transforms import matrix_to_quaternion, to_vec3
from grs_agents.base.trace.events import Rollout as RolloutEvent
from grs_agents.graph.bystanders import program_tool_settings
from grs_agents.graph.services import Services
from grs_agents.perception.types import SceneDescription
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.robot_file import make_robot_path_relative
from grs_agents.sim.instance.task_instance import InstanceCamera, InstanceLight, InstanceTable, TaskInstance
from grs_agents.sim.rollouts import HAND_NOISE, Rollout
from grs_agents.sim.world.bystanders import place_bystanders
from grs_agents.sim.world.spec import fill_in_masses_and_frictions

NOISY_TRIALS = 4
"""Episodes with the least noise of the hand, shared out among different instances. Where one of them fails, one more
decides whether four of five are solved."""
_OTHER_KINDS = 2
"""Instances of unforeseen seeds that are audited at most since they are of another kind: random colours make many."""


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
    unforeseen: "SolvedInstances | None" = None  # the same of seeds that no program can name


def solve_task_instances(
    simulation: str, services: Services, scene: SceneDescription | None = None, unforeseen_seeds: Sequence[int] = ()
) -> SolvedInstances:
    """Instantiate ``simulation`` for each audit seed in the sandbox, then solve each instance in a process that has
    never imported it; as many at a time as the sandbox has workers. Instances that differ in their seeds alone are
    solved once.

    Each instance is complete: it says what simulates and shows it, whatever the configuration and the photo are.
    ``unforeseen_seeds`` are more, of which nothing is written. Of these the first is solved, and whatever shows a scene
    of another kind.
    """
    seeds = [services.config.seed + step for step in range(services.config.audit.seeds)]
    once = unforeseen_seeds[1:]
    drawn, failed = instantiate_program_for_seeds(simulation, [*seeds, *unforeseen_seeds[:1]], services, scene, once)
    instances = [one for one in drawn if one.seed not in unforeseen_seeds]
    extra = _choose_unforeseen(drawn, instances, unforeseen_seeds)
    _write_instances(instances, services)
    rollouts, unsolved = _solve_different_instances(instances, extra, services)
    failures = [*failed, *unsolved]
    solved = _select_solved_seeds(instances, seeds, failures, rollouts)
    if not unforeseen_seeds:
        return solved
    asked = [*unforeseen_seeds[:1], *(one.seed for one in extra)]  # others may find no free place by chance
    return replace(solved, unforeseen=_select_solved_seeds(extra, asked, failures, rollouts))


def play_first_seed(simulation: str, services: Services, scene: SceneDescription | None = None) -> tuple[Rollout, ...]:
    """Play the first seed with the trusted oracle, and write and log the rollout.

    Returns:
        The rollout; nothing if the program gives no valid instance or the rollout fails.
    """
    instances, _ = instantiate_program_for_seeds(simulation, [services.config.seed], services, scene)
    _write_instances(instances, services)
    if not instances:
        return ()
    outcome = _run_rollout_tool([_make_rollout_job(instances, 0, 1, services, trials=0)], services)[0]
    if outcome.rollout is None:
        return ()
    return tuple(_share_rollout(instances, Rollout.model_validate(outcome.rollout), instances, services))


def _choose_unforeseen(
    drawn: Sequence[TaskInstance], instances: Sequence[TaskInstance], seeds: Sequence[int]
) -> list[TaskInstance]:
    """Of what was drawn for unforeseen ``seeds`` that of the first one, if it gave one, and those of other kinds."""
    others = {one.seed: one for one in drawn if one.seed in seeds}
    first = [others.pop(seed) for seed in seeds[:1] if seed in others]
    return [*first, *_find_instances_of_other_kinds(list(others.values()), [*instances, *first])]


def _select_solved_seeds(
    instances: Sequence[TaskInstance],
    seeds: Sequence[int],
    failures: Sequence[tuple[int, str]],
    rollouts: Sequence[Rollout],
) -> SolvedInstances:
    """What was measured of some seeds."""
    lines, done = [line for seed, line in failures if seed in seeds], [one for one in rollouts if one.seed in seeds]
    return SolvedInstances(tuple(instances), tuple(lines), tuple(done))


def _write_instances(instances: Sequence[TaskInstance], services: Services) -> None:
    """Into the run folder, in the place of those of the program before this one."""
    for stale in (services.folder / "instances").glob("seed_*"):
        stale.unlink()
    for instance in instances:
        written = make_robot_path_relative(instance, services.folder).model_dump(mode="json")
        write_json(services.folder / _instance_file_name(instance.seed, "json"), written)


def _find_instances_of_other_kinds(
    instances: Sequence[TaskInstance], known: Sequence[TaskInstance]
) -> list[TaskInstance]:
    """The first few of some instances whose scenes are of other kinds than those that are known: with other things,
    colours or goals. Where those do not differ at all, whatever does is of another kind."""
    describe = _describe_scene_kind
    if len({one.model_dump_json(exclude={"seed"}) for one in known}) == 1:
        describe = _describe_whole_scene
    kinds = {describe(one) for one in known}
    found: list[TaskInstance] = []
    for instance in instances:
        kind = describe(instance)
        if kind not in kinds and len(found) < _OTHER_KINDS:
            kinds.add(kind)
            found.append(instance)
    return found


def _describe_whole_scene(instance: TaskInstance) -> str:
    return instance.model_dump_json(exclude={"seed"})


def _describe_scene_kind(instance: TaskInstance) -> str:
    """What stands there and what is asked of it, but for where and how large it is."""
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


def _solve_different_instances(
    instances: Sequence[TaskInstance], unforeseen: Sequence[TaskInstance], services: Services
) -> tuple[tuple[Rollout, ...], list[tuple[int, str]]]:
    """A rollout for each instance, in the order of their seeds, and (seed, why) of those that have none. The
    ``instances`` are filmed and share the trials of a hand that misses; those that are ``unforeseen`` do not."""
    alike: dict[str, list[TaskInstance]] = {}
    for instance in [*instances, *unforeseen]:
        alike.setdefault(instance.model_dump_json(exclude={"seed"}), []).append(instance)
    firsts = [same[0] for same in alike.values()]
    filmed = sum(one in instances for one in firsts)
    outcomes = _run_rollout_tool(
        [_make_rollout_job(firsts, rank, filmed, services) for rank in range(len(firsts))], services
    )
    if _has_one_failed_noise_trial(outcomes[:filmed], services.config.audit.reward):
        rank = NOISY_TRIALS % filmed
        again = _make_rollout_job(firsts, rank, filmed, services, NOISY_TRIALS + 1)
        outcomes[rank] = _run_rollout_tool([again], services)[0]
    rollouts: list[Rollout] = []
    failures: list[tuple[int, str]] = []
    for same, outcome in zip(alike.values(), outcomes, strict=True):
        if outcome.rollout is None:
            failures += [(one.seed, f"seed {one.seed}: rollout {outcome.outcome}: {outcome.error}") for one in same]
            continue
        rollouts += _share_rollout(same, Rollout.model_validate(outcome.rollout), instances, services)
    return tuple(sorted(rollouts, key=lambda done: done.seed)), failures


def _share_rollout(
    same: Sequence[TaskInstance], solved: Rollout, instances: Sequence[TaskInstance], services: Services
) -> list[Rollout]:
    """A rollout for each of some instances that differ in their seeds alone; of the ``instances`` an event too."""
    if same[0] in instances:
        solved = solved.model_copy(update={"recording": _instance_file_name(same[0].seed, "npz")})
    # What was measured once counts once: the trials stay with the first.
    again = [solved.model_copy(update={"seed": one.seed, "trials": ()}) for one in same[1:]]
    for instance, done in zip(same, [solved, *again], strict=True):
        if instance in instances:
            services.log.append(_make_rollout_event(done))
    return [solved, *again]


def _make_rollout_job(
    instances: Sequence[TaskInstance], rank: int, filmed: int, services: Services, trials: int = NOISY_TRIALS
) -> dict[str, Any]:
    """What the tool ``rollout`` is to do with one of some instances, of which the first ``filmed`` are recorded and
    share ``trials`` evenly."""
    instance = instances[rank]
    job: dict[str, Any] = {"instance": instance.model_dump(mode="json")}
    if rank < filmed:
        job["recording"] = str((services.folder / _instance_file_name(instance.seed, "npz")).resolve())
        job["trials"] = len(range(rank, trials, filmed))
    return job


def _run_rollout_tool(jobs: Sequence[dict[str, Any]], services: Services) -> list[Any]:
    """The outcome of each job: as many processes as the sandbox has workers share them."""
    workers = services.config.workers

    def solve(first: int) -> list[Any]:
        job, *more = jobs[first::workers]
        result = services.run_tool("rollout", **job, more=more, **services.library_root_fields)
        return [result, *result.more]

    starts = range(min(workers, len(jobs)))
    outcomes: list[Any] = [None] * len(jobs)
    with ThreadPoolExecutor(workers) as pool:
        for first, solved in zip(starts, pool.map(solve, starts), strict=True):
            outcomes[first::workers] = solved
    return outcomes


def _has_one_failed_noise_trial(outcomes: Sequence[Any], least: float) -> bool:
    """Whether all instances were solved, and all but one of the episodes with the least noise."""
    if any(outcome.rollout is None for outcome in outcomes):
        return False
    trials = [trial for outcome in outcomes for trial in Rollout.model_validate(outcome.rollout).trials]
    return sum(trial.noise == HAND_NOISE[0] and trial.score < least for trial in trials) == 1


def instantiate_program_for_seeds(
    simulation: str,
    seeds: Sequence[int],
    services: Services,
    scene: SceneDescription | None,
    seeds_drawn_once: Sequence[int] = (),
) -> tuple[list[TaskInstance], list[tuple[int, str]]]:
    """The instance of each seed as trusted code completes it, and (seed, why) of others, which have none.

    The program has the background and the bystanders of the ``scene`` around it and cannot name them: they are put
    around every instance here, with arm, camera, light, table, mass and friction, and whatever came out of the sandbox
    in their place is overwritten.
    """
    setup, named = program_tool_settings(scene, services), _surroundings_instance_fields(scene, services)
    result = services.run_tool(
        "instantiate", simulation=simulation, seeds=seeds, seeds_drawn_once=seeds_drawn_once, **setup
    )
    failures = [
        (failure.seed, f"seed {failure.seed}: {failure.outcome}: {failure.message}") for failure in result.failures
    ]
    instances: list[TaskInstance] = []
    for drawn in result.instances:
        instance = TaskInstance.model_validate({**drawn, **named})
        try:
            instance = place_bystanders(instance, setup["bystanders"])
            instances.append(fill_in_masses_and_frictions(instance, services.library))
        except ValidationError as error:
            failures.append((instance.seed, f"seed {instance.seed}: invalid: {describe_first_error(error)}"))
        except (GrsError, ValueError) as error:  # an object that the library does not have, or cannot make
            failures.append((instance.seed, f"seed {instance.seed}: invalid: {error}"))
    return instances, failures


def _surroundings_instance_fields(scene: SceneDescription | None, services: Services) -> dict[str, Any]:
    """The fields of an instance that trusted code names: the arm, and what the photo shows around it."""
    return {
        "background": None if scene is None else scene.background,
        "robot": services.robot_name_or_path,
        "camera": None if scene is None else _describe_camera(scene),
        "light": InstanceLight(),
        "table": InstanceTable() if scene is None else scene.instance_table,
    }


def _describe_camera(scene: SceneDescription) -> InstanceCamera | None:
    """The photo's camera in the robot frame; None where the scene does not tell it, or it is out of bounds."""
    if scene.camera is None:
        return None
    pose = np.asarray(scene.frame.T_robot_cam, dtype=np.float64)
    placed = (to_vec3(pose[:3, 3]), matrix_to_quaternion(pose[:3, :3]))
    fields = {**scene.camera.model_dump(), "pose": placed, "robot_placed": scene.frame.origin != "calibrated"}
    try:
        return InstanceCamera.model_validate(fields)
    except ValidationError:
        return None


def _instance_file_name(seed: int, suffix: str) -> str:
    """The name of what is kept of an instance, relative to the run folder."""
    return f"instances/seed_{seed}.{suffix}"


def log_rollouts(rollouts: Sequence[Rollout], services: Services) -> None:
    """One event for each rollout of an audit; its instance lies in the run folder."""
    for rollout in rollouts:
        services.log.append(_make_rollout_event(rollout))


def _make_rollout_event(rollout: Rollout) -> RolloutEvent:
    return RolloutEvent(
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
