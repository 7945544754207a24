"""The environment for LeRobot's EnvHub, with the keys and units of LeRobot data sets."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from grs_agents.tasks.envs.gym_environment import GrsEnv
from grs_agents.tasks.envs.state import AGENT_STATE, TASK_STATE

_SIDES: Final = ("low", "high")


class LeRobotEnv(gymnasium.ObservationWrapper[dict[str, Any], Any, dict[str, Any]]):
    """Observations under the keys that LeRobot renames to those of its data sets.

    * ``pixels``: a picture (H, W, 3) uint8 of each camera, by its name.
    * ``agent_pos`` (dof + 15,): joint positions, suction holding, poses of the tip and of the commanded tip; with
      fingers (dof + 16,), their width after the joints.
    * ``environment_state`` (16 N,): poses of the task's N objects, those of their places, which is held, which open.
    """

    def __init__(self, env: GrsEnv) -> None:
        super().__init__(env)
        self._cameras = env.cameras
        parts: dict[str, Any] = dict(cast(Any, env.observation_space))
        low, high = (
            self._to_lerobot_observation({name: getattr(space, side) for name, space in parts.items()})
            for side in _SIDES
        )
        renamed: dict[str, Any] = {
            name: spaces.Box(low[name], high[name], dtype=np.float32) for name in low if name != "pixels"
        }
        if self._cameras:
            renamed["pixels"] = spaces.Dict({camera: parts[f"{camera}_rgb"] for camera in self._cameras})
        self.observation_space = spaces.Dict(renamed)

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """The observation under LeRobot's keys."""
        return self._to_lerobot_observation(observation)

    def _to_lerobot_observation(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        agent = [name for name in AGENT_STATE if name in observation]
        parts = {"agent_pos": agent, "environment_state": TASK_STATE}
        renamed = {key: np.concatenate([observation[name].ravel() for name in names]) for key, names in parts.items()}
        pixels = {camera: observation[f"{camera}_rgb"] for camera in self._cameras}
        return {**renamed, **({"pixels": pixels} if pixels else {})}


def make_env(
    run: str | Path,
    n_envs: int = 1,
    use_async_envs: bool = False,
    cfg: Any = None,
    **arguments: Any,
) -> dict[str, dict[int, AsyncVectorEnv | SyncVectorEnv]]:
    """Vector environments of a task for LeRobot: ``{task: {0: environments}}``.

    Args:
        run: the folder of the task, as for ``GrsEnv``.
        n_envs: number of environments.
        use_async_envs: run each in a process of its own.
        cfg: LeRobot's ``EnvConfig`` or None; its ``episode_length``, ``camera_name``, ``observation_height`` and
            ``observation_width`` are used.
        arguments: further arguments of ``GrsEnv``.

    Actions are those of our data sets: joint positions, then the hand.
    """
    given: dict[str, Any] = {
        "control": "joint_position",
        "normalized": False,
        "reward": "sparse",
        "render_mode": "rgb_array",
    }
    if (length := getattr(cfg, "episode_length", None)) is not None:
        given["horizon"] = int(length)
    if (names := getattr(cfg, "camera_name", None)) is not None:
        given["cameras"] = tuple(names.split(",")) if isinstance(names, str) else tuple(names)
    height, width = (getattr(cfg, f"observation_{side}", None) for side in ("height", "width"))
    if height and width:
        given["image_size"] = (int(height), int(width))
    given |= arguments

    def make_environment() -> LeRobotEnv:
        return LeRobotEnv(GrsEnv(run, **given))

    envs = [make_environment] * n_envs
    # LeRobot reads an episode's success from ``final_info``, which this mode alone gives.
    kinds = AsyncVectorEnv if use_async_envs else SyncVectorEnv
    vector = kinds(envs, autoreset_mode=AutoresetMode.SAME_STEP)
    return {str(vector.get_attr("task")[0]): {0: vector}}
