"""The child's side of a test run: load the program and its tests, run them in sequence.

Each test is reported as it starts and as it ends.
"""

import ast
import contextlib
import functools
import importlib
import inspect
import io
import json
import linecache
import random
import sys
import time
import traceback
import unittest
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, TextIO, cast

from grs_agents.sandbox.harness.assertion_count import COUNTER, Counter, insert_counter_calls
from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.harness.channel import report_progress
from grs_agents.sandbox.harness.tamper_detection import Integrity, find_overridden_method, find_shadowed_method
from grs_agents.sandbox.protocol.tracebacks import (
    MAX_MESSAGE,
    MAX_OUTPUT,
    SIMULATION_FILE,
    TESTS_FILE,
    RaisedIn,
    describe_error,
    shorten_paths,
)

_MAX_LISTED_TESTS = 1000


class FixtureEpisodes:
    """Keeps the episodes of fixtures apart from those of tests; ``take`` gives the last episode, once."""

    def __init__(self, take: Callable[[], dict[str, Any] | None]) -> None:
        self._take = take
        self._module: dict[str, Any] | None = None
        self._classes: dict[type, dict[str, Any]] = {}

    def watch_module(self, tests: ModuleType) -> None:
        """Record the episode that ``setUpModule`` of the tests runs."""
        set_up: Any = getattr(tests, "setUpModule", None)

        def set_up_module() -> None:
            try:
                set_up()
            finally:
                self._module = self._take()

        if callable(set_up):
            vars(tests)["setUpModule"] = set_up_module

    def begin_test(self, kind: type[unittest.TestCase]) -> None:
        """Begin a test of a class: an episode since the last test belongs to ``setUpClass``, if the class defines
        it."""
        episode = self._take()
        has_fixture = getattr(kind.setUpClass, "__func__", None) is not getattr(
            unittest.TestCase.setUpClass, "__func__", None
        )
        if episode is not None and has_fixture:
            self._classes[kind] = episode

    def find_episode_fields(self, kind: type | None) -> dict[str, Any]:
        """The fields ``episode`` and ``episode_hook`` of a test of a class, None: of a fixture that failed."""
        episode = self._take()
        if episode is not None:
            return {"episode": episode, "episode_hook": "test" if kind else "setUpClass"}
        if kind in self._classes:
            return {"episode": self._classes[kind], "episode_hook": "setUpClass"}
        return {"episode": self._module, "episode_hook": "setUpModule" if self._module else ""}


@dataclass
class Session:
    """State shared by all results of a worker."""

    begin: Callable[[], Any]  # called before each test: seeds, clears
    fixtures: FixtureEpisodes  # and of tests: the episode to keep with each test
    limit: Callable[[], Any]  # says in words which limit a test reached, if any
    counter: Counter  # of the assertions that are reached
    integrity: Integrity  # of the machinery
    names: dict[int, str] = field(default_factory=dict[int, str])  # ids of the tests by `id()` of their test cases
    ended: set[str] = field(default_factory=set[str])  # ids of the tests that were reported
    # reason why the rest of this process cannot be trusted, None if all is well
    spoilt: BaseException | None = None


class TamperedError(RuntimeError):
    """The machinery that gives the verdicts was tampered with."""


def report_unrun_test(item: str, **facts: Any) -> None:
    """Report the start and the end of a test that did not run."""
    report_progress({"item": item, "phase": "start"})
    report_progress({"item": item, "phase": "end", **facts})


class Result(unittest.TestResult):
    """Reports each test as it starts and as it ends."""

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self._case: dict[str, Any] | None = None
        self._fixture: dict[str, Any] | None = None
        self._started = 0.0
        self._streams = contextlib.ExitStack()
        self._printed = io.StringIO()

    def startTest(self, test: unittest.TestCase) -> None:
        name = self._session.names.get(id(test), type(test).__name__)
        self._case = {"item": name, "phase": "end", "line": _line_number_of_test(test)}
        self._printed = io.StringIO()
        self._streams.enter_context(contextlib.redirect_stdout(_Tee(sys.stdout, self._printed)))
        self._streams.enter_context(contextlib.redirect_stderr(_Tee(sys.stderr, self._printed)))
        report_progress({"item": name, "phase": "start"})
        self._session.fixtures.begin_test(type(test))
        self._session.begin()
        self._session.counter.count = 0
        self._started = time.perf_counter()

    def stopTest(self, test: unittest.TestCase) -> None:
        case = self._case
        if case is None:
            return
        self._streams.close()
        if "outcome" not in case:  # an exception that unittest lets through, or no verdict at all
            self._record_error("error", sys.exception() or RuntimeError("unittest gave no verdict"), test)
        seconds, session = time.perf_counter() - self._started, self._session
        printed = shorten_paths(self._printed.getvalue())
        case.update(seconds=seconds, output=printed, assertions=session.counter.count)
        if session.spoilt is None:
            with CapturedError():  # a limit counts even if the test caught its error
                reached = session.limit()
                if isinstance(reached, str) and case.get("outcome") != "tampered":
                    culprit = case.get("raised_in") or "simulation"
                    case.update(outcome="limit", message=reached[:MAX_MESSAGE], raised_in=culprit)
            case.update(session.fixtures.find_episode_fields(type(test)))
            shadowed = find_shadowed_method(test, self)
            broken = (
                (f"{shadowed} was replaced on the test or its result", "tests")
                if shadowed
                else session.integrity.find_replaced_definition()
            )
            if broken is not None:  # nothing else may run in this process
                session.spoilt, self.shouldStop = TamperedError(broken[0]), True
                case.update(outcome="tampered", message=broken[0], raised_in=broken[1] or "tests")
        report_progress(case)
        session.ended.add(case["item"])
        self._case = None

    def addSuccess(self, test: unittest.TestCase) -> None:
        self._set_outcome(test, outcome="passed")

    def addError(self, test: Any, err: Any) -> None:
        self._record_error("error", err[1], test)

    def addFailure(self, test: unittest.TestCase, err: Any) -> None:
        self._record_error("failed", err[1], test)

    def addSubTest(self, test: Any, subtest: Any, err: Any) -> None:
        if err is not None:
            self._record_error("failed" if issubclass(err[0], test.failureException) else "error", err[1], test)
        del subtest

    def addSkip(self, test: unittest.TestCase, reason: str) -> None:
        self._set_outcome(test, outcome="skipped", message=str(reason)[:MAX_MESSAGE] or "skipped", raised_in="tests")

    def addExpectedFailure(self, test: unittest.TestCase, err: Any) -> None:
        del err
        self._set_outcome(
            test, outcome="expected_failure", message="marked expectedFailure and fails", raised_in="tests"
        )

    def addUnexpectedSuccess(self, test: unittest.TestCase) -> None:
        self._set_outcome(test, outcome="failed", message="marked expectedFailure but it succeeds", raised_in="tests")

    def report_fixture_failure(self, items: Sequence[str]) -> None:
        """End ``items``, which could not start because of a class or module fixture."""
        if self._fixture is not None:
            for item in items:
                report_unrun_test(item, **self._fixture)

    def _record_error(self, outcome: str, error: BaseException, test: Any) -> None:
        if isinstance(error, MemoryError):
            traceback.clear_frames(error.__traceback__)  # the memory hangs on their local variables
            self._session.spoilt, self.shouldStop = MemoryError(), True
            outcome = "memory"
        elif isinstance(error, SystemExit):
            outcome = "exited"
        trace = describe_error(error)
        facts = {"message": trace.message, "traceback": trace.text, "raised_in": trace.raised_in}
        self._set_outcome(test, outcome=outcome, **facts)

    def _set_outcome(self, test: Any, **facts: Any) -> None:
        if self._case is None:
            where = str(getattr(test, "description", "")) or "a fixture"
            message = f"{where}: {facts.get('message', '')}"[:MAX_MESSAGE]
            self._fixture = {**facts, **self._session.fixtures.find_episode_fields(None), "message": message}
        elif self._case.get("outcome", "passed") == "passed":  # the first of several errors matters
            self._case.update(facts)


class _Tee(io.TextIOBase):
    """Passes text on and keeps the beginning."""

    def __init__(self, stream: TextIO, kept: io.StringIO) -> None:
        self._stream, self._kept = stream, kept

    def write(self, text: str, /) -> int:
        room = MAX_OUTPUT - self._kept.tell()
        if room > 0:
            self._kept.write(text[:room])
        return self._stream.write(text)

    def flush(self) -> None:
        self._stream.flush()


def _line_number_of_test(test: unittest.TestCase) -> int | None:
    """First line of a test's code in the test program; None for code from elsewhere."""
    with CapturedError():
        method: Any = getattr(type(test), getattr(test, "_testMethodName", ""), None)
        code = inspect.unwrap(method).__code__
        if isinstance(code, CodeType) and code.co_filename == TESTS_FILE:
            return code.co_firstlineno
    return None


def run_tests_inside(request: dict[str, Any]) -> dict[str, Any]:
    """Run the tests ``request["items"]`` (ids) of a ``TestRun``; each start and end is a progress event of the item.

    The answer is ``{"load_error": None, "found": [...]}`` with the ids of the loaded tests, or the error that came
    before any test could run. ``MemoryError`` or ``TamperedError`` is raised if the rest of this process cannot be
    trusted; earlier tests were reported.
    """
    seed = int(request["seed"])
    seed_everything(seed)
    counter, tests, test_ids = Counter(), ModuleType("test_task_code"), list[str]()
    integrity = Integrity(with_numpy="testing" in request["simulation"] + request["tests"])
    with CapturedError() as captured:
        load_program(request["simulation"], request["simulation_name"])
        _require_unchanged_machinery(integrity, "simulation")
        code = compile(insert_counter_calls(ast.parse(request["tests"], TESTS_FILE)), TESTS_FILE, "exec")
        tests = _execute_as_module(code, request["tests"], "", TESTS_FILE, {COUNTER: counter.increment})
        _require_unchanged_machinery(integrity, "tests")
        kinds = ((name, kind) for name, kind in list(vars(tests).items()) if isinstance(kind, type))
        test_ids = [
            f"{name}.{method}"
            for name, kind in kinds
            if issubclass(kind, unittest.TestCase) and kind.__name__ == name
            for method in dir(kind)
            if method.startswith("test") and callable(getattr(kind, method, None))
        ][:_MAX_LISTED_TESTS]
    if isinstance(captured.error, MemoryError):
        raise captured.error
    if isinstance(captured.error, TamperedError):
        message, culprit = captured.error.args
        return {"load_error": {"kind": "tampered", "message": message, "traceback": "", "raised_in": culprit}}
    if captured.error is not None:
        trace, kind = describe_error(captured.error), "exited" if isinstance(captured.error, SystemExit) else "error"
        error = {"kind": kind, "message": trace.message, "traceback": trace.text, "raised_in": trace.raised_in}
        return {"load_error": error}
    clear, last_episode = _load_hook_function(request["clear"]), _load_hook_function(request["episode"])

    def take_last_episode_json() -> dict[str, Any] | None:
        plain: Any = None
        with CapturedError():
            plain = json.loads(json.dumps(last_episode(), allow_nan=False))
        clear()
        return cast(dict[str, Any], plain) if isinstance(plain, dict) else None

    def begin() -> None:
        seed_everything(seed)
        clear()

    fixtures = FixtureEpisodes(take_last_episode_json)
    fixtures.watch_module(tests)
    session = Session(begin, fixtures, _load_hook_function(request["limit"]), counter, integrity)
    _run_pending_tests(tests, list(request["items"]), session)
    if session.spoilt is not None:
        raise session.spoilt
    return {"load_error": None, "found": test_ids}


def load_program(source: str, alias: str = "", file: str = SIMULATION_FILE) -> ModuleType:
    """Execute ``source`` as the module named after ``file``, also known as ``alias`` unless a module has that name.

    The file is written to the working folder for programs that read their own source. Exceptions of the program are
    raised.
    """
    return _execute_as_module(_compile_program(source, file), source, alias, file, {})


@functools.lru_cache(maxsize=2)
def _compile_program(source: str, file: str) -> CodeType:
    return compile(source, file, "exec")


def seed_everything(seed: int) -> None:
    """Seed the global generators that programs written for CLIPort draw from."""
    import numpy as np  # here, so that a worker that runs no program starts without it

    random.seed(seed)
    np.random.seed(seed % 2**32)


def _execute_as_module(code: CodeType, source: str, alias: str, file: str, given: dict[str, object]) -> ModuleType:
    name = file.removesuffix(".py")
    module = ModuleType(name)
    module.__file__ = file
    Path(file).write_text(source, "utf-8")
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    sys.modules[name] = module
    if alias:
        sys.modules.setdefault(alias, module)
    vars(module).update(given)
    exec(code, module.__dict__)
    return module


def _require_unchanged_machinery(integrity: Integrity, loaded: RaisedIn) -> None:
    """See that the program just ``loaded`` left the machinery as it was."""
    if (broken := integrity.find_replaced_definition()) is not None:
        raise TamperedError(broken[0], broken[1] or loaded)


def _run_pending_tests(tests: ModuleType, pending: list[str], session: Session) -> None:
    """Run ``pending`` until each has ended or nothing more can."""
    while pending and session.spoilt is None:
        result = Result(session)
        suite = unittest.TestSuite(_build_test_cases(tests, pending, session))
        if suite.countTestCases():
            with contextlib.suppress(KeyboardInterrupt):  # unittest lets it through; the tests after it still run
                suite.run(result)
        left = [item for item in pending if item not in session.ended]
        if len(left) == len(pending):
            result.report_fixture_failure(left)
            return
        pending = left


def _load_hook_function(name: str | None) -> Callable[..., Any]:
    if not name:
        return lambda: None
    module, _, function = name.partition(":")
    return cast(Callable[..., Any], getattr(importlib.import_module(module), function))


def _build_test_cases(tests: ModuleType, items: Sequence[str], session: Session) -> Iterator[unittest.TestCase]:
    """The test cases of ``items`` that the loaded module really has, and that are run as unittest runs tests."""
    for item in items:
        owner, _, method = item.partition(".")
        kind = getattr(tests, owner, None)
        if isinstance(kind, type) and issubclass(kind, unittest.TestCase) and callable(getattr(kind, method, None)):
            overridden = find_overridden_method(kind)
            if overridden is None:
                case = kind(method)
                session.names[id(case)] = item
                yield case
            else:
                message = f"{overridden} takes the place of unittest's own"
                report_unrun_test(item, outcome="tampered", message=message, raised_in="tests")
                session.ended.add(item)
