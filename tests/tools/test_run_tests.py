"""A simulation program and its tests, as the paper writes them, through the real sandbox and simulator."""

import pytest

from grs_agents.graph.evidence import render_evidence
from grs_agents.sim import Episode
from grs_agents.toolkit import ToolContext, load_tool

TESTS = """
import os
import unittest
import numpy as np
from grs_agents.sim import Environment
from task_code import StackBlocks

class TestStackBlocks(unittest.TestCase):
    def setUp(self):
        self.task = StackBlocks()
        self.env = Environment("assets", disp=False, shared_memory=False, hz=480, record_cfg=[])
        self.env.set_task(self.task)

    def test_reset(self):
        self.env.reset()
        self.assertEqual(len(self.task.goals), 1)

    def test_oracle(self):
        obs = self.env.reset()
        agent = self.task.oracle(self.env)
        info, total = self.env.info, 0.0
        for _ in range(self.task.max_steps):
            obs, reward, done, info = self.env.step(agent.act(obs, info))
            total += reward
            if done:
                break
        self.assertAlmostEqual(total, 1.0, places=2)
"""


def test_a_good_program_passes_and_its_episode_is_kept(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    report = tool.run(tool.Request(simulation=simulation, tests=TESTS), context).report
    assert report.all_passed, str(report)
    assert [case.id for case in report.cases] == ["TestStackBlocks.test_reset", "TestStackBlocks.test_oracle"]
    episode = report.cases[1].episode
    assert (episode["outcome"], episode["reward"]) == ("success", 1.0)
    assert "published: 1.00  strict: 1.00  steps: 1/3" in render_evidence(report)


def test_a_program_short_of_its_goal_fails_with_the_oracles_reason(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    broken = simulation.replace("(0.5, 0.1, 0.06)", "(1.5, 0.1, 0.06)")
    report = tool.run(tool.Request(simulation=broken, tests=TESTS), context).report
    assert report.outcome == "failed"
    assert "outcome: unreachable" in render_evidence(report)


def test_an_unknown_asset_is_raised_in_the_simulation(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    broken = simulation.replace("red_block", "rad_block")
    report = tool.run(tool.Request(simulation=broken, tests=TESTS), context).report
    assert report.raised_in == "simulation"
    assert "block/red_block.urdf" in render_evidence(report)


def test_the_same_seed_gives_the_same_rewards(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    request = tool.Request(simulation=simulation, tests=TESTS, seed=5)
    first, second = (tool.run(request, context).report for _ in range(2))
    assert [case.episode for case in first.cases] == [case.episode for case in second.cases]


def test_programs_with_the_original_import_lines_run_unchanged(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    original = "from cliport.tasks.task import Task\nfrom cliport.utils import utils\nimport pybullet as p"
    program = simulation.replace("from grs_agents.sim import Task", original)
    tests = TESTS.replace("from grs_agents.sim import", "from cliport.environments.environment import")
    assert program != simulation
    report = tool.run(tool.Request(simulation=program, tests=tests), context).report
    assert report.all_passed, str(report)
    drawn = load_tool("instantiate")
    assert len(drawn.run(drawn.Request(simulation=program, seeds=(0,)), context).instances) == 1


SHARED = """
import unittest
from grs_agents.sim import Environment, run_oracle
from task_code import StackBlocks

class TestShared(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.task = StackBlocks()
        cls.env = Environment(task=cls.task)
        cls.env.reset()
        run_oracle(cls.env, cls.task)

    def test_goals(self):
        for goal in self.task.goals_met(self.env):
            self.assertTrue(goal.met, goal)

    def test_own_run(self):
        env = Environment(task=StackBlocks(), seed=1)
        env.reset()
        self.assertEqual(env.find("block/red_block.urdf"), [2])
        env.step({"pose0": ((0.5, 0.1, 0.04), (0, 0, 0, 1)), "pose1": ((0.5, -0.1, 0.04), (0, 0, 0, 1))})

    def test_goes_on(self):
        (x, y, z), _ = self.env.get_object_pose(self.env.find("block/red_block.urdf")[0])
        self.env.step({"pose0": ((x, y, z + 0.02), (0, 0, 0, 1)), "pose1": ((0.5, -0.2, 0.04), (0, 0, 0, 1))})
        self.assertFalse(self.task.goals_met(self.env)[0].met)
"""


def test_what_a_fixture_ran_is_the_episode_of_tests_that_only_look(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    program = simulation.replace("language_goal", "symmetry=0, language_goal")
    report = tool.run(tool.Request(simulation=program, tests=SHARED), context).report
    goals, own, on = (Episode.model_validate(case.episode) for case in report.cases)
    assert [case.episode_hook for case in report.cases] == ["setUpClass", "test", "test"]
    assert [case.outcome for case in report.cases] == ["passed"] * 3, [case.message for case in report.cases]
    assert (goals.outcome, goals.goals[0].strict, len(goals.actions)) == ("success", 1.0, 1)
    assert goals.goals[0].goal == (
        "pose, within 0.01 m: block/red_block.urdf #2 at (0.500, 0.100, 0.060) turned by 0 degrees"
    )
    assert [(motion.asset, motion.moved) for motion in goals.motions] == [
        ("block/blue_block.urdf", False),
        ("block/red_block.urdf", True),
    ]
    assert goals.warnings == (
        "task.add_goal has no argument symmetry, what was given for it had no effect; symmetries may be meant",
    )
    assert ([action.asset for action in own.actions], own.outcome) == (["block/blue_block.urdf"], "stopped")
    assert (len(on.actions), on.reward, on.strict) == (2, 1.0, 0.0)


GREEDY = {
    "steps": (
        "        try: env.step_simulation(10**9)\n        except Exception: pass\n",
        "simulated_step_limit: the call used up its 500000 simulated steps",
    ),
    "objects": (
        "        try:\n            while True: env.add_object('block/red_block.urdf', base)\n"
        "        except Exception: pass\n",
        "object_limit: 201 objects are on the table, 200 are the most",
    ),
}


@pytest.mark.parametrize("name", GREEDY)
def test_who_catches_the_error_of_a_limit_has_failed_all_the_same(
    name: str, context: ToolContext, simulation: str
) -> None:
    greed, message = GREEDY[name]
    tool = load_tool("run_tests")
    tests = TESTS.replace("self.env.reset()\n", "self.env.reset(settle=False)\n").partition("    def test_oracle")[0]
    report = tool.run(tool.Request(simulation=simulation + greed, tests=tests), context).report
    case = report.cases[0]
    assert (report.all_passed, case.outcome, case.raised_in) == (False, "limit", "simulation"), str(report)
    assert case.message.startswith(message)


def test_a_tests_own_steps_stay_used_up(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    tests = TESTS.partition("    def test_reset")[0] + (
        "    def test_a(self):\n"
        "        self.env.reset(settle=False)\n"
        "        with self.assertRaises(Exception): self.env.step_simulation(10**9)\n"
        "    def test_b(self):\n"
        "        self.env.reset()\n"
        "        self.assertTrue(1)\n"
        "    def test_z(self): self.assertTrue(1)\n"
    )
    report = tool.run(tool.Request(simulation=simulation, tests=tests), context).report
    assert [case.outcome for case in report.cases] == ["limit", "limit", "passed"], str(report)
    assert "SimulationBudgetError" in report.cases[1].traceback


BEFORE_A_WALL = """
import unittest
from grs_agents.sim import Environment
from task_code import StackBlocks

class TestPlaces(unittest.TestCase):
    def test_every_block_starts_before_the_wall(self):
        env = Environment(seed=5)
        env.set_task(StackBlocks())
        for _ in range(5):
            env.reset()
            (x, y, _), _ = env.get_object_pose(env.objects[-1].id)
            self.assertTrue(x < 0.55 and y < 0.3, (x, y))
"""


def test_programs_run_within_the_background(
    context: ToolContext, simulation: str, wall: tuple[tuple[str, ...], str]
) -> None:
    tool = load_tool("run_tests")
    roots, background = wall
    within = tool.Request(simulation=simulation, tests=BEFORE_A_WALL, library_roots=roots, background=background)
    without = tool.Request(simulation=simulation, tests=BEFORE_A_WALL, library_roots=roots)
    report = tool.run(within, context).report
    assert report.all_passed, str(report)
    assert not tool.run(without, context).report.all_passed
