"""The policies that ship with GRS."""

from grs_agents.agents import NoReply, Verdict, roles
from grs_agents.policies.types import RoutingContext, RoutingDecision


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
    """Decide from where the error was raised.

    An error raised in the tests while the oracle had succeeded (or never ran) is the tests' fault; everything else
    (the program raised, the oracle fell short, the audit failed) is the program's.
    """

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Read the report's ``raised_in`` fields and the oracle's episodes."""
        verdict, why = self._judge(context)
        return RoutingDecision(verdict=verdict, explanation=why, policy="rules")

    def _judge(self, context: RoutingContext) -> tuple[Verdict, str]:
        report = context.report
        if context.audit_failed:
            return "fix_code", "the tests pass but the audit of the task instances fails"
        if not report.cases:
            at_fault = report.raised_in == "tests" or report.outcome in ("no_tests", "load_tests")
            where = report.raised_in or report.outcome
            return ("fix_test" if at_fault else "fix_code"), f"no test ran: {report.message} (raised in {where})"
        for case in report.cases:
            if case.outcome in ("passed", "not_run"):
                continue
            short = case.episode is not None and case.episode.get("outcome") not in ("success", None)
            if case.raised_in == "tests" and not short:
                return "fix_test", f"{case.id} {case.outcome} in the tests themselves: {case.message}"
            if case.outcome in ("no_assertion", "skipped", "expected_failure"):
                return "fix_test", f"{case.id} checks nothing ({case.outcome})"
            reason = f"the oracle ended in {case.episode['outcome']}" if case.episode and short else case.message
            return "fix_code", f"{case.id} {case.outcome}: {reason}"
        return "fix_test", f"the tests as a whole are {report.outcome}: {report.message}"


class AlwaysCode:
    """Never blame the tests (the paper's ``no router`` ablation as a policy)."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say ``fix_code``."""
        why = "this policy always fixes the program"
        return RoutingDecision(verdict="fix_code", explanation=why, policy="always_code")
