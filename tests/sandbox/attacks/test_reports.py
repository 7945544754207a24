"""Whatever a program does to the machinery of tests, a test that does not hold is never reported as passed."""

import inspect
import textwrap
from collections.abc import Callable

import pytest

from grs_agents.sandbox.host.suite_run import TestRun, run_tests
from tests.sandbox.attacks import tampering
from tests.sandbox.attacks.conftest import Door, bounds
from tests.sandbox.attacks.world import Canaries

IMPORTS = inspect.getsource(tampering).split('"""')[2].split("def ")[0]
TESTS = """
import unittest
import task_code
class TestX(unittest.TestCase):
    def test_a(self):
        self.assertEqual(1, 2)
"""
TAMPERING = {name: thing for name, thing in vars(tampering).items() if inspect.isfunction(thing)}


def body(function: Callable[[], None]) -> str:
    """What a function does, as a program."""
    source = inspect.getsource(function)
    return IMPORTS + textwrap.dedent(source.split("\n", 1)[1])


@pytest.mark.parametrize("where", ["simulation", "tests"])
@pytest.mark.parametrize("name", TAMPERING)
def test_a_failing_test_does_not_pass(name: str, where: str, door: Door, watched: Canaries) -> None:
    code = body(TAMPERING[name])
    tests = TESTS + code if where == "tests" else TESTS
    programs = TestRun(simulation=code if where == "simulation" else "", tests=tests)
    report = run_tests(door.sandbox, "plain_tests", programs, bounds(wall_seconds=5))
    assert not report.all_passed, report
    assert not [case.id for case in report.cases if case.outcome == "passed"]
