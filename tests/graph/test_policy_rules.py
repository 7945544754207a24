"""The policy ``rules`` on reports of the real sandbox: programs and tests with one planted fault each."""

from collections.abc import Iterator
from typing import Any, cast

import pytest

from grs_agents.agents.agent import Agents
from grs_agents.agents.types import TaskDefinition
from grs_agents.base.config.schema import Limits
from grs_agents.graph.evidence import render_evidence
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.policies.types import RoutingContext
from grs_agents.library.library import Library
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext, load_tool
from tests.tools.conftest import SIMULATION

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})
TESTS = """
import unittest
from grs_agents.sim import Environment
from task_code import StackBlocks

class TestStackBlocks(unittest.TestCase):
    def setUp(self):
        self.task = StackBlocks()
        self.env = Environment()
        self.env.set_task(self.task)
        self.obs = self.env.reset()

    def test_oracle(self):
        agent, obs, info = self.task.oracle(self.env), self.obs, self.env.info
        total = 0.0
        for _ in range(self.task.max_steps):
            action = agent.act(obs, info)
            if action is None:
                break
            obs, reward, done, info = self.env.step(action)
            total += reward
            if done:
                break
        self.assertAlmostEqual(total, 1.0, places=2)
"""


@pytest.fixture(scope="module")
def sandbox() -> Iterator[ToolContext]:
    with Sandbox(preload=("grs_agents.sim:prepare_process",)) as opened:
        yield ToolContext(sandbox=opened, library=Library(), limits=Limits())


def verdict(context: ToolContext, simulation: str, tests: str) -> tuple[str, Any]:
    """What ``rules`` says of the two programs, and the report it says it of."""
    tool = load_tool("run_tests")
    report = tool.run(tool.Request(simulation=simulation, tests=tests), context).report
    assert not report.all_passed
    given = RoutingContext(TASK, report, render_evidence(report), False, (), cast(Agents, None))  # rules ask no model
    return load_policy("rules").decide(given).verdict, report


@pytest.mark.parametrize(
    ("right", "wrong", "ending"),
    [
        ('"block/red_block.urdf"', '"block/rad_block.urdf"', "error"),
        ("(0.5, 0.1, 0.06)", "(1.5, 0.1, 0.06)", "unreachable"),
    ],
)
def test_the_program_is_to_be_fixed(sandbox: ToolContext, right: str, wrong: str, ending: str) -> None:
    said, report = verdict(sandbox, SIMULATION.replace(right, wrong), TESTS)
    assert report.cases[0].episode["outcome"] == ending
    assert said == "fix_code"


@pytest.mark.parametrize(
    ("right", "wrong", "ending"),
    [
        ("action = agent.act(obs, info)", "action = agent.act(obs, info['camera'])", None),
        ("total += reward", "total += reward['sum']", "success"),
        ("if done:", "if obs.no_such_thing:", "success"),
        ("action = agent.act(obs, info)", "break", None),
        ("total, 1.0, places=2", "total, 3.0, places=2", "success"),
    ],
    ids=["misuse", "error-after-a-step", "error-at-the-end", "oracle-not-asked", "wrong-scale"],
)
def test_the_tests_are_to_be_fixed(sandbox: ToolContext, right: str, wrong: str, ending: str | None) -> None:
    assert right in TESTS
    said, report = verdict(sandbox, SIMULATION, TESTS.replace(right, wrong))
    assert (report.cases[0].episode or {}).get("outcome") == ending
    assert said == "fix_test"
