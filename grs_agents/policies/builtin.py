"""The policies that ship with GRS."""

from grs_agents.agents import NoReply, Verdict, roles
from grs_agents.policies.types import RoutingContext, RoutingDecision, failures
from grs_agents.sandbox import TestCase


class Llm:
    """Ask the router model (paper, Listing 3); where it gives no usable reply, decide by ``Rules`` and say so."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Ask; the model's explanation is passed on to the fixer."""
        reply = roles.route(context.agents, context.task, context.results, context.history)
        if isinstance(reply, NoReply):
            fallback = Rules().decide(context)
            explanation = f"{reply}; decided by rules instead: {fallback.explanation}"
            return RoutingDecision(verdict=fallback.verdict, explanation=explanation, policy="llm (rules)")
        return RoutingDecision(verdict=reply.verdict, explanation=reply.explanation, policy="llm")


class Rules:
    """Decide from the types in the report: who raised the error, and how the oracle's episode ended.

    The program is at fault where it raised the error, or where an assertion failed and the oracle itself fell short.
    The tests are at fault where they raised an error that is no failed assertion, or where an assertion failed though
    the oracle reached its goals or was stopped by the test. A verdict that was followed already and left the report as
    it was gives way to the other one.
    """

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Read the types; compare with the report of the decision before."""
        verdict, why = _judge(context)
        last = context.earlier[-1] if context.earlier and not context.audit_failed else None
        if last is not None and last.failures == failures(context.report):
            verdict = "fix_test" if last.verdict == "fix_code" else "fix_code"
            why = f"{last.verdict} left the report as it was, so the other program is next; {why}"
        return RoutingDecision(verdict=verdict, explanation=why, policy="rules")


def _judge(context: RoutingContext) -> tuple[Verdict, str]:
    report = context.report
    if context.audit_failed:
        return "fix_code", "the tests pass but the audit of the task instances fails"
    if not report.cases:
        at_fault = report.raised_in == "tests" or report.outcome in ("no_tests", "load_tests")
        where = report.raised_in or report.outcome
        return ("fix_test" if at_fault else "fix_code"), f"no test ran: {report.message} (raised in {where})"
    failed = [case for case in report.cases if case.outcome not in ("passed", "not_run")]
    if not failed:
        return "fix_test", f"the tests as a whole are {report.outcome}: {report.message}"
    first = next(filter(_speaks_against_program, failed), None)
    if first is None:
        return "fix_test", f"{failed[0].id} {failed[0].outcome} in the tests themselves: {failed[0].message}"
    reason = (
        f"the oracle ended in {first.episode['outcome']}" if first.episode and _fell_short(first) else first.message
    )
    return "fix_code", f"{first.id} {first.outcome}: {reason}"


def _speaks_against_program(case: TestCase) -> bool:
    if case.outcome in ("no_assertion", "skipped", "expected_failure"):
        return False
    return case.raised_in != "tests" or (case.outcome == "failed" and _fell_short(case))


def _fell_short(case: TestCase) -> bool:
    """Whether the oracle itself ended its episode without reaching its goals."""
    return case.episode is not None and case.episode.get("outcome") not in ("success", "stopped", None)


class AlwaysCode:
    """Never blame the tests (the paper's ``no router`` ablation as a policy)."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say ``fix_code``."""
        why = "this policy always fixes the program"
        return RoutingDecision(verdict="fix_code", explanation=why, policy="always_code")
