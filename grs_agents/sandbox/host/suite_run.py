"""The host's side of a test run: the expected tests, their outcomes, and the verdict."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.sandbox.host.batch_calls import BatchResult, call_tool_for_each_item
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.suite_discovery import ExpectedTests, discover_tests, parse_program
from grs_agents.sandbox.protocol.report import (
    EXITED,
    CallResult,
    CaseOutcome,
    Limits,
    ReportOutcome,
    TestCase,
    TestReport,
)
from grs_agents.sandbox.protocol.tracebacks import (
    MAX_MESSAGE,
    MAX_OUTPUT,
    MAX_TRACEBACK,
    SIMULATION_FILE,
    TESTS_FILE,
    RaisedIn,
    describe_error,
    describe_stack_dump,
    shorten_paths,
)

_STOPPED: dict[str, CaseOutcome] = {
    **{outcome: outcome for outcome in ("timeout", "output_limit", "scratch_limit", "thread_limit", "forged")},
    "cpu_limit": "timeout",
    "memory_limit": "memory",
}
_WORST: tuple[tuple[frozenset[CaseOutcome], ReportOutcome], ...] = (
    (frozenset({"forged"}), "forged"),
    (frozenset({"tampered", "replaced"}), "tampered"),
    (frozenset({"timeout"}), "timeout"),
    (frozenset({"crashed", "memory", "output_limit", "scratch_limit", "thread_limit"}), "crashed"),
    (frozenset({"exited"}), "exited"),
)
"""Outcome of a report by the worst outcome of its cases, in this order; other failures make it ``failed``."""
_SOURCE_PATTERNS: dict[CaseOutcome, re.Pattern[str]] = {
    "exited": re.compile(r"\b(_exit|exit|quit|abort)\s*\("),
    "forged": re.compile(r"\b(channel|wire|report_progress|write)\b"),
}
_BOUNDS = {"message": MAX_MESSAGE, "traceback": MAX_TRACEBACK, "output": MAX_OUTPUT}
_MAX_EPISODE = 256 << 10
"""Characters of an episode as JSON: ten times those of an episode with 200 objects."""


class TestRun(Frozen):
    """A program, its tests, and how to run them."""

    __test__ = False

    simulation: str  # source of the program under test, imported as `task_code`
    tests: str  # source of its `unittest` cases
    simulation_name: str = "task_code"  # another name under which the tests may import the program
    seed: int = Field(default=0, ge=0, lt=2**32)  # seeds `random` and `numpy.random` before each test
    clear: str | None = None  # `module:function` called before each test, or None
    # `module:function` called after each test; a JSON object it returns is kept with the case
    episode: str | None = None
    # `module:function` called after each test, or None; a string it returns says which limit of its own the test
    # reached, and is the message of a failure
    limit: str | None = None
    extra: dict[str, Any] = Field(default_factory=dict[str, Any])  # plain JSON for the tool's own `inside`


def run_tests(
    sandbox: Sandbox, tool: str, programs: TestRun, limits: Limits, readable: Sequence[Path] = ()
) -> TestReport:
    """Run the tests in workers; whatever they do is a report. ``SandboxError`` if no worker can be started.
    The ``inside`` of the tool file ``tool`` calls ``run_tests_inside``. The tests may read ``readable``."""
    try:
        parse_program(programs.simulation, SIMULATION_FILE)
        expected = discover_tests(parse_program(programs.tests, TESTS_FILE))
    except SyntaxError as error:
        trace = describe_error(error)
        where: RaisedIn = "tests" if TESTS_FILE in (error.filename or trace.message) else "simulation"
        return TestReport(outcome="error", message=trace.message, traceback=trace.text, raised_in=where)
    if not expected.ids:
        message = "no class that derives from unittest.TestCase has a test method"
        return TestReport(outcome="no_tests", message=message, raised_in="tests")
    if expected.chooses:
        message = "the test program has a load_tests of its own"
        return TestReport(outcome="load_tests", message=message, raised_in="tests")
    sources = {SIMULATION_FILE: programs.simulation, TESTS_FILE: programs.tests}

    def hopeless(call: CallResult) -> bool:
        trace = describe_stack_dump(call.stack, sources, call.error)
        return trace is None or bool({"setUp", "setUpClass", "reset"} & set(trace.functions))

    batch = call_tool_for_each_item(sandbox, tool, programs.model_dump(), expected.ids, limits, hopeless, readable)
    built = (_build_test_case(item, expected, batch, sources) for item in expected.ids)
    cases = (*built, *_build_unexpected_cases(expected, batch))
    report = _report_load_failure(batch, sources) or _make_report_from_cases(cases, batch)
    totals = {
        "seconds": sum(call.seconds for call in batch.calls),
        "cpu_seconds": sum(call.cpu_seconds for call in batch.calls),
        "backend": batch.last_call.backend,
    }
    return report.model_copy(update=totals)


def _make_report_from_cases(cases: tuple[TestCase, ...], batch: BatchResult) -> TestReport:
    first = next((case for case in cases if case.outcome != "passed"), None)
    if first is not None:
        outcome = _select_worst_outcome({case.outcome for case in cases}, "failed")
        return TestReport(outcome=outcome, cases=cases, raised_in=first.raised_in)
    ended = next((call for call in batch.calls if call.outcome != "ok"), None)
    if ended is not None:
        message = f"after a test: {_last_line(ended.error)}"
        return TestReport(outcome=_to_report_outcome(ended), cases=cases, message=message, raised_in="tests")
    return TestReport(outcome="passed", cases=cases)


def _to_report_outcome(call: CallResult) -> ReportOutcome:
    """Outcome of a report for a call that ended outside of any test."""
    return _select_worst_outcome({_to_case_outcome(call)}, "crashed")


def _select_worst_outcome(outcomes: set[CaseOutcome], otherwise: ReportOutcome) -> ReportOutcome:
    for group, name in _WORST:
        if outcomes & group:
            return name
    return otherwise


def _to_case_outcome(call: CallResult) -> CaseOutcome:
    return _STOPPED.get(call.outcome, "exited" if call.error.startswith(EXITED) else "crashed")


def _report_load_failure(batch: BatchResult, sources: dict[str, str]) -> TestReport | None:
    """The report of programs that never got to a test, or None."""
    call = batch.last_call
    if call.outcome == "ok":
        match call.value:
            case {"load_error": None}:
                return None
            case {
                "load_error": {"message": str(), "traceback": str(), "raised_in": str(where), "kind": str(kind)} as what
            }:
                return TestReport(
                    outcome="tampered" if kind == "tampered" else "exited" if kind == "exited" else "error",
                    message=what["message"][:MAX_MESSAGE],
                    traceback=what["traceback"][:MAX_TRACEBACK],
                    raised_in="tests" if where == "tests" else "simulation",
                )
            case _:
                return TestReport(outcome="crashed", message="the worker's result was malformed")
    if call.events:
        return None
    at = describe_stack_dump(call.stack, sources, call.error)
    return TestReport(
        outcome=_to_report_outcome(call),
        message=f"before any test: {_last_line(call.error)}",
        traceback=at.text if at else shorten_paths(call.error)[-MAX_TRACEBACK:],
        raised_in=at.raised_in if at else _guess_culprit_program(call, sources),
    )


def _build_test_case(item: str, expected: ExpectedTests, batch: BatchResult, sources: dict[str, str]) -> TestCase:
    if item in batch.stopped:
        call = batch.stopped[item]
        trace = describe_stack_dump(call.stack, sources, call.error)
        return TestCase(
            id=item,
            outcome=_to_case_outcome(call),
            seconds=call.seconds,
            message=_last_line(call.error),
            traceback=trace.text if trace else "",
            output=shorten_paths(call.output)[-MAX_OUTPUT:],
            raised_in=trace.raised_in if trace else _guess_culprit_program(call, sources),
        )
    if item in batch.untimely:
        message = "a result was reported for it while it was not running"
        return TestCase(id=item, outcome="forged", message=message, raised_in="tests")
    if item in batch.ended:
        event = batch.ended[item]
        case = _parse_reported_case(item, event)
        if case is None:
            return TestCase(id=item, outcome="forged", message="its result was malformed", raised_in="tests")
        objection = _find_source_mismatch(case, event.get("line"), expected, repeated=item in batch.repeated)
        if objection is not None and case.outcome != "tampered":  # the source decides, not the reported outcome
            case = case.model_copy(update={"outcome": objection[0], "message": objection[1], "raised_in": "tests"})
        return case
    if batch.last_call.outcome == "ok":
        message = "it is in the source but was not there, or did not run, when its module was loaded"
        return TestCase(id=item, outcome="missing", message=message, raised_in="tests")
    return TestCase(id=item, outcome="not_run", message=f"not run: {_last_line(batch.last_call.error)}")


def _parse_reported_case(item: str, event: dict[str, Any]) -> TestCase | None:
    """The case as the worker reported it, texts cut to their bounds; None if it is malformed."""
    kept = {key: value for key, value in event.items() if key not in ("item", "phase", "line")}
    texts = {key: kept[key][:most] for key, most in _BOUNDS.items() if isinstance(kept.get(key), str)}
    try:
        case = TestCase(id=item, **(kept | texts))
        return case if len(json.dumps(case.episode)) <= _MAX_EPISODE else None
    except (ValueError, TypeError):  # pydantic's are ValueErrors
        return None


def _find_source_mismatch(
    case: TestCase, line: object, expected: ExpectedTests, repeated: bool
) -> tuple[CaseOutcome, str] | None:
    """The outcome and message of a case that does not fit the source, whose code began at ``line`` of the tests."""
    if repeated:
        return "duplicate", "its result was reported twice"
    if case.id in expected.duplicates:
        return "duplicate", "the source has two tests of this name"
    wrong = case.id in expected.lines and line != expected.lines[case.id]
    if wrong and (line is not None or case.outcome == "passed"):  # a test that a fixture ended has no line
        return "replaced", f"the code that ran is not that of line {expected.lines[case.id]}"
    if case.outcome == "passed" and case.id in expected.without_assertion:
        return "no_assertion", "it asserts nothing"
    if case.outcome == "passed" and not case.assertions:
        return "no_assertion", "it came to none of its assertions"
    return None


def _build_unexpected_cases(expected: ExpectedTests, batch: BatchResult) -> tuple[TestCase, ...]:
    """Cases of tests that are not in the source, and of results that were never requested."""
    added = "it is no method in the source, so it did not run"
    made_up = "a result was reported for a test there is not"
    match batch.last_call.value:
        case {"found": [*items]}:
            ids = [item for item in cast(list[object], items) if isinstance(item, str)]
        case _:
            ids = list[str]()
    present = [item for item in ids if item not in expected.ids]
    cases = [TestCase(id=item[:200], outcome="extra", message=added, raised_in="tests") for item in present]
    cases += [TestCase(id=item, outcome="forged", message=made_up, raised_in="tests") for item in batch.strange]
    return tuple(cases[:100])


def _guess_culprit_program(call: CallResult, sources: dict[str, str]) -> RaisedIn | None:
    """The program that ended the process or wrote to the pipe, by a search of the sources: that leaves no traceback."""
    pattern = _SOURCE_PATTERNS.get(_to_case_outcome(call))
    if pattern is None:
        return None
    if pattern.search(sources[TESTS_FILE]):
        return "tests"
    return "simulation" if pattern.search(sources[SIMULATION_FILE]) else None


def _last_line(text: str) -> str:
    return shorten_paths((text.strip().splitlines() or [""])[-1])[:MAX_MESSAGE]
