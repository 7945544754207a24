"""The audit of two programs: trusted code measures them, then every check judges the measurements.

The tests are probed too: the suite runs again, and against mutants of the task instance.
"""

import hashlib
from collections.abc import Sequence
from typing import Any, Final

from grs_agents.agents import roles
from grs_agents.agents.types import NoReply, WordsJudgement
from grs_agents.audit.checks import audit_task, check_report_of_unforeseen_seeds
from grs_agents.audit.goal_checks import pair_instances_with_rollouts
from grs_agents.audit.goal_sentences import describe_task_in_words
from grs_agents.audit.mutants import make_instance_mutants
from grs_agents.audit.seed_and_override_checks import check_program, find_expectations_taken_from_program
from grs_agents.audit.side_words import explain_ambiguous_sides
from grs_agents.audit.test_quality import (
    RUNS,
    check_tests_exercise_program,
    check_tests_fail_on_mutants,
    check_tests_pass_repeatedly,
    find_runtime_accesses_of_program,
    find_test_integrity_faults,
)
from grs_agents.audit.types import AuditFinding, AuditReport
from grs_agents.base.config.schema import AuditConfig
from grs_agents.base.trace.events import Note
from grs_agents.graph.bystanders import program_tool_settings
from grs_agents.graph.services import Services
from grs_agents.graph.task_instances import AuditedPrograms, SolvedInstances, solve_task_instances
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import Rollout

_WORDS_BOUND = "the judge must agree"
_WORDS_REMEDY = (
    f"{_WORDS_BOUND}; where it does not understand the words, name a model that does with audit.judge = MODEL"
)
_SIDES_BOUND = "sides are the robot's, and words must say so where a photo shows others: 'left, as the robot sees it'"
_UNFORESEEN: Final = 8
"""Seeds drawn beside those of the configuration, at 3 ms or more each: they reveal a fault of 1 in 12 seeds every
second time, of 1 in 3 seeds 24 times of 25."""
_LEFT_OUT = "What the photo shows and the task does not use was left out (scene.bystanders = false)."

Json = dict[str, Any]


def audit_programs(audited: AuditedPrograms, services: Services) -> AuditReport:
    """Instantiate the program for each seed, let the trusted oracle solve the instances, and judge.

    Unforeseen seeds follow from the text of both programs, so that neither can name them, and that a repeated audit
    or a resumed run has the same result.

    The tests are probed only if all checks before hold, since their mutants are made from solved instances; the words
    are judged last, since that may cost a model's reply.
    """
    config = services.config
    known = {config.seed + step for step in range(config.audit.seeds)}
    text, unforeseen = f"{audited.simulation}\0{audited.tests}", list[int]()
    while len(unforeseen) < _UNFORESEEN:
        seed = int.from_bytes(hashlib.sha256(text.encode()).digest()[:4])
        if seed not in known:
            known.add(seed)
            unforeseen.append(seed)
        text += "\0"
    measured, report = audit_instances(audited, services, unforeseen)
    if report.accepted:
        report = _append_findings(report, _probe_tests(audited, measured, services))
    report = _append_findings(report, [check_program(audited.simulation)])
    if report.accepted:
        seen = [measured] if measured.unforeseen is None else [measured, measured.unforeseen]
        instances = [instance for solved in seen for instance in solved.instances]
        rollouts = [rollout for solved in seen for rollout in solved.rollouts]
        report = _append_findings(report, _judge_words_against_goals(audited, instances, rollouts, services))
    if audited.scene is None or config.scene.bystanders:
        return report
    services.log.append(Note(text=_LEFT_OUT))
    return report.model_copy(update={"about": f"{report.about} {_LEFT_OUT}"})


def audit_instances(
    audited: AuditedPrograms, services: Services, unforeseen_seeds: Sequence[int] = ()
) -> tuple[SolvedInstances, AuditReport]:
    """Measure a program's task instances with trusted code, and judge by these measurements alone."""
    measured = solve_task_instances(audited.simulation, services, audited.scene, unforeseen_seeds)
    report = _audit_measured_instances(measured, services.config.audit, audited, services)
    if measured.unforeseen is None:
        return measured, report
    seeds = tuple(instance.seed for instance in measured.unforeseen.instances) or tuple(unforeseen_seeds[:1])
    config = services.config.audit.model_copy(update={"seeds": len(seeds)})
    of_unforeseen = _audit_measured_instances(measured.unforeseen, config, audited, services)
    report = report.model_copy(update={"unforeseen_seeds": seeds})
    finding = check_report_of_unforeseen_seeds(seeds, len(unforeseen_seeds), of_unforeseen)
    return measured, _append_findings(report, [finding])


def _audit_measured_instances(
    measured: SolvedInstances, config: AuditConfig, audited: AuditedPrograms, services: Services
) -> AuditReport:
    return audit_task(
        measured.instances,
        measured.failures,
        measured.rollouts,
        config,
        services.library,
        audited.task,
        audited.scene,
        audited.original,
    )


def _append_findings(report: AuditReport, further: Sequence[AuditFinding]) -> AuditReport:
    accepted = report.accepted and all(finding.passed for finding in further)
    return report.model_copy(update={"findings": (*report.findings, *further), "accepted": accepted})


def _judge_words_against_goals(
    audited: AuditedPrograms, instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], services: Services
) -> tuple[AuditFinding, ...]:
    """The finding ``words``: the goals of every kind of instance agree with the words; none without a task.

    The judge is asked once for instances that differ only in lengths and turns.
    """
    if audited.task is None:
        return ()
    frame = audited.scene.frame if audited.scene is not None else None
    if ambiguous := explain_ambiguous_sides(audited.task.description, frame):
        return (AuditFinding(check="words", passed=False, measured=f"unclear: {ambiguous}", bound=_SIDES_BOUND),)
    judge = services.config.model_for_role("judge").model
    distinct: list[TaskInstance] = []  # without their seeds
    kinds: set[tuple[object, ...]] = set()
    judgement: WordsJudgement | NoReply | None = None
    for instance, rollout in pair_instances_with_rollouts(instances, [done for done in rollouts if done.final]):
        unseeded = instance.model_copy(update={"seed": 0})
        if unseeded in distinct:
            continue
        distinct.append(unseeded)
        facts = describe_task_in_words(instance, rollout, services.library, audited.scene)
        if facts.kind in kinds:
            continue
        kinds.add(facts.kind)
        pictures: list[str] = []
        if services.config.end_picture and services.agents.sees_pictures("judge"):
            for moment, poses in (("start", rollout.initial), ("end", rollout.final)):
                path = f"instances/seed_{instance.seed}_{moment}.png"
                drawn = services.render_instance(instance, services.folder / path, poses=poses, textured=True)
                if drawn.image is None:
                    pictures = []
                    break
                pictures.append(path)
        words, other_texts = audited.task.description, (f"name: {audited.task.name}", *facts.other_texts)
        judgement = roles.judge_words(services.agents, words, other_texts, facts.objects, facts.goals, pictures)
        if isinstance(judgement, NoReply) or judgement.verdict != "agrees":
            break
    passed, measured, bound = False, "there is no episode to judge", _WORDS_BOUND
    if isinstance(judgement, NoReply):
        measured, bound = str(judgement), _WORDS_REMEDY
    elif judgement is not None:
        measured = f"{judgement.verdict}, says the judge ({judge}): {judgement.reason}"
        passed, bound = judgement.verdict == "agrees", _WORDS_REMEDY if judgement.verdict == "unclear" else _WORDS_BOUND
    return (AuditFinding(check="words", passed=passed, measured=measured, bound=bound),)


def _probe_tests(audited: AuditedPrograms, solved: SolvedInstances, services: Services) -> tuple[AuditFinding, ...]:
    """The findings about the tests; none without tests, or if no instance was solved.

    The suite passed once before. It runs four more times on the first audited instance, and on each mutant of it. A
    single process has all of these runs, a mutant first, so that a suite which counts its runs, or keeps the first
    scene that it sees, cannot tell the repeats from the mutants. The places of the repeats depend on the two programs.
    """
    if audited.tests is None or not solved.rollouts:
        return ()
    rollout = solved.rollouts[0]
    instance = next(instance for instance in solved.instances if instance.seed == rollout.seed)
    mutants = make_instance_mutants(instance, rollout, services.library)
    first, seed = instance.model_dump(mode="json"), services.config.seed
    repeats: list[Json] = [
        {"name": f"again {number}", "instance": first, "coin": (seed + number) % 2**32, "early": number > 1}
        for number in range(1, RUNS)
    ]
    faulty: list[Json] = []
    for number, mutant in enumerate(mutants):
        fault = {"undo": True} if mutant.kind == "undone" else {"mutant": mutant.instance.model_dump(mode="json")}
        faulty.append({"name": f"mutant {number}", "instance": first, **fault})
    order = list(faulty)
    digest = hashlib.sha256(f"{audited.simulation}\0{audited.tests}".encode()).digest()
    for number, run in enumerate(repeats):
        order.insert(1 + digest[number] % max(1, len(order)), run)
    outcomes = _run_suite_in_new_process(audited, order, services)
    not_run = [run for run in repeats if outcomes[run["name"]].ended == "not_run"]
    if not_run and any(outcomes[run["name"]].ended == "stopped" for run in faulty):  # by a mutant before them
        outcomes |= _run_suite_in_new_process(audited, not_run, services)
    repeated, tried = ([outcomes[run["name"]] for run in runs] for runs in (repeats, faulty))
    faults = list(find_test_integrity_faults(audited.tests, ("task_code", audited.name)))
    faults += find_expectations_taken_from_program(audited.tests, audited.simulation, ("task_code", audited.name))
    faults += find_runtime_accesses_of_program(audited.simulation)
    return (
        check_tests_exercise_program(faults, (*repeated, *tried)),
        check_tests_pass_repeatedly(repeated),
        check_tests_fail_on_mutants(mutants, tried),
    )


def _run_suite_in_new_process(audited: AuditedPrograms, runs: list[Json], services: Services) -> dict[str, Any]:
    """The outcome of each run by its name, in a process that ran nothing before."""
    result = services.run_tool(
        "probe_tests",
        simulation=audited.simulation,
        tests=audited.tests,
        simulation_name=audited.name,
        runs=runs,
        **program_tool_settings(audited.scene, services),
    )
    return {outcome.name: outcome for outcome in result.outcomes}
