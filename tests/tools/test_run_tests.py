"""A simulation program and its tests, as the paper writes them, through the real sandbox and simulator."""

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
    assert report.ok, report.text()
    assert [case.id for case in report.cases] == ["TestStackBlocks.test_reset", "TestStackBlocks.test_oracle"]
    episode = report.cases[1].episode
    assert (episode["outcome"], episode["reward"]) == ("success", 1.0)
    assert "oracle: outcome=success reward=1.00 steps=1/3" in report.text()


def test_a_program_short_of_its_goal_fails_with_the_oracles_reason(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    broken = simulation.replace("(0.5, 0.1, 0.06)", "(1.5, 0.1, 0.06)")
    report = tool.run(tool.Request(simulation=broken, tests=TESTS), context).report
    assert report.outcome == "failed"
    assert "outcome=unreachable" in report.text()


def test_an_unknown_asset_is_raised_in_the_simulation(context: ToolContext, simulation: str) -> None:
    tool = load_tool("run_tests")
    broken = simulation.replace("red_block", "rad_block")
    report = tool.run(tool.Request(simulation=broken, tests=TESTS), context).report
    assert report.raised_in == "simulation"
    assert "block/red_block.urdf" in report.text()


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
    assert report.ok, report.text()
    drawn = load_tool("instantiate")
    assert len(drawn.run(drawn.Request(simulation=program, seeds=(0,)), context).instances) == 1
