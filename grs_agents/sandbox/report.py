"""What a test run says: one case for each test of the source, and the text that routers and fixers read."""

import json
from typing import Any, Literal

from grs_agents.base import Frozen
from grs_agents.sandbox.traces import RaisedIn

CaseOutcome = Literal["passed", "failed", "error", "skipped", "timeout", "crashed", "memory", "not_run", "no_assertion"]
ReportOutcome = Literal["passed", "failed", "error", "no_tests", "timeout", "crashed"]


class TestCase(Frozen):
    """One test.

    Attributes:
        id: ``Class.method``.
        outcome: ``no_assertion`` is a test that ran through but asserts nothing; only ``passed`` counts.
        seconds: how long it ran.
        message: one line.
        traceback: without the frames of unittest.
        output: the first 4,000 characters it printed.
        raised_in: which file the failure came from.
        episode: the last oracle episode it ran, opaque JSON here.
    """

    __test__ = False  # pytest: not a test of ours

    id: str
    outcome: CaseOutcome
    seconds: float = 0.0
    message: str = ""
    traceback: str = ""
    output: str = ""
    raised_in: RaisedIn | None = None
    episode: dict[str, Any] | None = None


class TestReport(Frozen):
    """All tests of a file.

    Attributes:
        outcome: ``error`` if a program does not parse or import, ``timeout`` or ``crashed`` if a test (or the
            import) did, ``no_tests`` for an empty suite.
        cases: one for each test of the source, in its order.
        message: why there is no better outcome, where it is not one test's affair.
        traceback: of the import, if that failed.
        raised_in: which file the first failure came from.
        seconds: wall time of all calls.
        cpu_seconds: processor time of all workers, their start included.
        backend: what separated the tests from the host.
    """

    __test__ = False

    outcome: ReportOutcome
    cases: tuple[TestCase, ...] = ()
    message: str = ""
    traceback: str = ""
    raised_in: RaisedIn | None = None
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    backend: str = "process"

    @property
    def ok(self) -> bool:
        """Whether there were tests and every one passed."""
        return self.outcome == "passed"

    def text(self) -> str:
        """The report for a reader that decides what to mend: failures with their last lines, then one line a pass."""
        passed = sum(case.outcome == "passed" for case in self.cases)
        head = f"{self.outcome}: {passed} of {len(self.cases)} tests passed"
        lines = [head + (f"; {self.message}" if self.message else "")]
        if self.raised_in:
            lines.append(f"raised in: {self.raised_in}")
        lines.extend(_tail(self.traceback))
        for case in sorted(self.cases, key=lambda case: case.outcome == "passed"):
            lines.extend(_case_lines(case))
        return "\n".join(lines)


def _case_lines(case: TestCase) -> list[str]:
    where = f" (raised in {case.raised_in})" if case.raised_in else ""
    lines = [f"{case.id}: {case.outcome}{where}" + (f": {case.message}" if case.message else "")]
    if case.outcome != "passed":
        lines.extend(_tail(case.traceback))
        if case.output.strip():
            lines.append("  printed: " + " | ".join(case.output.strip().splitlines()[-5:])[-500:])
    if case.episode is not None:
        lines.append("  oracle: " + _episode_line(case.episode))
    return lines


def _tail(traceback: str) -> list[str]:
    return [f"  {line[:300]}" for line in traceback.splitlines()[-15:]]


def _episode_line(episode: dict[str, Any]) -> str:
    reward = episode.get("reward")
    steps = f"{episode.get('steps')}/{episode.get('max_steps')}"
    return (
        f"outcome={episode.get('outcome')} reward={f'{reward:.2f}' if isinstance(reward, float) else reward} "
        f"steps={steps} detail={episode.get('detail')} objects={json.dumps(episode.get('objects'))}"
    )[:1500]
