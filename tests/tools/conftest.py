"""One sandbox for the tools, with the simulation imported ahead of time."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.config.schema import Limits
from grs_agents.library.background_asset import write_background_asset
from grs_agents.library.library import Library
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext

SIMULATION = """
import numpy as np
from grs_agents.sim import Task

class StackBlocks(Task):
    def __init__(self):
        super().__init__()
        self.max_steps = 3
        self.lang_template = "put the red block on the blue block"
        self.task_completed_desc = "done stacking."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        base = ((0.5, 0.1, 0.02), (0, 0, 0, 1))
        env.add_object("block/blue_block.urdf", base)
        red_pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
        red = env.add_object("block/red_block.urdf", red_pose)
        self.add_goal(objs=[red], matches=np.ones((1, 1)), targ_poses=[((0.5, 0.1, 0.06), (0, 0, 0, 1))],
                      replace=False, rotations=False, metric='pose', params=None, step_max_reward=1.0,
                      symmetries=[np.pi / 2], language_goal=self.lang_template)
"""


@pytest.fixture(scope="session")
def context() -> Iterator[ToolContext]:
    with Sandbox(preload=("grs_agents.sim:prepare_process",)) as sandbox:
        yield ToolContext(sandbox=sandbox, library=Library(), limits=Limits())


@pytest.fixture
def wall(tmp_path: Path) -> tuple[tuple[str, ...], str]:
    """Asset folders, and a background: a wall that fills the table beyond x = 0.55 m and 0.3 m to the left."""
    corners = np.array([[0.55, -1.0, 0.0], [0.55, 0.3, 0.0], [0.55, 0.3, 0.4], [0.55, -1.0, 0.4]])
    boxes = np.array([[[0.55, -1.0, 0.0], [1.2, 1.0, 0.4]], [[0.0, 0.3, 0.0], [1.2, 1.0, 0.4]]])
    name = write_background_asset(tmp_path, corners, np.array([[0, 1, 2], [0, 2, 3]]), boxes, (0.5, 0.5, 0.5))
    return (*(str(root) for root in Library().roots), str(tmp_path)), name


@pytest.fixture
def simulation() -> str:
    return SIMULATION
