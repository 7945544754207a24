"""What a routing policy sees and what it says."""

from dataclasses import dataclass
from typing import Protocol

from grs_agents.agents import Agents, TaskDefinition, Verdict
from grs_agents.base import Frozen
from grs_agents.sandbox import TestCase, TestReport


class Routed(Frozen):
    """An earlier decision: the report that it was made on, and the verdict.

    Attributes:
        failures: ``failures`` of that report.
        verdict: which program was to be fixed.
    """

    failures: tuple[str, ...]
    verdict: Verdict


@dataclass(frozen=True)
class RoutingContext:
    """The evidence.

    Attributes:
        task: the task definition.
        report: the latest test report.
        results: the report (and the audit's findings, if it was the audit that failed) as text.
        audit_failed: the tests passed but the audit did not.
        history: one line for each earlier decision and fix.
        agents: the models, for policies that ask one.
        earlier: the earlier decisions, oldest first.
    """

    task: TaskDefinition
    report: TestReport
    results: str
    audit_failed: bool
    history: tuple[str, ...]
    agents: Agents
    earlier: tuple[Routed, ...] = ()


class RoutingDecision(Frozen):
    """A verdict with its reason."""

    verdict: Verdict
    explanation: str
    policy: str


def failures(report: TestReport) -> tuple[str, ...]:
    """What went wrong in ``report``, without what differs from run to run: seconds, printed text, tracebacks.

    Two reports with the same failures show that the fix between them changed nothing.
    """
    cases = [
        f"{case.outcome} in {case.raised_in} ({_ending(case)}): {case.message}"
        for case in report.cases
        if case.outcome != "passed"
    ]
    return (f"{report.outcome} in {report.raised_in}: {report.message}", *sorted(cases))


def _ending(case: TestCase) -> object:
    return case.episode.get("outcome") if case.episode else None


class Policy(Protocol):
    """Anything with a ``decide``."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say what to fix next."""
        ...
