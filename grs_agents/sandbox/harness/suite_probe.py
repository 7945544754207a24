"""Run a whole test suite repeatedly in a single process, each time until its first test that does not pass."""

import contextlib
import io
import sys
import unittest
from collections.abc import Callable, Sequence
from typing import Any

from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.harness.suite_runner import load_program, seed_everything
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE, describe_error


class _FirstFailure(unittest.TestResult):
    """Ends with the first test that does not pass."""

    def __init__(self, begin: Callable[[], None]) -> None:
        super().__init__()
        self.failfast = True
        self.failed: str | None = None
        self.message = ""
        self._begin = begin

    def startTest(self, test: unittest.TestCase) -> None:
        super().startTest(test)
        self._begin()

    def addError(self, test: Any, err: Any) -> None:
        self._keep_first_failure(test, err[1])

    def addFailure(self, test: Any, err: Any) -> None:
        self._keep_first_failure(test, err[1])

    def addSubTest(self, test: Any, subtest: Any, err: Any) -> None:
        if err is not None:
            self._keep_first_failure(test, err[1])
        del subtest

    def _keep_first_failure(self, test: Any, error: BaseException) -> None:
        if self.failed is None:
            self.failed, self.message = str(test.id())[-200:], describe_error(error).message
        self.stop()


def run_suite_once(
    simulation: str, tests: str, alias: str, items: Sequence[str], seed: int, begin: Callable[[], None]
) -> dict[str, Any]:
    """Reload both programs and run the tests ``items`` (ids) in their order, up to the first that does not pass.

    ``begin`` is called before each test, after the generators are seeded with ``seed``. The answer is ``{"passed": ...,
    "test": id of the failed test, "message": why}``; printed output is lost. ``MemoryError`` is raised.
    """

    def seed_and_begin_test() -> None:
        seed_everything(seed)
        begin()

    result = _FirstFailure(seed_and_begin_test)
    printed = io.StringIO()
    with CapturedError() as captured, contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        # Read from the dict: a module may define ``__getattr__``.
        for name in [
            name
            for name, module in sys.modules.items()
            if (getattr(module, "__dict__", {}).get("__file__") in (SIMULATION_FILE, TESTS_FILE))
        ]:
            del sys.modules[name]
        seed_and_begin_test()
        load_program(simulation, alias)
        module = load_program(tests, file=TESTS_FILE)
        pairs = [item.partition(".") for item in items]
        unittest.TestSuite(getattr(module, owner)(method) for owner, _, method in pairs).run(result)
    if isinstance(captured.error, MemoryError):
        raise captured.error
    if captured.error is not None and result.failed is None:
        result.failed, result.message = "", describe_error(captured.error).message
    return {"passed": result.failed is None, "test": result.failed or "", "message": result.message}
