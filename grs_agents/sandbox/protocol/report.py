"""The results of a call, and the report of a test run, a case for each test, for routers and fixers."""

from typing import Annotated, Any, Literal

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.protocol.tracebacks import RaisedIn

_Judged = Literal["passed", "failed", "error", "skipped", "expected_failure", "no_assertion", "not_run", "missing"]
_Stopped = Literal["timeout", "crashed", "exited", "memory", "output_limit", "scratch_limit", "thread_limit", "limit"]
_Dishonest = Literal["extra", "duplicate", "replaced", "tampered", "forged"]
CaseOutcome = Literal[_Judged, _Stopped, _Dishonest]
ReportOutcome = Literal[
    "passed", "failed", "error", "no_tests", "load_tests", "timeout", "crashed", "exited", "tampered", "forged"
]
OUTCOME_MEANINGS: dict[str, str] = {
    "skipped": "a skipped test shows nothing; it has to run",
    "expected_failure": "a test marked expectedFailure shows nothing; it has to pass without the mark",
    "no_assertion": "a test counts only if it comes to at least one assertion",
    "exited": "the process was ended from within (os._exit, sys.exit); a program returns, it does not exit",
    "output_limit": "more was printed than the limit of a call allows",
    "scratch_limit": "more was written to files than the limit of a call allows",
    "thread_limit": "more threads were started than the limit of a call allows",
    "limit": "the simulation was asked for more than a call allows, though the error may have been caught",
    "not_run": "an earlier test used up the limit, or ended the run",
    "missing": "the test is in the source, but it was not there, or did not run, once its module was loaded",
    "extra": "a test that is no method in the source of the test program was not run",
    "duplicate": "two tests have this id, or its result was reported twice; each test has a name of its own",
    "replaced": "what was there under the name of the test is not the code in the source",
    "load_tests": "every test of the file runs, so load_tests, which would choose among them, has to go",
    "tampered": "the machinery that gives verdicts (unittest, numpy.testing, builtins) was changed; leave it as it is",
    "forged": "something other than the harness reported results, so none of them counts",
}
"""Explanations of outcomes whose name is not enough."""


class TestCase(Frozen):
    """Result of a test."""

    __test__ = False  # pytest: not a test of ours

    id: str  # `Class.method`
    outcome: CaseOutcome  # only `passed` counts; `OUTCOME_MEANINGS` explains the others
    seconds: float = 0.0  # wall time
    message: str = ""  # a single line
    traceback: str = ""  # without the frames of unittest
    output: str = ""  # the first 4,000 characters it printed
    raised_in: RaisedIn | None = None  # file of the failure
    assertions: Annotated[int, Field(ge=0)] = 0  # number of assertions executed
    # the last oracle episode it ran, or its class's or module's fixture if it ran none itself; opaque JSON here
    episode: dict[str, Any] | None = None
    episode_hook: Literal["test", "setUpClass", "setUpModule", ""] = ""  # the hook that ran the episode


class TestReport(Frozen):
    """All tests of a file."""

    __test__ = False

    # `error` if a program does not parse or import, `timeout`, `crashed` or `exited` if a test (or the import) did,
    # `no_tests` for an empty suite, `load_tests` for a suite with its own `load_tests`, `tampered` and `forged` if the
    # verdicts cannot be trusted
    outcome: ReportOutcome
    # a case for each test of the source, in its order; then tests that are not in it (`extra`)
    cases: tuple[TestCase, ...] = ()
    message: str = ""  # reason of the outcome, unless a single test is the cause
    traceback: str = ""  # of the import, if that failed
    raised_in: RaisedIn | None = None  # file of the first failure
    seconds: float = 0.0  # wall time of all calls
    cpu_seconds: float = 0.0  # processor time of all workers, their start included
    backend: str = "process"  # separation of the tests from the host

    @property
    def all_passed(self) -> bool:
        """True if there were tests and every test passed."""
        return self.outcome == "passed"


_Limit = Literal["timeout", "cpu_limit", "memory_limit", "output_limit", "scratch_limit", "thread_limit"]
CallOutcome = Literal["ok", _Limit, "crashed", "forged", "error"]
"""``error`` is an exception that left the tool, or a result that is not plain JSON; ``forged`` is a frame that does not
come from the harness."""

EXITED = "the process ended itself"
"""Beginning of the error of a ``crashed`` call whose process was not killed but exited without an answer."""


class CallResult(Frozen):
    """The end of a call."""

    outcome: CallOutcome  # `ok`, or the limit or failure that stopped it
    value: dict[str, Any] | None = None  # result of the tool; None unless the outcome is `ok`
    error: str = ""  # reason of a missing value, with the traceback if there is one
    output: str = ""  # the last 64 KiB written to standard output and standard error since the last event
    stack: str = ""  # stack at a crash or timeout, as `faulthandler` writes it
    events: tuple[dict[str, Any], ...] = ()  # events that the tool reported, in order
    seconds: float = 0.0  # wall time of the call
    cpu_seconds: float = 0.0  # processor time of the worker
    backend: str = "none"  # separation of the worker from the host
    retried: bool = False  # the process that forks the workers was killed during a first try


__all__ = ["EXITED", "CallOutcome", "CallResult", "Limits"]
