"""The host's side of a test run: which tests there must be, what became of each, and the verdict."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from grs_agents.base import Frozen
from grs_agents.sandbox.call import CallResult, Limits
from grs_agents.sandbox.discovery import ExpectedTests, expected_tests, parse
from grs_agents.sandbox.each import EachResult, call_each
from grs_agents.sandbox.host import Sandbox
from grs_agents.sandbox.report import CaseOutcome, ReportOutcome, TestCase, TestReport
from grs_agents.sandbox.traces import SIMULATION_FILE, TESTS_FILE, RaisedIn, describe, from_stack

_STOPPED: dict[str, CaseOutcome] = {"timeout": "timeout", "cpu_limit": "timeout", "memory_limit": "memory"}
_BOUNDS = {"message": 1000, "traceback": 8000, "output": 4000}


class TestRun(Frozen):
    """Two programs and how to run the one against the other.

    Attributes:
        simulation: source of the program under test, imported as ``task_code``.
        tests: source of its ``unittest`` cases.
        simulation_name: another name under which the tests may import the program.
        seed: seeds ``random`` and ``numpy.random`` before each test.
        clear: ``module:function`` called before each test, or None.
        episode: ``module:function`` called after each test; a JSON object it returns is kept with the case.
        extra: plain JSON for the tool's own ``inside``.
    """

    __test__ = False

    simulation: str
    tests: str
    simulation_name: str = "task_code"
    seed: int = Field(default=0, ge=0, lt=2**32)
    clear: str | None = None
    episode: str | None = None
    extra: dict[str, Any] = Field(default_factory=dict[str, Any])


def run_tests(
    sandbox: Sandbox, tool: str, programs: TestRun, limits: Limits, readable: Sequence[Path] = ()
) -> TestReport:
    """Run the tests in workers; whatever they do is a report.

    Args:
        tool: the tool file whose ``inside`` calls ``run_tests_inside``.
        readable: files and folders that the tests read.

    Raises:
        SandboxError: no worker can be started.
    """
    try:
        parse(programs.simulation, SIMULATION_FILE)
        expected = expected_tests(parse(programs.tests, TESTS_FILE))
    except SyntaxError as error:
        trace = describe(error)
        where: RaisedIn = "tests" if TESTS_FILE in (error.filename or trace.message) else "simulation"
        return TestReport(outcome="error", message=trace.message, traceback=trace.text, raised_in=where)
    if not expected.ids:
        return TestReport(
            outcome="no_tests",
            message="no class that derives from unittest.TestCase has a test method",
            raised_in="tests",
        )
    sources = {SIMULATION_FILE: programs.simulation, TESTS_FILE: programs.tests}

    def hopeless(call: CallResult) -> bool:
        trace = from_stack(call.stack, sources, call.error)
        return trace is None or bool({"setUp", "setUpClass", "reset"} & set(trace.functions))

    each = call_each(sandbox, tool, programs.model_dump(), expected.ids, limits, hopeless, readable)
    return _assemble(expected, each, sources)


def _assemble(expected: ExpectedTests, each: EachResult, sources: dict[str, str]) -> TestReport:
    cases = tuple(_case(item, expected, each, sources) for item in expected.ids)
    report = _load_failure(each, sources) or _judge(cases, each)
    totals = {
        "seconds": sum(call.seconds for call in each.calls),
        "cpu_seconds": sum(call.cpu_seconds for call in each.calls),
        "backend": each.last.backend,
    }
    return report.model_copy(update=totals)


def _judge(cases: tuple[TestCase, ...], each: EachResult) -> TestReport:
    if each.unexpected:
        message = f"the tests reported what nobody asked for: {', '.join(each.unexpected[:5])}"
        return TestReport(outcome="error", cases=cases, message=message, raised_in="tests")
    first = next((case for case in cases if case.outcome != "passed"), None)
    if first is not None:
        return TestReport(outcome=_verdict(cases), cases=cases, raised_in=first.raised_in)
    if each.last.outcome != "ok":
        message = f"after the last test: {_last_line(each.last.error)}"
        return TestReport(outcome="crashed", cases=cases, message=message, raised_in="tests")
    return TestReport(outcome="passed", cases=cases)


def _verdict(cases: Sequence[TestCase]) -> ReportOutcome:
    outcomes = {case.outcome for case in cases}
    if "timeout" in outcomes:
        return "timeout"
    return "crashed" if outcomes & {"crashed", "memory"} else "failed"


def _load_failure(each: EachResult, sources: dict[str, str]) -> TestReport | None:
    """The report of programs that never got to a test, or None."""
    call = each.last
    if call.outcome == "ok":
        match call.value:
            case {"load_error": None}:
                return None
            case {"load_error": {"message": str(message), "traceback": str(trace), "raised_in": str(where)}}:
                raised: RaisedIn = "tests" if where == "tests" else "simulation"
                return TestReport(outcome="error", message=message, traceback=trace, raised_in=raised)
            case _:
                return TestReport(outcome="crashed", message="the worker's result was malformed")
    if call.events:
        return None
    at = from_stack(call.stack, sources, call.error)
    return TestReport(
        outcome="timeout" if call.outcome in ("timeout", "cpu_limit") else "crashed",
        message=f"before any test: {_last_line(call.error)}",
        traceback=at.text if at else call.error,
        raised_in=at.raised_in if at else None,
    )


def _case(item: str, expected: ExpectedTests, each: EachResult, sources: dict[str, str]) -> TestCase:
    if item in each.stopped:
        call = each.stopped[item]
        trace = from_stack(call.stack, sources, call.error)
        return TestCase(
            id=item,
            outcome=_STOPPED.get(call.outcome, "crashed"),
            seconds=call.seconds,
            message=_last_line(call.error),
            traceback=trace.text if trace else "",
            output=call.output[-4000:],
            raised_in=trace.raised_in if trace else None,
        )
    if item in each.ended:
        return _ended(item, each.ended[item], silent=item in expected.without_assertion)
    if each.last.outcome == "ok":
        message = "the test is in the source but was not there, or did not run, when its module was loaded"
        return TestCase(id=item, outcome="error", message=message, raised_in="tests")
    return TestCase(id=item, outcome="not_run", message=f"not run: {_last_line(each.last.error)}")


def _ended(item: str, event: dict[str, Any], silent: bool) -> TestCase:
    fields: dict[str, Any] = {
        key: value[: _BOUNDS[key]] if key in _BOUNDS and isinstance(value, str) else value
        for key, value in event.items()
        if key not in ("item", "phase")
    }
    try:
        case = TestCase(id=item, **fields)
    except (ValidationError, TypeError):
        return TestCase(id=item, outcome="error", message="its result was malformed", raised_in="tests")
    if case.outcome == "passed" and silent:
        silent_case = {"outcome": "no_assertion", "message": "it asserts nothing", "raised_in": "tests"}
        return case.model_copy(update=silent_case)
    return case


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or [""])[-1][:1000]
