"""Tests are probed through the audit: suites without teeth, that gamble, or that test something else, are named."""

from typing import Any

import pytest

from grs_agents.audit.types import AuditFinding
from grs_agents.graph.fix_history import describe_fix_history
from grs_agents.graph.fixing import fix_tests
from grs_agents.graph.judging import audit_task, decide_what_to_fix, run_tests
from grs_agents.graph.state import RunState
from tests.graph.conftest import SIMULATION, TESTS, Make, fenced, run, with_

HEAD = """\
import random
import unittest
from grs_agents.sim import Environment, Task, stacked
import task_code


class TestTask(unittest.TestCase):
    def play(self, task):
        env = Environment()
        env.set_task(task)
        obs = env.reset()
        agent, total = task.oracle(env), 0.0
        for _ in range(task.max_steps):
            act = agent.act(obs, env.info)
            if act is None:
                break
            obs, reward, done, _ = env.step(act)
            total += reward
        return total

"""
REWARD = "    def test_reward(self):\n        self.assertGreater(self.play(task_code.MoveTwoBlocks()), 0.99)\n"
BLIND = HEAD + REWARD
GUTTED = HEAD + "    def test_task(self):\n        self.assertIsNotNone(task_code.MoveTwoBlocks())\n"
GAMBLES = TESTS.replace("import unittest\n", "import random\nimport unittest\n").replace(
    "        task = Move", "        self.assertLess(random.random(), 0.9)\n        task = Move"
)
PATCHES = (
    HEAD
    + """\
    def test_reward(self):
        whole, Environment.step = Environment.step, lambda env, act: ({}, 1.0, True, {})
        try:
            self.assertGreater(self.play(task_code.MoveTwoBlocks()), 0.99)
        finally:
            Environment.step = whole
"""
)
LOOKS = HEAD + REWARD + "        self.assertIsNone(getattr(Environment.witness, 'mutant', None))\n"
COMPUTES = HEAD + REWARD + "        from operator import attrgetter\n        attrgetter('wit' + 'ness')(Environment)\n"
COUNTS = (
    HEAD
    + REWARD
    + """\
        runs = task_code.np.__dict__.setdefault("runs", [])
        runs.append(1)
        self.assertLess(len(runs), 5)
"""
)
COPIES = (
    HEAD
    + """\
    def test_set_up(self):
        task = task_code.MoveTwoBlocks()
        self.assertGreater(self.play(task), 0.99)
        self.assertEqual([goal.targets[0][0] for goal in task.grs.stated], [(0.5, -0.1, 0.02), (0.6, 0.0, 0.02)])
        places = {item.asset: (item.category, item.pose[0]) for item in task.grs.env.objects if item.role == "task"}
        self.assertEqual(sorted(places), ["block/blue_block.urdf", "block/red_block.urdf"])
        self.assertEqual({category for category, _ in places.values()}, {"rigid"})
"""
)
KEEPS = (
    HEAD
    + """\
    def test_reward(self):
        task = task_code.MoveTwoBlocks()
        self.assertGreater(self.play(task), 0.99)
        Environment.mine = getattr(Environment, "mine", repr(task.grs.stated))
        self.assertEqual(Environment.mine, repr(task.grs.stated))
"""
)
OWN_TASK = (
    HEAD.replace(
        "class TestTask",
        """\
class Mine(Task):
    def reset(self, env):
        super().reset(env)
        pair = [env.add_object("block/red_block.urdf", ((0.5, y, 0.02), (0, 0, 0, 1))) for y in (0, 0.2)]
        self.add_goal(stacked(pair), step_max_reward=1)


class TestTask""",
    )
    + "    def test_reward(self):\n        self.assertGreater(self.play(Mine()), 0.99)\n"
)
TWO_FACED = SIMULATION.replace("import numpy as np\n", "import sys\nimport numpy as np\n").replace(
    "(0.6, 0.0))):", '(0.6, 0.05 if "test_task_code" in sys.modules else 0.0))):'
)


def audit(state: RunState, make_services: Make, **changes: Any) -> dict[str, AuditFinding]:
    """The findings on the tests, by check."""
    report = run(audit_task, with_(state, **changes), make_services())["audit"]
    assert report.accepted == all(finding.passed for finding in report.findings)
    about = {one.check: one for one in report.findings if one.check.startswith("tests_")}
    assert about, [one for one in report.findings if not one.passed]
    return about


def test_a_suite_with_teeth_passes(state: RunState, make_services: Make) -> None:
    findings = audit(state, make_services)
    assert all(one.passed for one in findings.values()) and len(findings) == 3, findings
    assert "5 of 5" in findings["tests_repeat"].measured
    assert "8 of 8 mutants" in findings["tests_have_teeth"].measured


def test_a_suite_that_only_looks_at_the_reward_has_no_teeth(state: RunState, make_services: Make) -> None:
    findings = audit(state, make_services, tests=BLIND)
    assert [check for check, one in findings.items() if not one.passed] == ["tests_have_teeth"]
    told = findings["tests_have_teeth"].measured
    assert "nothing asks for block/red_block.urdf #1 any more" in told
    assert "block/red_block.urdf stands where block/blue_block.urdf #2 should" in told


@pytest.mark.parametrize(
    ("changes", "check", "told"),
    [
        ({"tests": GUTTED}, "tests_of_program", "no episode of theirs"),
        ({"tests": GUTTED}, "tests_of_program", "setUpClass"),
        ({"tests": OWN_TASK}, "tests_of_program", "Mine is a Task of their own"),
        ({"tests": PATCHES}, "tests_of_program", "Environment.step was replaced"),
        ({"tests": LOOKS}, "tests_of_program", "witness leads to what runs"),
        ({"tests": COMPUTES}, "tests_of_program", "it imports attrgetter"),
        ({"tests": COUNTS}, "tests_have_teeth", "they pass although"),
        ({"tests": COPIES}, "tests_have_teeth", "they never look where things end"),
        ({"tests": KEEPS}, "tests_repeat", "of 5 times"),
        ({"tests": GAMBLES}, "tests_repeat", "not less than 0.9"),
        ({"simulation": TWO_FACED, "tests": BLIND}, "tests_of_program", "differs from it in: goals"),
    ],
    ids=[
        "gutted",
        "gutted: why",
        "a task of its own",
        "patched while it runs",
        "looks for the probe",
        "computes its name",
        "counts its runs",
        "copies what was set up",
        "keeps what it saw first",
        "a gamble",
        "two faces",
    ],
)
def test_what_a_suite_may_not_do_is_named(
    state: RunState, make_services: Make, changes: Any, check: str, told: str
) -> None:
    finding = audit(state, make_services, **changes)[check]
    assert not finding.passed and told in finding.measured, finding


def test_findings_on_tests_alone_leave_the_tests_to_be_fixed(state: RunState, make_services: Make) -> None:
    services = make_services(fenced("fix_code", ""), fenced(TESTS))
    judged = with_(state, tests=BLIND, **run(run_tests, with_(state, tests=BLIND), services))
    audited = with_(judged, **run(audit_task, judged, services))
    routed = with_(audited, **run(decide_what_to_fix, audited, services))
    assert routed["decision"].verdict == "fix_test"
    fixed = with_(routed, **run(fix_tests, routed, services))
    lines = describe_fix_history(fixed)
    assert any(
        "no longer asserted: assertGreater(self.play(task_code.MoveTwoBlocks()), 0.99)" in line for line in lines
    )
    assert any("asserted instead: assertAlmostEqual(total, 1.0, delta=0.01)" in line for line in lines)
