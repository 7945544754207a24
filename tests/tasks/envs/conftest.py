"""Folders of task instances as ``grs instances`` writes them."""

from pathlib import Path

import pytest

from grs_agents.base import Pose
from grs_agents.sim import Goal, InstanceObject, TaskInstance
from grs_agents.sim.instance.task_instance import InstanceCamera

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LOOKING_DOWN = (1.0, 0.0, 0.0, 0.0)
START = ((0.5, -0.1, 0.02), (0.45, -0.15, 0.02), (0.55, -0.2, 0.02))
"""Where the block stands at first, for each seed."""
TARGET: Pose = ((0.5, 0.15, 0.02), UPRIGHT)


def block_instance(seed: int, push: bool = False) -> TaskInstance:
    block = InstanceObject(id=1, asset="block/block.urdf", pose=(START[seed], UPRIGHT))
    goal = Goal(
        objects=(1,),
        matches=((1,),),
        targets=(TARGET,),
        replace=False,
        rotations=False,
        metric="pose",
        max_reward=1.0,
        symmetries=(0.0,),
        language="put the block at the left",
    )
    camera = InstanceCamera(width=64, height=48, fx=60, fy=60, cx=32, cy=24, pose=((0.5, 0.0, 0.8), LOOKING_DOWN))
    return TaskInstance(
        task="PutBlockLeft",
        seed=seed,
        max_steps=2,
        timestep=0.004,
        objects=(block,),
        goals=(goal,),
        camera=camera,
        primitive="push" if push else "pick_place",
        pos_eps=0.03 if push else 0.01,
    )


def write_instances(folder: Path, push: bool = False) -> Path:
    (folder / "instances").mkdir()
    for seed in range(len(START)):
        text = block_instance(seed, push).model_dump_json()
        (folder / "instances" / f"seed_{seed}.json").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block that is to be picked and placed; seeds 0 to 2."""
    return write_instances(tmp_path_factory.mktemp("blocks"))


@pytest.fixture(scope="session")
def pushes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block that is to be pushed."""
    return write_instances(tmp_path_factory.mktemp("pushes"), push=True)
