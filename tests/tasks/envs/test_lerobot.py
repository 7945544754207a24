"""What LeRobot finds when it makes an environment."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium")

from grs_agents.envs import make_env


@pytest.mark.parametrize("in_processes", [False, True])
def test_lerobot_finds_its_keys_its_units_and_the_success_of_each_episode(blocks, in_processes) -> None:
    cfg = SimpleNamespace(episode_length=2, camera_name="front,wrist", observation_height=24, observation_width=32)
    made = make_env(blocks, n_envs=2, use_async_envs=in_processes, cfg=cfg, renderer="rays")
    assert list(made) == ["PutBlockLeft"]
    envs: Any = made["PutBlockLeft"][0]
    observation, _ = envs.reset(seed=[0, 1], options={"lerobot_new_rollout": True})
    assert {name: picture.shape for name, picture in observation["pixels"].items()} == {
        "front": (2, 24, 32, 3),
        "wrist": (2, 24, 32, 3),
    }
    assert observation["agent_pos"].shape == (2, 21)
    assert observation["environment_state"].shape == (2, 16)
    assert envs.call("task_description") == ("put the block at the left",) * 2
    assert envs.call("_max_episode_steps") == (2, 2)
    assert envs.metadata["render_fps"] == 25
    stay = np.concatenate([observation["agent_pos"][:, :6], -np.ones((2, 1))], axis=1, dtype=np.float32)
    envs.step(stay)
    _, _, _, truncated, info = envs.step(stay)
    assert truncated.all()
    assert info["final_info"]["is_success"].tolist() == [False, False]
    envs.close()
