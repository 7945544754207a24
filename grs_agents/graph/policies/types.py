"""The context of a routing policy, and its decision."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from pydantic import ValidationError

from grs_agents.agents.agent import Agents
from grs_agents.agents.types import TaskDefinition, Verdict
from grs_agents.audit.types import AuditFinding, AuditReport, StaticFinding
from grs_agents.base import Frozen
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim.instance.episode import Episode

Cause = Literal["tests_error", "wrong_expectation", "wrong_program", "wrong_task", "cannot_tell"]
"""Cause of a failure: the tests are in error; they expect more than the task says; the program does not do the task,
since it raises, falls short or succeeds at another task; the arm cannot do the task, or its words are unclear; or the
evidence leaves it open."""


class EarlierDecision(Frozen):
    """An earlier decision with the failures that it was made on."""

    failures: tuple[str, ...]  # `list_stable_failures` of that report
    verdict: Verdict  # which program was to be fixed


@dataclass(frozen=True)
class RoutingContext:
    """The evidence."""

    task: TaskDefinition
    report: TestReport
    results: str  # report, static findings and audit as text
    audit_failed: bool  # the tests passed but the audit did not
    history: tuple[str, ...]  # a line for each earlier decision and fix
    agents: Agents  # the models, for policies that ask a model
    simulation: str = ""  # source of the simulation program
    tests: str = ""  # source of its tests
    scene: str = ""  # the objects of the task as JSON
    static: tuple[StaticFinding, ...] = ()  # faults that show without a run
    images: tuple[str, ...] = ()  # the end of the robot's episode, relative to the run folder
    verdicts: tuple[Verdict, ...] = ("fix_code", "fix_test")  # left to try; no other is followed
    earlier: tuple[EarlierDecision, ...] = ()  # the earlier decisions, oldest first
    audit: AuditReport | None = None  # the failed audit


class RoutingDecision(Frozen):
    """A verdict with its reason."""

    verdict: Verdict
    explanation: str
    policy: str
    cause: Cause = "cannot_tell"
    sure: bool = False  # whether the policy would stand by it against another opinion


class Policy(Protocol):
    """Anything with a ``decide``."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Decide which of the programs, or the task, to fix next."""
        ...


def are_words_unclear(finding: AuditFinding) -> bool:
    """True for a finding that the words could not be judged, which no program changes."""
    return finding.check == "words" and not finding.passed and not finding.measured.startswith("differ,")


def list_stable_failures(report: TestReport) -> tuple[str, ...]:
    """The failures in ``report`` without the parts that vary between runs: seconds, printed text, tracebacks.

    Two reports with the same failures show that the fix between them changed nothing.
    """
    cases = [
        f"{case.outcome} in {case.raised_in} ({(case.episode or {}).get('outcome')}): {case.message}"
        for case in report.cases
        if case.outcome != "passed"
    ]
    return (f"{report.outcome} in {report.raised_in}: {report.message}", *sorted(cases))


def read_episode(recorded: Mapping[str, object] | None) -> Episode | None:
    """The episode that a test reported; None if it is not valid, as generated code may report anything."""
    try:
        return None if recorded is None else Episode.model_validate(recorded)
    except ValidationError:
        return None
