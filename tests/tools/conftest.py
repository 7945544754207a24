"""One sandbox for the tools, with the simulation imported ahead of time."""

from collections.abc import Iterator

import pytest

from grs_agents.library import Library
from grs_agents.sandbox import Limits, Sandbox
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
    with Sandbox(preload=("grs_agents.sim",)) as sandbox:
        yield ToolContext(sandbox=sandbox, library=Library(), limits=Limits())


@pytest.fixture
def simulation() -> str:
    return SIMULATION
