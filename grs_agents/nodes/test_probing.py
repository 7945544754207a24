"""Probe the tests of an audited program: the suite runs again, and against mutants of the task instance."""

import hashlib
from typing import Any

from grs_agents.audit import (
    RUNS,
    Finding,
    Mutant,
    check_tests_exercise_program,
    check_tests_fail_on_mutants,
    check_tests_pass_repeatedly,
    find_expectations_taken_from_program,
    find_runtime_accesses_of_program,
    find_test_integrity_faults,
    make_instance_mutants,
)
from grs_agents.nodes.bystanders import program_tool_settings
from grs_agents.nodes.services import Services
from grs_agents.nodes.task_instances import AuditedPrograms, SolvedInstances

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
    repeats = _run_suite_in_new_process(audited, again[:-1], services)
    last, tried = _run_suite_among_mutants(audited, again[-1], faulty, services)
    faults = list(find_test_integrity_faults(audited.tests, ("task_code", audited.name)))
    faults += find_expectations_taken_from_program(audited.tests, audited.simulation, ("task_code", audited.name))
    faults += find_runtime_accesses_of_program(audited.simulation)
    return (
        check_tests_exercise_program(faults, repeats),
        check_tests_pass_repeatedly((*repeats, *last)),
        check_tests_fail_on_mutants(mutants, tried),
    )


def _describe_mutant(mutant: Mutant) -> Json:
    return {"undo": True} if mutant.kind == "undone" else {"mutant": mutant.instance.model_dump(mode="json")}


def _run_suite_among_mutants(
    audited: AuditedPrograms, again: Json, faulty: list[Json], services: Services
) -> tuple[list[Any], list[Any]]:
    """What comes of a further run somewhere among those of the mutants, and of these.

    They run in a process of their own, a mutant first, so that a suite which counts its runs, or keeps the first scene
    that it sees, cannot tell them apart by that. Where the further run stands depends on the two programs.
    """
    if not faulty:
        return _run_suite_in_new_process(audited, [again], services), []
    digest = hashlib.sha256(f"{audited.simulation}\0{audited.tests}".encode()).digest()
    place = 1 + int.from_bytes(digest[:8]) % len(faulty)
    outcomes = _run_suite_in_new_process(audited, [*faulty[:place], again, *faulty[place:]], services)
    last, tried = outcomes[place], [*outcomes[:place], *outcomes[place + 1 :]]
    hung = last.ended == "not_run" and any(one.ended == "stopped" for one in tried)  # in a mutant before it
    return [] if hung else [last], tried


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
