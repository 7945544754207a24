"""The router: which of the two programs the evidence speaks against."""

from grs_agents.models.offline.prompt_text import PromptText
from grs_agents.models.offline.report_evidence import Evidence, parse_report_evidence

_REMEDIES = {
    "step_limit": "allow more steps, or move fewer objects",
    "unreachable": "move the target or the object into reach, or leave the object out",
    "target_too_small": "make the target area larger",
    "target_occupied": "move the target to a free place",
    "no_free_space": "use smaller targets or fewer objects",
    "toppled": "leave the unsteady object out",
    "dropped": "leave out the object that the cup cannot hold",
    "nothing_to_do": "move the target away from where the objects start",
    "partial": "give the objects more room",
    "error": "mend the call that the simulator refuses",
}


def decide_what_to_fix(prompt: PromptText) -> str:
    """Reply to the ``decide_what_to_fix`` prompt: an explanation, then the verdict in a fenced block."""
    verdict, explanation = judge_evidence(
        parse_report_evidence(prompt.section_body("test report")), prompt.section_body("history")
    )
    return f"{explanation}\n\n```\n{verdict}\n```"


def judge_evidence(evidence: Evidence, history: str = "") -> tuple[str, str]:
    """The verdict and why.

    What the tests themselves raise while the oracle solved the task, or never ran, speaks against the tests; all
    else against the program. After three fixes of the tests in a row it is the program's turn.
    """
    recent = [line for line in history.splitlines() if "fix_" in line][-3:]
    if len(recent) == 3 and all("fix_test" in line for line in recent):
        return "fix_code", "Three fixes of the tests in a row did not help, so the program is at fault: simplify it."
    fault = _explain_test_fault(evidence)
    return ("fix_test", f"{fault} Mend the tests.") if fault else ("fix_code", _explain_program_fault(evidence))


def _explain_test_fault(evidence: Evidence) -> str:
    """What speaks against the tests; empty where the oracle fell short or nothing was raised in them."""
    if any(oracle.outcome != "stopped" for oracle in evidence.oracles):
        return ""
    for case in evidence.cases:
        if case.where == "tests":
            return f"{case.id} ended as {case.outcome}: {case.message or 'no message'}. It was raised in the tests."
    if any(case.outcome in ("no_assertion", "skipped", "expected_failure") for case in evidence.cases):
        return "Some tests check nothing."
    if evidence.text.startswith("no_tests"):
        return "There are no tests."
    if evidence.text.startswith("load_tests"):
        return "The tests choose among themselves by a load_tests of their own."
    return f"The test file itself cannot be run: {_last_error_text(evidence)}." if evidence.where == "tests" else ""


def _explain_program_fault(evidence: Evidence) -> str:
    if evidence.oracles:
        first = evidence.oracles[0]
        remedy = _REMEDIES.get(first.outcome, "simplify the task")
        return f"The oracle ended in {first.outcome}: {first.detail}. The easiest fix: {remedy}."
    if evidence.findings:
        findings = "; ".join(f"{check}: {detail}" for check, detail in evidence.findings.items())
        return f"The tests pass but the audit does not ({findings}). The program has to change."
    return f"The program is at fault: {_last_error_text(evidence)}. Mend the program."


def _last_error_text(evidence: Evidence) -> str:
    return ": ".join(evidence.errors[-1]) if evidence.errors else "see the report"
