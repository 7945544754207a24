"""What a routing policy sees and what it says."""

from dataclasses import dataclass
from typing import Protocol

from grs_agents.agents import Agents, TaskDefinition, Verdict
from grs_agents.base import Frozen
from grs_agents.sandbox import TestReport


@dataclass(frozen=True)
class RoutingContext:
    """The evidence.

    Attributes:
        task: the task definition.
        report: the latest test report.
        results: the report (and the audit's findings, if it was the audit that failed) as text.
        audit_failed: the tests passed but the audit did not.
        history: one line for each earlier decision.
        agents: the models, for policies that ask one.
    """

    task: TaskDefinition
    report: TestReport
    results: str
    audit_failed: bool
    history: tuple[str, ...]
    agents: Agents


class RoutingDecision(Frozen):
    """A verdict with its reason."""

    verdict: Verdict
    explanation: str
    policy: str


class Policy(Protocol):
    """Anything with a ``decide``."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say what to fix next."""
        ...
