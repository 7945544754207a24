"""Probe the tests of an audited program: the suite runs again, and against mutants of the task instance."""

import hashlib
from typing import Any

from grs_agents.audit.mutants import Mutant, make_instance_mutants
from grs_agents.audit.seed_and_override_checks import find_expectations_taken_from_program
from grs_agents.audit.test_quality import (
    RUNS,
    check_tests_exercise_program,
    check_tests_fail_on_mutants,
    check_tests_pass_repeatedly,
    find_runtime_accesses_of_program,
    find_test_integrity_faults,
)
from grs_agents.audit.types import Finding
from grs_agents.graph.bystanders import program_tool_settings
from grs_agents.graph.services import Services
from grs_agents.graph.task_instances import AuditedPrograms, SolvedInstances

Json = dict[str, Any]


def probe_tests(audited: AuditedPrograms, solved: SolvedInstances, services: Services) -> tuple[Finding, ...]:
    """The findings about the tests; none without tests, or where no instance was solved.

    The suite passed once before. It runs four more times on the first audited instance, and on each mutant of it.
    """
    if audited.tests is None or not solved.rollouts:
        return ()
    rollout = solved.rollouts[0]
    instance = next(instance for instance in solved.instances if instance.seed == rollout.seed)
    mutants = make_instance_mutants(instance, rollout, services.library)
    first = instance.model_dump(mode="json")
    seed = services.config.seed
    again: list[Json] = [
        {"name": f"again {number}", "instance": first, "coin": (seed + number) % 2**32, "early": number > 1}
        for number in range(1, RUNS)
    ]
    faulty: list[Json] = [
        {"name": f"mutant {number}", "instance": first, **_describe_mutant(mutant)}
        for number, mutant in enumerate(mutants)
    ]
    repeats, tried = _run_suite_among_mutants(audited, again, faulty, services)
    faults = list(find_test_integrity_faults(audited.tests, ("task_code", audited.name)))
    faults += find_expectations_taken_from_program(audited.tests, audited.simulation, ("task_code", audited.name))
    faults += find_runtime_accesses_of_program(audited.simulation)
    return (
        check_tests_exercise_program(faults, (*repeats, *tried)),
        check_tests_pass_repeatedly(repeats),
        check_tests_fail_on_mutants(mutants, tried),
    )


def _describe_mutant(mutant: Mutant) -> Json:
    return {"undo": True} if mutant.kind == "undone" else {"mutant": mutant.instance.model_dump(mode="json")}


def _run_suite_among_mutants(
    audited: AuditedPrograms, again: list[Json], faulty: list[Json], services: Services
) -> tuple[list[Any], list[Any]]:
    """What comes of further runs somewhere among those of the mutants, and of these.

    One process has all of them, a mutant first, so that a suite which counts its runs, or keeps the first scene that it
    sees, cannot tell them apart by that. Where the further runs stand depends on the two programs.
    """
    order = list(faulty)
    digest = hashlib.sha256(f"{audited.simulation}\0{audited.tests}".encode()).digest()
    for number, run in enumerate(again):
        order.insert(1 + digest[number] % max(1, len(order)), run)
    outcomes = {one.name: one for one in _run_suite_in_new_process(audited, order, services)}
    hung = [run for run in again if outcomes[run["name"]].ended == "not_run"]
    if hung and any(outcomes[mutant["name"]].ended == "stopped" for mutant in faulty):  # in a mutant before them
        outcomes |= {one.name: one for one in _run_suite_in_new_process(audited, hung, services)}
    return [outcomes[run["name"]] for run in again], [outcomes[mutant["name"]] for mutant in faulty]


def _run_suite_in_new_process(audited: AuditedPrograms, runs: list[Json], services: Services) -> list[Any]:
    """The outcome of each run, in a process that ran nothing before."""
    outcomes = services.run_tool(
        "probe_tests",
        simulation=audited.simulation,
        tests=audited.tests,
        simulation_name=audited.name,
        runs=runs,
        **program_tool_settings(audited.scene, services),
    ).outcomes
    return list(outcomes)
