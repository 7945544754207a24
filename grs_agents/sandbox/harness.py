"""The child's side of a test run: load the program and its tests, run them one by one, report each at once."""

import contextlib
import importlib
import io
import json
import linecache
import random
import sys
import time
import traceback
import unittest
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, TextIO, cast

from grs_agents.sandbox.caught import Caught
from grs_agents.sandbox.channel import progress
from grs_agents.sandbox.traces import SIMULATION_FILE, TESTS_FILE, describe

_KEPT_OUTPUT = 4000


def run_tests_inside(request: dict[str, Any]) -> dict[str, Any]:
    """Run the tests ``request["items"]``; each start and end is a progress event of the item.

    Args:
        request: the fields of ``TestRun``, and ``items``, the ids of the tests to run.

    Returns:
        ``{"load_error": None}``, or what went wrong before any test could run.
    """
    seed = int(request["seed"])
    seed_everything(seed)
    tests = ModuleType("test_task_code")
    with Caught() as caught:
        load_program(request["simulation"], request["simulation_name"])
        tests = load_program(request["tests"], file=TESTS_FILE)
    if isinstance(caught.error, MemoryError):
        raise caught.error
    if caught.error is not None:
        trace = describe(caught.error)
        return {"load_error": {"message": trace.message, "traceback": trace.text, "raised_in": trace.raised_in}}
    session = _Session(seed, _hook(request["clear"]), _hook(request["episode"]))
    pending: list[str] = list(request["items"])
    while pending and not session.exhausted:
        result = _Result(session)
        suite = unittest.TestSuite(_cases(tests, pending))
        if not suite.countTestCases():
            break
        with contextlib.suppress(KeyboardInterrupt):  # unittest lets it through; the tests after it still run
            suite.run(result)
        left = [item for item in pending if item not in session.ended]
        if len(left) == len(pending):
            result.blame_fixture(left)
            break
        pending = left
    if session.exhausted:  # nothing that runs in this process can be trusted to find memory
        raise MemoryError
    return {"load_error": None}


def load_program(source: str, alias: str = "", file: str = SIMULATION_FILE) -> ModuleType:
    """Execute ``source`` as the module named after ``file``, also known as ``alias`` unless a module has that name.

    The file is written to the working folder, where programs that read their own source find it.

    Raises:
        BaseException: whatever the program raises.
    """
    name = file.removesuffix(".py")
    module = ModuleType(name)
    module.__file__ = file
    Path(file).write_text(source, "utf-8")
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    sys.modules[name] = module
    if alias:
        sys.modules.setdefault(alias, module)
    exec(compile(source, file, "exec"), module.__dict__)
    return module


def seed_everything(seed: int) -> None:
    """Seed the global generators that programs written for CLIPort draw from."""
    import numpy as np  # here, so that a worker that runs no program starts without it

    random.seed(seed)
    np.random.seed(seed % 2**32)


def _hook(name: str | None) -> Callable[..., Any]:
    if not name:
        return lambda: None
    module, _, function = name.partition(":")
    return cast(Callable[..., Any], getattr(importlib.import_module(module), function))


def _cases(tests: ModuleType, items: Sequence[str]) -> Iterator[unittest.TestCase]:
    """The test cases of ``items`` that the loaded module really has."""
    for item in items:
        owner, _, method = item.partition(".")
        kind = getattr(tests, owner, None)
        if isinstance(kind, type) and issubclass(kind, unittest.TestCase) and callable(getattr(kind, method, None)):
            yield kind(method)


class _Session:
    """What all results of one worker share."""

    def __init__(self, seed: int, clear: Callable[[], Any], episode: Callable[[], Any]) -> None:
        self.seed, self.clear, self.episode = seed, clear, episode
        self.ended: set[str] = set()
        self.exhausted = False


class _Result(unittest.TestResult):
    """Reports each test as it starts and as it ends."""

    def __init__(self, session: _Session) -> None:
        super().__init__()
        self._session = session
        self._case: dict[str, Any] | None = None
        self._fixture: dict[str, Any] | None = None
        self._started = 0.0
        self._streams = contextlib.ExitStack()
        self._printed = io.StringIO()

    def startTest(self, test: unittest.TestCase) -> None:
        name = f"{type(test).__name__}.{getattr(test, '_testMethodName', '')}"
        self._case = {"item": name, "phase": "end"}
        self._printed = io.StringIO()
        self._streams.enter_context(contextlib.redirect_stdout(_Tee(sys.stdout, self._printed)))
        self._streams.enter_context(contextlib.redirect_stderr(_Tee(sys.stderr, self._printed)))
        progress({"item": name, "phase": "start"})
        seed_everything(self._session.seed)
        self._session.clear()
        self._started = time.perf_counter()

    def stopTest(self, test: unittest.TestCase) -> None:
        case = self._case
        if case is None:
            return
        self._streams.close()
        if "outcome" not in case:  # an exception that unittest lets through, or no verdict at all
            self._record("error", sys.exception() or RuntimeError("unittest gave no verdict"), test)
        seconds = time.perf_counter() - self._started
        episode = None if self._session.exhausted else _plain_object(self._session.episode)
        progress({**case, "seconds": seconds, "output": self._printed.getvalue(), "episode": episode})
        self._session.ended.add(case["item"])
        self._case = None

    def addSuccess(self, test: unittest.TestCase) -> None:
        self._set(test, outcome="passed")

    def addError(self, test: Any, err: Any) -> None:
        self._record("error", err[1], test)

    def addFailure(self, test: unittest.TestCase, err: Any) -> None:
        self._record("failed", err[1], test)

    def addSubTest(self, test: Any, subtest: Any, err: Any) -> None:
        if err is not None:
            self._record("failed" if issubclass(err[0], test.failureException) else "error", err[1], test)
        del subtest

    def addSkip(self, test: unittest.TestCase, reason: str) -> None:
        self._set(test, outcome="skipped", message=str(reason)[:1000], raised_in="tests")

    def addExpectedFailure(self, test: unittest.TestCase, err: Any) -> None:
        del err
        self._set(test, outcome="skipped", message="marked expectedFailure, so it shows nothing", raised_in="tests")

    def addUnexpectedSuccess(self, test: unittest.TestCase) -> None:
        self._set(test, outcome="failed", message="marked expectedFailure but it succeeds", raised_in="tests")

    def blame_fixture(self, items: Sequence[str]) -> None:
        """End ``items``, which could not start because of a class or module fixture."""
        if self._fixture is not None:
            for item in items:
                progress({"item": item, "phase": "start"})
                progress({**self._fixture, "item": item, "phase": "end"})

    def _record(self, outcome: str, error: BaseException, test: Any) -> None:
        if isinstance(error, MemoryError):
            traceback.clear_frames(error.__traceback__)  # the memory hangs on their local variables
            self._session.exhausted = self.shouldStop = True
            outcome = "memory"
        trace = describe(error)
        facts = {"message": trace.message, "traceback": trace.text, "raised_in": trace.raised_in}
        self._set(test, outcome=outcome, **facts)

    def _set(self, test: Any, **facts: Any) -> None:
        if self._case is None:
            where = str(getattr(test, "description", "")) or "a fixture"
            self._fixture = {**facts, "message": f"{where}: {facts.get('message', '')}"[:1000]}
        elif self._case.get("outcome", "passed") == "passed":  # the first of several errors is the one that matters
            self._case.update(facts)


class _Tee(io.TextIOBase):
    """Passes text on and keeps the beginning."""

    def __init__(self, stream: TextIO, kept: io.StringIO) -> None:
        self._stream, self._kept = stream, kept

    def write(self, text: str, /) -> int:
        room = _KEPT_OUTPUT - self._kept.tell()
        if room > 0:
            self._kept.write(text[:room])
        return self._stream.write(text)

    def flush(self) -> None:
        self._stream.flush()


def _plain_object(source: Callable[[], Any]) -> dict[str, Any] | None:
    """What ``source`` returns if that is a plain JSON object, else None."""
    with Caught():
        plain = json.loads(json.dumps(source(), allow_nan=False))
        return cast(dict[str, Any], plain) if isinstance(plain, dict) else None
    return None
