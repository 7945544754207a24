"""A report is what the host saw: whatever test programs do, each test of the source has an outcome."""

from collections.abc import Callable

import pytest

from grs_agents.sandbox import Limits, TestReport

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
    assert report.ok, report.text()
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
        "test_failed": "failed", "test_error": "error", "test_skipped": "skipped", "test_expected": "skipped",
        "test_unexpected": "failed", "test_silent": "no_assertion", "test_exit": "error",
        "test_interrupt": "error", "test_subtest": "failed", "test_passed": "passed",
    }  # fmt: skip
    assert report.outcome == "failed"
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
        "test_a": "passed", "test_exit_0": "crashed", "test_b": "passed", "test_segfault": "crashed",
        "test_memory": "memory", "test_flood": "crashed", "test_z": "passed",
    }  # fmt: skip
    assert report.outcome == "crashed"
    assert "ctypes.string_at(0)" in report.text()


def test_hang_in_a_test_costs_that_test(check: Check) -> None:
    report = check(
        HEAD + "    def test_hang(self):\n        while True: pass\n    def test_z(self): self.assertTrue(1)\n",
        limits=SHORT,
    )
    assert outcomes(report) == {"test_hang": "timeout", "test_z": "passed"}
    assert (report.outcome, report.raised_in) == ("timeout", "tests")
    assert "while True: pass" in report.text()


@pytest.mark.parametrize(
    "tests",
    [
        HEAD
        + "    def setUp(self): task_code.spin()\n    def test_a(self): self.fail()\n    def test_b(self): self.fail()",
        HEAD + "    def test_a(self): task_code.reset()\n    def test_b(self): self.fail()\n",
    ],
    ids=["setUp", "reset"],
)
def test_hang_in_set_up_costs_one_limit(tests: str, check: Check) -> None:
    report = check(tests, "def spin():\n    while True: pass\ndef reset(): spin()", limits=SHORT)
    assert outcomes(report) == {"test_a": "timeout", "test_b": "not_run"}
    assert report.cases[0].raised_in == "simulation"
    assert report.seconds < 2 * SHORT.wall_seconds


def test_second_hang_is_the_last(check: Check) -> None:
    spin = ":\n        while True: pass\n"
    report = check(
        HEAD + "".join(f"    def test_{n}(self){spin}" for n in "abc"),
        limits=SHORT.model_copy(update={"wall_seconds": 0.5}),
    )
    assert outcomes(report) == {"test_a": "timeout", "test_b": "timeout", "test_c": "not_run"}


SIMPLE = HEAD + "    def test_a(self): self.assertTrue(1)\n"
BROKEN = {
    "unparseable program": ("def", SIMPLE, "error", "simulation"),
    "unparseable tests": ("", "def", "error", "tests"),
    "program raises": ("1 / 0", SIMPLE, "error", "simulation"),
    "missing import in the tests": ("", "from task_code import Nothing\n" + SIMPLE, "error", "tests"),
    "program hangs on import": ("while True: pass", SIMPLE, "timeout", "simulation"),
    "program exits hard": ("import os; os._exit(0)", SIMPLE, "crashed", None),
    "program eats memory": ("x = []\nwhile True: x.append(bytearray(1 << 20))", SIMPLE, "crashed", None),
    "no tests": ("", "import unittest", "no_tests", "tests"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_programs_that_do_not_load(name: str, check: Check) -> None:
    simulation, tests, outcome, raised_in = BROKEN[name]
    report = check(tests, simulation, limits=SHORT)
    assert (report.outcome, report.raised_in) == (outcome, raised_in), report
    assert report.message
    assert not report.ok


FORGED = {
    "deleted test": SIMPLE + "del TestX.test_a\n",
    "class replaced": SIMPLE + "TestX = object\n",
    "load_tests": SIMPLE.replace("self.assertTrue(1)", "self.fail()")
    + "def load_tests(*args): return unittest.TestSuite()\n",
    "exit while loading": SIMPLE + "os._exit(0)\n",
    "set up class fails": SIMPLE + "    @classmethod\n    def setUpClass(cls): 1 / 0\n",
    "exit after the tests": SIMPLE + "def tearDownModule(): os._exit(0)\n",
    "run does nothing": SIMPLE + "TestX.run = lambda self, result=None: None\n",
    "duplicate verdict": HEAD
    + "    def test_a(self):\n        from grs_agents.sandbox import progress\n"
    + "        for _ in 'xx': progress({'item': 'TestX.test_a', 'phase': 'end', 'outcome': 'passed'})\n"
    + "        self.assertTrue(1)\n",
    "forged verdict of another": HEAD
    + "    def test_a(self):\n        from grs_agents.sandbox import progress\n"
    + "        progress({'item': 'TestX.test_b', 'phase': 'end', 'outcome': 'passed'})\n        self.assertTrue(1)\n",
    "malformed verdict": HEAD
    + "    def test_a(self):\n        from grs_agents.sandbox import progress\n"
    + "        progress({'item': 'TestX.test_a', 'phase': 'end', 'outcome': [], 'x': 1})\n"
    + "        os._exit(0); self.fail()\n",
}


@pytest.mark.parametrize("name", FORGED)
def test_tampering_never_passes(name: str, check: Check) -> None:
    report = check(FORGED[name])
    assert not report.ok, report
    assert report.outcome in ("failed", "error", "crashed")


def test_each_test_is_seeded_alike(check: Check) -> None:
    body = "import random; print(random.random(), np.random.rand()); self.assertTrue(1)"
    report = check(HEAD + f"    def test_a(self): {body}\n    def test_b(self): {body}\n", seed=7)
    assert report.ok
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
    assert report.ok


def test_long_texts_are_cut(check: Check) -> None:
    report = check(HEAD + "    def test_a(self): print('x' * 100000); self.fail('y' * 100000)\n")
    case = report.cases[0]
    assert len(case.output) == 4000
    assert len(case.message) == 1000
    assert len(case.traceback) <= 8000
