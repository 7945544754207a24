"""The results of a call, and the report of a test run, one case for each test, which routers and fixers read."""

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
"""What outcomes mean that a name alone does not explain."""


class TestCase(Frozen):
    """One test."""

    __test__ = False  # pytest: not a test of ours

    id: str  # `Class.method`
    outcome: CaseOutcome  # only `passed` counts; what others mean is in `OUTCOME_MEANINGS`
    seconds: float = 0.0  # how long it ran
    message: str = ""  # one line
    traceback: str = ""  # without the frames of unittest
    output: str = ""  # the first 4,000 characters it printed
    raised_in: RaisedIn | None = None  # which file the failure came from
    assertions: Annotated[int, Field(ge=0)] = 0  # how many it came to
    # the last oracle episode it ran, or its class's or module's fixture if it ran none itself; opaque JSON here
    episode: dict[str, Any] | None = None
    episode_hook: Literal["test", "setUpClass", "setUpModule", ""] = ""  # which of them ran it


class TestReport(Frozen):
    """All tests of a file."""

    __test__ = False

    # `error` if a program does not parse or import, `timeout`, `crashed` or `exited` if a test (or the import) did,
    # `no_tests` for an empty suite, `load_tests` for one that chooses by itself, `tampered` and `forged` if the
    # verdicts cannot be trusted
    outcome: ReportOutcome
    # one for each test of the source, in its order; then those that are not in it (`extra`)
    cases: tuple[TestCase, ...] = ()
    message: str = ""  # why there is no better outcome, where it is not one test's affair
    traceback: str = ""  # of the import, if that failed
    raised_in: RaisedIn | None = None  # which file the first failure came from
    seconds: float = 0.0  # wall time of all calls
    cpu_seconds: float = 0.0  # processor time of all workers, their start included
    backend: str = "process"  # what separated the tests from the host

    @property
    def all_passed(self) -> bool:
        """Whether there were tests and every one passed."""
        return self.outcome == "passed"


_Limit = Literal["timeout", "cpu_limit", "memory_limit", "output_limit", "scratch_limit", "thread_limit"]
CallOutcome = Literal["ok", _Limit, "crashed", "forged", "error"]
"""``error`` is an exception that left the tool, or a result that is not plain JSON; ``forged`` is a frame that does not
come from the harness."""

EXITED = "the process ended itself"
"""How the error of a ``crashed`` call begins whose process was not killed but exited without an answer."""


class CallResult(Frozen):
    """How one call ended."""

    outcome: CallOutcome  # `ok`, or what stopped it
    value: dict[str, Any] | None = None  # what the tool returned; None unless the outcome is `ok`
    error: str = ""  # why there is no value, with the traceback if there is one
    output: str = ""  # the last 64 KiB written to standard output and standard error since the last event
    stack: str = ""  # where the code was when it crashed or ran out of time, as `faulthandler` writes it
    events: tuple[dict[str, Any], ...] = ()  # what the tool reported while it ran, in order
    seconds: float = 0.0  # wall time of the call
    cpu_seconds: float = 0.0  # processor time of the worker
    backend: str = "none"  # what separated the worker from the host
    retried: bool = False  # the process that forks the workers was killed during a first try


__all__ = ["EXITED", "CallOutcome", "CallResult", "Limits"]
