"""The audit of two programs: trusted code measures them, then every check judges the measurements.

The tests are probed too: the suite runs again, and against mutants of the task instance.
"""

import hashlib
from collections.abc import Sequence
from typing import Any, Final

from grs_agents.audit.checks import audit_task, check_report_of_unforeseen_seeds
from grs_agents.audit.mutants import make_instance_mutants
from grs_agents.audit.seed_and_override_checks import check_program, find_expectations_taken_from_program
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
from grs_agents.graph.words import state_and_judge_words

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
        report = report.with_findings(_probe_tests(audited, measured, services))
    report = report.with_findings([check_program(audited.simulation)])
    if report.accepted:
        seen = [measured] if measured.unforeseen is None else [measured, measured.unforeseen]
        instances = [instance for solved in seen for instance in solved.instances]
        rollouts = [rollout for solved in seen for rollout in solved.rollouts]
        report = state_and_judge_words(report, audited, instances, rollouts, services)
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
    return measured, report.with_findings([finding])


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
