"""Routing policies: who decides whether the program or its tests are at fault.

A policy sees the test report and the audit, and says which of the two to fix.
"""

import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Protocol, cast

from grs_agents.agents import Agents, JudgedPrograms, NoReply, TaskDefinition, Verdict, roles
from grs_agents.base import Frozen
from grs_agents.errors import ConfigError, UnknownNameError
from grs_agents.sandbox import TestCase, TestReport


class Routed(Frozen):
    """An earlier decision: the report that it was made on, and the verdict."""

    failures: tuple[str, ...]  # `failures` of that report
    verdict: Verdict  # which program was to be fixed


@dataclass(frozen=True)
class RoutingContext:
    """The evidence."""

    task: TaskDefinition
    report: TestReport
    results: str  # the report (and the audit's findings, if it was the audit that failed) as text
    audit_failed: bool  # the tests passed but the audit did not
    history: tuple[str, ...]  # one line for each earlier decision and fix
    agents: Agents  # the models, for policies that ask one
    simulation: str = ""
    tests: str = ""
    scene: str = ""  # the objects of the task as JSON
    static: tuple[Any, ...] = ()  # what the checks found that need no run
    images: tuple[str, ...] = ()  # the end of the robot's episode, relative to the run folder
    verdicts: tuple[Verdict, ...] = ("fix_code", "fix_test")  # what is left to try; others are not followed
    earlier: tuple[Routed, ...] = ()  # the earlier decisions, oldest first


class RoutingDecision(Frozen):
    """A verdict with its reason."""

    verdict: Verdict
    explanation: str
    policy: str


def failures_without_run_details(report: TestReport) -> tuple[str, ...]:
    """What went wrong in ``report``, without what differs from run to run: seconds, printed text, tracebacks.

    Two reports with the same failures show that the fix between them changed nothing.
    """
    cases = [
        f"{case.outcome} in {case.raised_in} ({(case.episode or {}).get('outcome')}): {case.message}"
        for case in report.cases
        if case.outcome != "passed"
    ]
    return (f"{report.outcome} in {report.raised_in}: {report.message}", *sorted(cases))


class Policy(Protocol):
    """Anything with a ``decide``."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say what to fix next."""
        ...


class Llm:
    """Ask the router model (paper, Listing 3); where it gives no usable reply, decide by ``Rules`` and say so."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Ask; the model's explanation is passed on to the fixer."""
        judged = JudgedPrograms(
            task=context.task,
            scene=context.scene,
            code=context.simulation,
            tests=context.tests,
            results=context.results,
            history=context.history,
            images=context.images,
        )
        reply = roles.decide_what_to_fix(context.agents, judged, context.verdicts)
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
        verdict, why = _judge_by_rules(context)
        last = context.earlier[-1] if context.earlier and not context.audit_failed else None
        if last is not None and last.failures == failures_without_run_details(context.report):
            verdict = "fix_test" if last.verdict == "fix_code" else "fix_code"
            why = f"{last.verdict} left the report as it was, so the other program is next; {why}"
        return RoutingDecision(verdict=verdict, explanation=why, policy="rules")


def _judge_by_rules(context: RoutingContext) -> tuple[Verdict, str]:
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
    first = next(filter(_is_program_fault, failed), None)
    if first is None:
        return "fix_test", f"{failed[0].id} {failed[0].outcome} in the tests themselves: {failed[0].message}"
    reason = (
        f"the oracle ended in {first.episode['outcome']}"
        if first.episode and _has_oracle_failed(first)
        else first.message
    )
    return "fix_code", f"{first.id} {first.outcome}: {reason}"


def _is_program_fault(case: TestCase) -> bool:
    if case.outcome in ("no_assertion", "skipped", "expected_failure"):
        return False
    return case.raised_in != "tests" or (case.outcome == "failed" and _has_oracle_failed(case))


def _has_oracle_failed(case: TestCase) -> bool:
    """Whether the oracle itself ended its episode without reaching its goals."""
    return case.episode is not None and case.episode.get("outcome") not in ("success", "stopped", None)


class AlwaysCode:
    """Never blame the tests (the paper's ``no router`` ablation as a policy)."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say ``fix_code``."""
        why = "this policy always fixes the program"
        return RoutingDecision(verdict="fix_code", explanation=why, policy="always_code")


POLICIES: dict[str, type[Policy]] = {"llm": Llm, "rules": Rules, "always_code": AlwaysCode}
ENTRY_POINTS = "grs_agents.policies"


def load_policy(name: str) -> Policy:
    """The policy ``name``: built in, ``package.module:Class``, or an entry point in ``grs_agents.policies``.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: it cannot be imported or made, or has no ``decide``.
    """
    if name in POLICIES:
        return POLICIES[name]()
    entries = entry_points(group=ENTRY_POINTS)
    if ":" not in name and name not in entries.names:
        raise UnknownNameError("policy", name, [*POLICIES, *entries.names, "package.module:Class"])
    try:
        policy = (_import_object_by_path(name) if ":" in name else entries[name].load())()
    except Exception as error:  # whatever the user's own code raises
        raise ConfigError(
            f"policy {name!r}: {type(error).__name__}: {error}",
            "give package.module:Class of an importable class that is made without arguments",
        ) from error
    if not callable(getattr(policy, "decide", None)):
        raise ConfigError(f"policy {name!r} has no decide(context)", "see grs_agents.policies.Policy")
    return cast(Policy, policy)


def _import_object_by_path(path: str) -> Any:
    """What ``module:name`` names; the module may lie in the current folder, where Python's own path ends."""
    module, _, attribute = path.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)
    return getattr(import_module(module), attribute)
