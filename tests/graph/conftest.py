"""Three blocks on a table, a task with two of them, and the two programs of that task."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from langchain_core.messages import AIMessage
from langgraph.runtime import Runtime

from grs_agents.base.config.schema import AuditConfig, Config
from grs_agents.base.trace.log import read_events
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Node, Services
from grs_agents.graph.state import RunState, parse_state
from grs_agents.sandbox.host.sandbox import Sandbox
from tests.kept_sandbox import written_folder
from tests.scripted import scripted

Blocks = dict[str, tuple[float, float]]
BLOCKS: Blocks = {"red": (0.45, -0.2), "blue": (0.4, 0.1), "green": (0.55, 0.3)}
TASK = {
    "task-name": "move-two-blocks",
    "task-description": "move the red and the blue block",
    "assets-used": ["block/red_block.urdf", "block/blue_block.urdf"],
}
SIMULATION = """\
import numpy as np
from grs_agents.sim import Task


class MoveTwoBlocks(Task):
    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "move the red and the blue block"
        self.task_completed_desc = "done moving blocks."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        flat = (0, 0, 0, 1)
        for color, start, target in (("red", (0.45, -0.2), (0.5, -0.1)), ("blue", (0.4, 0.1), (0.6, 0.0))):
            block = env.add_object(f"block/{color}_block.urdf", ((*start, 0.02), flat))
            self.add_goal([block], np.ones((1, 1)), [((*target, 0.02), flat)], False, False, "pose", None, 0.5,
                          [np.pi / 2], self.lang_template)
"""
TESTS = """\
import unittest
from grs_agents.sim import Environment
from task_code import MoveTwoBlocks


class TestMoveTwoBlocks(unittest.TestCase):
    def test_the_oracle_moves_both_blocks(self):
        task = MoveTwoBlocks()
        env = Environment("assets", disp=False, shared_memory=False, hz=480, record_cfg=[])
        env.set_task(task)
        obs = env.reset()
        self.assertEqual(len(task.goals), 2)
        starts = {item: env.get_object_pose(item)[0] for item in env.obj_ids["rigid"]}
        agent, total = task.oracle(env), 0.0
        for _ in range(task.max_steps):
            act = agent.act(obs, env.info)
            if act is None:
                break
            obs, reward, done, _ = env.step(act)
            total += reward
        self.assertAlmostEqual(total, 1.0, delta=0.01)
        for color, place in (("red", (0.5, -0.1)), ("blue", (0.6, 0.0))):
            self.assertEqual(len(env.find(f"block/{color}_block.urdf")), 1)
            [item] = env.find(f"block/{color}_block.urdf")
            x, y, _ = env.get_object_pose(item)[0]
            self.assertLess(abs(x - place[0]) + abs(y - place[1]), 0.02)
            self.assertGreater(abs(x - starts[item][0]) + abs(y - starts[item][1]), 0.02)
"""
Make = Callable[..., Services]


def block(color: str, number: int) -> dict[str, Any]:
    """One block of the scene, as `scene.json` tells it."""
    x, y = BLOCKS[color]
    return {
        "id": number,
        "name": f"{color}_block_1",
        "asset": f"block/{color}_block.urdf",
        "matched": True,
        "description": f"a {color} block",
        "category": "block",
        "color": color,
        "box": {"low": (x - 0.02, y - 0.02, 0.0), "high": (x + 0.02, y + 0.02, 0.04)},
        "position": (x, y, 0.02),
        "orientation": (0.0, 0.0, 0.0, 1.0),
        "size": (0.04, 0.04, 0.04),
        "reachable": True,
        "evidence": "",
        "mask": "scene/mask.png",
        "crop": "scene/crop.png",
    }


@pytest.fixture
def state(tmp_path: Path) -> RunState:
    """What the state holds once the photo was understood, with a task and the two programs of it."""
    (tmp_path / "scene").mkdir()
    cv2.imwrite(str(tmp_path / "scene" / "annotated.png"), np.full((24, 32, 3), 90, np.uint8))
    frame = {"T_robot_cam": np.eye(4).tolist(), "origin": "calibrated", "residual": 0.0, "inliers": 1.0}
    image = "scene/annotated.png"
    objects = [block(color, number) for number, color in enumerate(BLOCKS, 1)]
    scene: dict[str, Any] = {"source": "s", "image": image, "frame": frame, "objects": objects}
    programs = {"simulation": SIMULATION, "simulation_version": 1, "tests": TESTS, "tests_version": 1}
    begin: dict[str, Any] = {
        "scene_path": "s",
        "max_fixes": 2,
        "fixes": 0,
        "history": [],
        "image": image,
        "scene": scene,
    }
    return parse_state({**begin, "task": TASK, **programs})


@pytest.fixture(scope="session")
def sandbox() -> Iterator[Sandbox]:
    """One sandbox for the nodes, with the simulation imported ahead of time."""
    with Sandbox(preload=("grs_agents.sim:prepare_process",), readable=(written_folder(),)) as running:
        yield running


@pytest.fixture
def make_services(tmp_path: Path, sandbox: Sandbox) -> Make:
    """Makes the services of a run in ``tmp_path`` whose models give the replies, and whose audit solves one seed."""

    def make(*replies: str | AIMessage | Exception, policy: str = "llm", **settings: Any) -> Services:
        config = Config(policy=policy, audit=AuditConfig(seeds=1), **settings)
        agents = scripted(tmp_path, replies, config)
        return Services(config, agents.log, agents, load_policy(policy), sandbox, tmp_path)

    return make


def fenced(text: str, language: str = "python") -> str:
    """A reply that holds a program."""
    return f"Here it is.\n```{language}\n{text}\n```"


def with_(state: RunState, **changes: Any) -> RunState:
    """The state with other fields, which may be plain JSON; those that become ``...`` are left out."""
    return parse_state({key: value for key, value in {**state, **changes}.items() if value is not ...})


def run(node: Node, state: RunState, services: Services) -> dict[str, Any]:
    """One visit of a node."""
    return node(state, runtime=Runtime(context=services))


def kinds(services: Services, kind: str) -> list[Any]:
    """The events of one kind in the log."""
    return [event for event in read_events(services.log.path) if event.kind == kind]
