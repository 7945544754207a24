"""A report is what the host saw: whatever test programs do, each test of the source has an outcome."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.config.schema import Limits
from grs_agents.graph.evidence import render_evidence
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.suite_run import TestRun, run_tests
from grs_agents.sandbox.protocol.report import CallOutcome, CallResult, TestReport

Check = Callable[..., TestReport]
SHORT = Limits(wall_seconds=1, memory_mib=128, output_mib=1)
HEAD = "import os, sys, unittest, numpy as np\nimport task_code\nclass TestX(unittest.TestCase):\n"


def outcomes(report: TestReport) -> dict[str, str]:
    return {case.id.removeprefix("TestX."): case.outcome for case in report.cases}


def test_passing_tests_under_both_names(check: Check) -> None:
    report = check(
        "import unittest\nfrom task_code import answer\nimport pack_boxes\n"
        "class TestX(unittest.TestCase):\n"
        "    def test_a(self): self.assertEqual(answer(), 42); print('seen')\n"
        "    def test_b(self): self.assertIs(pack_boxes.answer, answer)\n",
        "def answer(): return 42",
        simulation_name="pack_boxes",
    )
    assert report.all_passed, str(report)
    assert [case.output for case in report.cases] == ["seen\n", ""]
    assert report.seconds > 0


def test_every_outcome_of_one_test(check: Check) -> None:
    report = check(
        HEAD + "    def test_failed(self): self.assertEqual(1, 2)\n"
        "    def test_error(self): task_code.broken()\n"
        "    @unittest.skip('later')\n"
        "    def test_skipped(self): self.fail()\n"
        "    @unittest.expectedFailure\n"
        "    def test_expected(self): self.fail()\n"
        "    @unittest.expectedFailure\n"
        "    def test_unexpected(self): self.assertTrue(1)\n"
        "    def test_silent(self): task_code\n"
        "    def test_exit(self): sys.exit(0); self.fail()\n"
        "    def test_interrupt(self): raise KeyboardInterrupt\n"
        "    def test_subtest(self):\n"
        "        for n in (1, 2):\n"
        "            with self.subTest(n=n): self.assertEqual(n, 1)\n"
        "    def test_passed(self): self.assertTrue(1)\n",
        "def broken(): return 1 / 0",
    )
    assert outcomes(report) == {
        "test_failed": "failed",
        "test_error": "error",
        "test_skipped": "skipped",
        "test_expected": "expected_failure",
        "test_unexpected": "failed",
        "test_silent": "no_assertion",
        "test_exit": "exited",
        "test_interrupt": "error",
        "test_subtest": "failed",
        "test_passed": "passed",
    }
    assert report.outcome == "exited"
    raised = {case.id: case.raised_in for case in report.cases}
    assert (raised["TestX.test_failed"], raised["TestX.test_error"]) == ("tests", "simulation")


def test_crashes_are_charged_to_the_running_test_and_the_rest_runs(check: Check) -> None:
    report = check(
        HEAD + "    def test_a(self): self.assertTrue(1)\n"
        "    def test_exit_0(self): os._exit(0); self.fail()\n"
        "    def test_b(self): self.assertTrue(1)\n"
        "    def test_segfault(self):\n        import ctypes; ctypes.string_at(0); self.fail()\n"
        "    def test_memory(self):\n        x = []\n        while True: x.append(bytearray(1 << 20))\n"
        "    def test_flood(self):\n        while True: print('x' * 10000)\n"
        "    def test_z(self): self.assertTrue(1)\n",
        limits=Limits(wall_seconds=20, memory_mib=128, output_mib=1),
    )
    assert outcomes(report) == {
        "test_a": "passed",
        "test_exit_0": "exited",
        "test_b": "passed",
        "test_segfault": "crashed",
        "test_memory": "memory",
        "test_flood": "output_limit",
        "test_z": "passed",
    }
    assert report.outcome == "crashed"
    assert "ctypes.string_at(0)" in render_evidence(report)


def test_hang_in_a_test_costs_that_test(check: Check) -> None:
    report = check(
        HEAD + "    def test_hang(self):\n        while True: pass\n    def test_z(self): self.assertTrue(1)\n",
        limits=SHORT,
    )
    assert outcomes(report) == {"test_hang": "timeout", "test_z": "passed"}
    assert (report.outcome, report.raised_in) == ("timeout", "tests")
    assert "while True: pass" in render_evidence(report)


REST = "    def test_b(self): self.fail()\n    def test_c(self): self.fail()\n"


@pytest.mark.parametrize(
    "tests",
    [
        HEAD + "    def setUp(self): task_code.spin()\n    def test_a(self): self.fail()\n" + REST,
        HEAD + "    def setUp(self): task_code.reset()\n    def test_a(self): self.fail()\n" + REST,
        HEAD + "    def test_a(self): task_code.reset()\n" + REST,
    ],
    ids=["setUp", "reset in setUp", "reset"],
)
def test_hang_in_set_up_costs_one_limit(tests: str, check: Check) -> None:
    report = check(tests, "def spin():\n    while True: pass\ndef reset(): spin()", limits=SHORT)
    assert outcomes(report) == {"test_a": "timeout", "test_b": "not_run", "test_c": "not_run"}
    assert report.cases[0].raised_in == "simulation"
    assert report.seconds < 2 * SHORT.wall_seconds
    assert "(not_run: " in render_evidence(report)


def test_second_hang_is_the_last(check: Check) -> None:
    spin = ":\n        while True: pass\n"
    report = check(HEAD + "".join(f"    def test_{n}(self){spin}" for n in "abc"), limits=SHORT)
    assert outcomes(report) == {"test_a": "timeout", "test_b": "timeout", "test_c": "not_run"}


SIMPLE = HEAD + "    def test_a(self): self.assertTrue(1)\n"
BROKEN = {
    "unparseable program": ("def", SIMPLE, "error", "simulation"),
    "unparseable tests": ("", "def", "error", "tests"),
    "program raises": ("1 / 0", SIMPLE, "error", "simulation"),
    "missing import in the tests": ("", "from task_code import Nothing\n" + SIMPLE, "error", "tests"),
    "program hangs on import": ("while True: pass", SIMPLE, "timeout", "simulation"),
    "program exits hard": ("import os; os._exit(0)", SIMPLE, "exited", "simulation"),
    "program exits": ("import sys; sys.exit(0)", SIMPLE, "exited", "simulation"),
    "tests exit hard": ("", SIMPLE + "os._exit(0)\n", "exited", "tests"),
    "tests exit": ("", SIMPLE + "sys.exit(0)\n", "exited", "tests"),
    "program eats memory": ("x = []\nwhile True: x.append(bytearray(1 << 20))", SIMPLE, "crashed", None),
    "program floods": ("while True: print('x' * 10000)", SIMPLE, "crashed", None),
    "no tests": ("", "import unittest", "no_tests", "tests"),
    "a class without tests": ("", HEAD + "    def check(self): self.fail()", "no_tests", "tests"),
    "load_tests": ("", SIMPLE + "def load_tests(*args): return unittest.TestSuite()", "load_tests", "tests"),
    "load_tests by import": ("", SIMPLE + "from task_code import f as load_tests", "load_tests", "tests"),
    "load_tests by assignment": ("", SIMPLE + "load_tests = None", "load_tests", "tests"),
    "program tampers": (
        "import unittest\nunittest.TestCase.assertTrue = lambda *a: None",
        SIMPLE,
        "tampered",
        "simulation",
    ),
    "tests tamper": ("", SIMPLE + "unittest.TestResult.addFailure = lambda *a: None", "tampered", "tests"),
    "numpy is tampered with": (
        "import numpy.testing as t\ndef f(*a): pass\nt.assert_allclose = f",
        SIMPLE,
        "tampered",
        "simulation",
    ),
    "a module is replaced": (
        "import sys, unittest\nsys.modules['unittest'] = sys",
        "x = 1\n" + SIMPLE,
        "tampered",
        "simulation",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_programs_that_do_not_load(name: str, check: Check) -> None:
    simulation, tests, outcome, raised_in = BROKEN[name]
    seconds = 1 if outcome == "timeout" else 9
    report = check(tests, simulation, limits=SHORT.model_copy(update={"wall_seconds": seconds}))
    assert (report.outcome, report.raised_in) == (outcome, raised_in), report
    assert report.message
    assert not report.all_passed


METHOD = "    def test_a(self): self.assertTrue(0)\n"
GOOD = METHOD.replace("0", "1")
START = "    def test_a(self):\n"
LIE = (
    START + "        from grs_agents.sandbox.harness.channel import report_progress\n"
    "        report_progress({**dict(item='TestX.test_a', phase='end'), **dict(%s)})\n"
)
WRITES = (
    "        for pipe in range(3, 10):\n            try: os.write(pipe, b'x' * 100)\n            except OSError: pass\n"
)
HONEST = "    def test_b(self): self.assertTrue(1)\n"
DISHONEST = {
    "deleted": (METHOD + "del TestX.test_a\n", "missing", "failed"),
    "class replaced": (METHOD + "TestX = object\n", "missing", "failed"),
    "another class of its name": (
        METHOD + "class Y(unittest.TestCase):\n    def test_a(self): self.assertTrue(1)\nTestX = Y\n",
        "replaced",
        "tampered",
    ),
    "another function": (METHOD + "TestX.test_a = lambda self: self.assertTrue(1)\n", "replaced", "tampered"),
    "another function's code": (
        METHOD + "TestX.test_a.__code__ = (lambda self: self.assertTrue(1)).__code__\n",
        "replaced",
        "tampered",
    ),
    "the next test is replaced": (
        "    def test_0(self):\n        self.assertTrue(1)\n        TestX.test_a = TestX.test_0\n" + METHOD,
        "replaced",
        "tampered",
    ),
    "defined twice": (METHOD + GOOD, "duplicate", "failed"),
    "class defined twice": (
        METHOD + "class TestX(unittest.TestCase):\n    def test_a(self): self.assertTrue(1)\n",
        "duplicate",
        "failed",
    ),
    "skipped": ("    @unittest.skip('')\n" + METHOD, "skipped", "failed"),
    "skips itself": ("    def test_a(self): self.skipTest('')\n" + HONEST, "skipped", "failed"),
    "expected to fail": ("    @unittest.expectedFailure\n" + METHOD, "expected_failure", "failed"),
    "asserts nothing": ("    def test_a(self): pass\n", "no_assertion", "failed"),
    "assertion out of reach": ("    def test_a(self):\n        if 0: self.assertTrue(0)\n", "no_assertion", "failed"),
    "returns before": ("    def test_a(self):\n        return\n        assert 0\n", "no_assertion", "failed"),
    "loop over nothing": (
        START + "        for x in ():\n            if x: raise ValueError\n",
        "no_assertion",
        "failed",
    ),
    "never awaited": ("    async def test_a(self): self.fail()\n", "no_assertion", "failed"),
    "only setUp asserts": (
        "    def setUp(self): self.assertTrue(1)\n    def test_a(self):\n        if 0: assert 0\n",
        "no_assertion",
        "failed",
    ),
    "exits": ("    def test_a(self): sys.exit(0); self.fail()\n", "exited", "exited"),
    "exits hard": ("    def test_a(self): os._exit(0); self.fail()\n", "exited", "exited"),
    "run replaced": (METHOD + "TestX.run = lambda self, result=None: None\n", "tampered", "tampered"),
    "run overridden": (
        METHOD + "    def run(self, result):\n"
        "        result.startTest(self); result.addSuccess(self); result.stopTest(self)\n",
        "tampered",
        "tampered",
    ),
    "assertion overridden": (METHOD + "    def assertTrue(self, *args): pass\n", "tampered", "tampered"),
    "assertion replaced on the test": (
        "    def test_a(self):\n        self.assertTrue = print\n        self.assertTrue(0)\n",
        "tampered",
        "tampered",
    ),
    "assertion replaced for all": (
        "    def test_a(self):\n        unittest.TestCase.assertTrue = print\n        self.assertTrue(0)\n",
        "tampered",
        "tampered",
    ),
    "code of an assertion replaced": (
        "    def test_a(self):\n        unittest.TestCase.assertTrue.__code__ = (lambda self, *a: None).__code__\n"
        "        self.assertTrue(0)\n",
        "tampered",
        "tampered",
    ),
    "numpy replaced": (
        "    def test_a(self):\n        np.testing.assert_allclose = print\n        np.testing.assert_allclose(0, 1)\n",
        "tampered",
        "tampered",
    ),
    "result class patched": (
        "    def test_a(self):\n        type(self._outcome.result).addFailure = type(self._outcome.result).addSuccess\n"
        "        self.assertTrue(0)\n",
        "tampered",
        "tampered",
    ),
    "result patched": (
        "    def test_a(self):\n        self._outcome.result.addFailure = print\n        self.assertTrue(1)\n",
        "tampered",
        "tampered",
    ),
    "built-in patched": (
        START + "        import builtins; builtins.any = lambda values: False\n        self.assertTrue(1)\n",
        "tampered",
        "tampered",
    ),
    "no exception at all": (
        "    def test_a(self):\n        class Odd(type(self).failureException): pass\n"
        "        unittest.TestCase.failureException = Odd\n        self.assertTrue(1)\n",
        "tampered",
        "tampered",
    ),
    "own verdict first": (
        LIE % "outcome='passed', assertions=1" + "        self.assertTrue(0)\n",
        "duplicate",
        "failed",
    ),
    "own verdict, then out": (
        LIE % "outcome='passed', assertions=1" + "        os._exit(0); self.fail()\n",
        "replaced",
        "tampered",
    ),
    "own verdict of the right line, then out": (
        LIE % "outcome='passed', assertions=1, line=4" + "        os._exit(0); self.fail()\n",
        "passed",
        "exited",
    ),
    "verdict of the next test": (
        LIE % "item='TestX.test_b', outcome='passed'" + "        self.assertTrue(1)\n"
        "    def test_b(self): self.fail()\n",
        "passed",
        "forged",
    ),
    "verdict of no test": (
        LIE % "item='TestX.test_z', outcome='passed'" + "        self.assertTrue(1)\n",
        "passed",
        "forged",
    ),
    "malformed verdict": (LIE % "outcome=[], x=1" + "        os._exit(0); self.fail()\n", "forged", "forged"),
    "a verdict past the harness": (START + WRITES + "        self.assertTrue(1)\n" + HONEST, "forged", "forged"),
    "a frame of its own making": (
        START + "        from grs_agents.sandbox.protocol import wire\n"
        "        data = wire.encode({'kind': 'result', 'value': {}})\n"
        + WRITES.replace("b'x' * 100", "data")
        + "        self.assertTrue(1)\n",
        "forged",
        "forged",
    ),
    "another key": (
        START + "        from grs_agents.sandbox.harness import channel\n"
        "        from grs_agents.sandbox.protocol import wire\n        channel.connect(3, wire.new_key())\n"
        "        self.assertTrue(1)\n",
        "forged",
        "forged",
    ),
    "added later": (
        GOOD + "TestX.test_more = TestX.test_a\n",
        "passed",
        "failed",
    ),
    "class made later": (
        GOOD + "TestY = type('TestY', (unittest.TestCase,), {'test_y': lambda self: self.fail()})\n",
        "passed",
        "failed",
    ),
    "fixture of the class fails": (METHOD + "    @classmethod\n    def setUpClass(cls): 1 / 0\n", "error", "failed"),
    "exits after the tests": (GOOD + "def tearDownModule(): os._exit(0)\n", "passed", "exited"),
}


@pytest.mark.parametrize("name", DISHONEST)
def test_each_dishonesty_has_an_outcome_of_its_own(name: str, check: Check) -> None:
    tests, outcome, whole = DISHONEST[name]
    report = check(HEAD + tests)
    assert not report.all_passed
    assert (outcomes(report)["test_a"], report.outcome) == (outcome, whole), str(report)
    bad = [case for case in report.cases if case.outcome != "passed"]
    assert all(case.message for case in bad)
    assert all(case.raised_in == "tests" for case in bad), str(report)


def test_what_turns_up_later_is_named(check: Check) -> None:
    report = check(HEAD + DISHONEST["added later"][0])
    assert outcomes(report) == {"test_a": "passed", "test_more": "extra"}
    assert "(extra: " in render_evidence(report)


def test_what_runs_after_tampering_runs_in_a_fresh_process(check: Check) -> None:
    report = check(
        HEAD
        + "    def test_a(self): unittest.TestCase.assertTrue = print; self.assertTrue(0)\n"
        + METHOD.replace("_a", "_z")
    )
    assert outcomes(report) == {"test_a": "tampered", "test_z": "failed"}
    assert "unittest.case.TestCase.assertTrue was replaced" in render_evidence(report)


@pytest.mark.parametrize("outcome", ["forged", "scratch_limit", "thread_limit"])
def test_how_a_call_ends_is_the_outcome_of_the_test_that_ran(outcome: CallOutcome) -> None:
    started = ({"item": "TestX.test_a", "phase": "start"},)
    sandbox = Scripted(
        CallResult(outcome=outcome, error="why", events=started),
        CallResult(outcome="ok", value={"load_error": None, "found": []}),
    )
    report = run_tests(sandbox, "plain_tests", TestRun(simulation="", tests=HEAD + METHOD + HONEST), SHORT)
    assert outcomes(report) == {"test_a": outcome, "test_b": "missing"}
    assert report.outcome == ("forged" if outcome == "forged" else "crashed")
    assert f"({outcome}: " in render_evidence(report)


class Scripted(Sandbox):
    """A sandbox whose calls end as they are told to."""

    def __init__(self, *ends: CallResult) -> None:
        super().__init__()
        self.ends = list(ends)

    def call(
        self, tool: str, request: dict[str, Any], limits: Limits | None = None, readable: Sequence[Path] = ()
    ) -> CallResult:
        return self.ends.pop(0)


REACHED = {
    "in a helper": "        check(1)\ndef check(x): assert x\n",
    "by raising": "        x = 1\n        if not x: raise AssertionError(x)\n",
    "in a try": "        try: int('1')\n        except ValueError: self.fail()\n",
    "in an else": "        for x in ():\n            break\n        else:\n            self.assertTrue(1)\n",
    "in a with": "        with self.assertRaises(ValueError): int('x')\n",
    "of numpy": "        np.testing.assert_allclose(1, 1)\n",
    "of a mock": "        from unittest.mock import Mock\n        m = Mock(); m(); m.assert_called_once()\n",
    "in a match": "        match 1:\n            case 1: self.assertTrue(1)\n",
    "in a subtest": "        for n in (1, 2):\n            with self.subTest(n=n): self.assertTrue(n)\n",
}


@pytest.mark.parametrize("name", REACHED)
def test_an_assertion_that_is_reached_counts(name: str, check: Check) -> None:
    report = check(HEAD + "    def test_a(self):\n" + REACHED[name])
    assert report.all_passed, str(report)
    assert report.cases[0].assertions >= 1


def test_a_limit_that_a_test_reached_fails_it_though_it_caught_the_error(check: Check) -> None:
    report = check(
        HEAD + "    def test_a(self): task_code.REACHED.append('many: 3 of 2'); self.assertTrue(1)\n"
        "    def test_b(self): task_code.REACHED.append('many'); raise ValueError\n"
        "    def test_z(self): self.assertTrue(1)\n",
        "REACHED = []\ndef clear(): REACHED.clear()\ndef limit(): return REACHED[-1] if REACHED else None",
        clear="task_code:clear",
        limit="task_code:limit",
    )
    assert outcomes(report) == {"test_a": "limit", "test_b": "limit", "test_z": "passed"}
    assert report.cases[0].message == "many: 3 of 2"
    assert "raise ValueError" in report.cases[1].traceback
    assert (report.outcome, report.all_passed) == ("failed", False)


def test_each_test_is_seeded_alike(check: Check) -> None:
    body = "import random; print(random.random(), np.random.rand()); self.assertTrue(1)"
    report = check(HEAD + f"    def test_a(self): {body}\n    def test_b(self): {body}\n", seed=7)
    assert report.all_passed
    assert report.cases[0].output == report.cases[1].output


def test_episode_of_each_test_is_kept(check: Check) -> None:
    report = check(
        HEAD + "    def test_a(self): task_code.LAST['reward'] = 1.0; self.assertTrue(1)\n"
        "    def test_b(self): self.assertTrue(1)\n"
        "    def test_c(self): task_code.LAST['reward'] = float('nan'); self.assertTrue(1)\n",
        "LAST = {}\ndef clear(): LAST.clear()\ndef last(): return LAST or None",
        clear="task_code:clear",
        episode="task_code:last",
    )
    assert [case.episode for case in report.cases] == [{"reward": 1.0}, None, None]
    assert report.all_passed


def test_a_test_that_ran_no_episode_shows_its_fixtures_and_one_that_did_shows_its_own(check: Check) -> None:
    report = check(
        "import unittest\nimport task_code\n"
        "def setUpModule(): task_code.LAST['of'] = 'module'\n"
        "class TestX(unittest.TestCase):\n"
        "    @classmethod\n"
        "    def setUpClass(cls): task_code.LAST['of'] = 'class'\n"
        "    def test_a(self): self.assertTrue(1)\n"
        "    def test_b(self): task_code.LAST['of'] = 'b'; self.assertTrue(1)\n"
        "    def test_c(self): self.assertTrue(1)\n"
        "class TestY(unittest.TestCase):\n"
        "    def test_d(self): self.assertTrue(1)\n"
        "class TestZ(unittest.TestCase):\n"
        "    @classmethod\n"
        "    def setUpClass(cls): task_code.LAST['of'] = 'broken'; cls().fail()\n"
        "    def test_e(self): self.assertTrue(1)\n",
        "LAST = {}\ndef clear(): LAST.clear()\ndef last(): return LAST or None",
        clear="task_code:clear",
        episode="task_code:last",
    )
    assert [((case.episode or {}).get("of"), case.episode_hook) for case in report.cases] == [
        ("class", "setUpClass"),
        ("b", "test"),
        ("class", "setUpClass"),
        ("module", "setUpModule"),
        ("broken", "setUpClass"),
    ]
    assert outcomes(report)["TestZ.test_e"] == "error"


def test_reports_name_no_folder_of_this_machine(check: Check) -> None:
    body = "import json, numpy; print(numpy.__file__, os.path.abspath('x')); numpy.linalg.inv(numpy.zeros((2, 2)))"
    report = check(HEAD + f"    def test_a(self): {body}\n    def test_b(self): os._exit(1)\n")
    assert "numpy/linalg/" in report.cases[0].traceback
    assert report.cases[0].output == "numpy/__init__.py x\n"
    text = report.model_dump_json()
    assert not [folder for folder in (sys.prefix, sys.base_prefix, str(Path(__file__).parents[3])) if folder in text]


def test_long_texts_are_cut(check: Check) -> None:
    report = check(HEAD + "    def test_a(self): print('x' * 100000); self.fail('y' * 100000)\n")
    case = report.cases[0]
    assert len(case.output) == 4000
    assert len(case.message) == 1000
    assert len(case.traceback) <= 8000


@pytest.mark.parametrize("number", ["9" * 5000, "0", "9" * 9])
def test_a_dump_that_the_program_wrote_itself_is_read_with_suspicion(number: str, check: Check) -> None:
    dump = f'  File "task_code.py", line {number} in reset\n  File "test_task_code.py", line 1 in x\n'
    report = check(HEAD + f"    def test_a(self): os.write(4, {dump.encode()!r}); os._exit(1)\n")
    assert outcomes(report) == {"test_a": "exited"}


@pytest.mark.parametrize("episode", ["10**30", "json.loads('[' * 300 + ']' * 300)", "'x' * 300_000"])
def test_an_episode_that_no_later_file_can_hold_is_refused(episode: str, check: Check) -> None:
    forged = (
        f"dict(item='TestX.test_a', phase='end', outcome='passed', assertions=1, line=4, episode={{'x': {episode}}})"
    )
    body = "    def test_a(self): import json; from grs_agents.sandbox.harness.channel import report_progress; "
    body += f"report_progress({forged})\n"
    report = check(HEAD + body)
    assert not report.all_passed
    assert report.cases[0].outcome in ("crashed", "forged", "duplicate"), report
    assert report.cases[0].episode is None
