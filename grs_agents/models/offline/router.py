"""The router: decides which of the two programs is at fault."""

import re
from dataclasses import replace

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.prompt_text import PromptText, parse_scene_objects
from grs_agents.models.offline.report_evidence import Evidence, FailedTestCase, parse_report_evidence
from grs_agents.models.offline.task_reading import UnplannableTaskError, parse_clauses

_NO_CHECK = frozenset({"no_assertion", "skipped", "expected_failure"})


def decide_what_to_fix(prompt: PromptText) -> str:
    """Reply to the ``route`` prompt: an explanation, then the verdict in a fenced block."""
    evidence = _blame_program_for_missing_attributes(parse_report_evidence(prompt.section_body("test report")), prompt)
    task, used = prompt.section_json("task"), program_edits.find_asset_names(prompt.section_body("program"))
    assets = {str(asset) for asset in task.get("assets-used", [])}
    objects = [obj for obj in parse_scene_objects(prompt.section_json("scene")) if obj.asset in assets]
    try:
        wanted = {obj.asset for clause in parse_clauses(task, objects) for obj in clause.moved}
    except UnplannableTaskError:
        wanted = set[str]()
    moved = {asset for oracle in evidence.oracles for asset in oracle.moved}
    solved = any(oracle.has_solved_task for oracle in evidence.oracles)
    neglected = (assets - used) | (wanted - moved if solved else set[str]())
    verdict, explanation = decide_verdict_from_evidence(evidence, tuple(sorted(neglected)))
    allowed = re.findall(r"\bfix_\w+", prompt.section_body("verdicts")) or [verdict]
    if verdict not in allowed:
        verdict, explanation = allowed[0], f"{explanation} As {verdict} was tried in vain, the other program is next."
    return f"{explanation}\n\n```\n{verdict}\n```"


def decide_verdict_from_evidence(evidence: Evidence, neglected: tuple[str, ...] = ()) -> tuple[str, str]:
    """Decide the verdict from the evidence.

    Against the tests speak their own faults, and failures although the oracle solved a program that does as the task
    says. All else speaks against the program.

    Args:
        evidence: the parsed report.
        neglected: the assets that the task's words move and the program does not.

    Returns:
        Verdict and reason.
    """
    if (decided := _decide_by_static_checks(evidence)) is not None:
        return decided
    case = next((case for case in evidence.cases if case.where or case.outcome in _NO_CHECK), None)
    if case is not None:
        verdict = "fix_test" if case.where in ("tests", "") else "fix_code"
        return verdict, f"{case.id} ended as {case.outcome}: {case.message or 'it checks nothing'}."
    return _decide_by_episode(evidence, neglected)


def _decide_by_static_checks(evidence: Evidence) -> tuple[str, str] | None:
    against = dict(reversed(evidence.static))
    for program, verdict in (("simulation", "fix_code"), ("tests", "fix_test")):
        if program in against:
            return verdict, f"A check of the {program} that needs no run finds: {against[program]}."
        if evidence.where == program:
            error = ": ".join(evidence.errors[-1]) if evidence.errors else "see the report"
            return verdict, f"No test ran, the fault lies in the {program}: {error}."
    return None


def _decide_by_episode(evidence: Evidence, neglected: tuple[str, ...]) -> tuple[str, str]:
    if evidence.findings and all(check.startswith("tests_") for check in evidence.findings):
        about = "; ".join(f"{check}: {detail}" for check, detail in evidence.findings.items())
        return "fix_test", f"The audit finds fault with the tests alone: {about}."
    if neglected:
        return "fix_code", f"The task's words move {', '.join(neglected)}, which the robot did not: the goals lack it."
    if evidence.shortfalls:
        oracle = evidence.shortfalls[0]
        return "fix_code", f"The oracle ended in {oracle.outcome}, strict score {oracle.strict:.2f}: {oracle.detail}."
    if evidence.cases:
        case = evidence.cases[0]
        return (
            "fix_test",
            f"The oracle solved what the task asks for; {case.id} expects something else: {case.message}.",
        )
    if re.search(r"^(?:no_tests|load_tests): ", evidence.text, re.MULTILINE):
        return "fix_test", "There are no tests that count."
    findings = "; ".join(f"{check}: {detail}" for check, detail in evidence.findings.items())
    return "fix_code", f"The audit fails: {findings or 'see the report'}."


def _blame_program_for_missing_attributes(evidence: Evidence, prompt: PromptText) -> Evidence:
    """Blame the program for errors of the tests if its class lacks an attribute that the tests do not name.

    This is the case if ``__init__`` does not call the base: the first use of the object is in the tests, or below them.
    """
    title, tests = program_edits.find_task_class_name(prompt.section_body("program")), prompt.section_body("tests")
    cases: list[FailedTestCase] = []
    for case in evidence.cases:
        lacking = re.search(rf"'{title}' object has no attribute '(\w+)'", case.message)
        blamed = lacking is not None and lacking[1] not in tests
        cases.append(replace(case, where="simulation") if blamed else case)
    return replace(evidence, cases=tuple(cases))
