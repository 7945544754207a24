"""PPO with stable-baselines3: the tip learns to reach a place over the task's first object.

python -m grs_agents.examples.ppo_reach runs/boxes --steps 20000
"""

import argparse
import time
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO

NEAR = 0.02  # metres
ABOVE = np.array([0.0, 0.0, 0.08], dtype=np.float32)  # from an object's middle to a place over it, metres


class Reach(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Observes the way to the place (3,) and the tip (3,), both in metres; acts by steps along x, y and z."""

    def __init__(self, env: gymnasium.Env[Any, Any], horizon: int = 40) -> None:
        super().__init__(env)
        self.observation_space = spaces.Box(-10, 10, (6,), np.float32)
        self.action_space = spaces.Box(-1, 1, (3,), np.float32)
        self._horizon, self._steps = horizon, 0

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        self._steps = 0
        observation, info = self.env.reset(**arguments)
        return self._look(observation)[0], info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._steps += 1
        observation, _, _, cut_off, info = self.env.step(np.append(action, (0.0, -1.0)))  # no turn, suction off
        seen, distance = self._look(observation)
        reached = distance < NEAR
        info["is_success"] = reached
        return seen, 5.0 * reached - distance, reached, cut_off or self._steps >= self._horizon, info

    def _look(self, observation: dict[str, Any]) -> tuple[Any, float]:
        tip, place = observation["tip"][:3], observation["objects"][0, :3] + ABOVE
        return np.concatenate([5 * (place - tip), tip]).astype(np.float32), float(np.linalg.norm(place - tip))


def success(env: Reach, model: PPO | None, episodes: int) -> float:
    """Share of unseen episodes that reach the place; by random actions without a model."""
    reached = 0
    for seed in range(10_000, 10_000 + episodes):
        observation, info = env.reset(seed=seed)
        ended = False
        while not ended:
            action = model.predict(observation, deterministic=True)[0] if model else env.action_space.sample()
            observation, _, terminated, truncated, info = env.step(action)
            ended = terminated or truncated
        reached += info["is_success"]
    return reached / episodes


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="PPO learns to reach an object.")
    parser.add_argument("run", help="an accepted run")
    parser.add_argument("--steps", type=int, default=20_000)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    task = "grs_agents.envs:GRS-v0"
    env = Reach(gymnasium.make(task, run=arguments.run, control="ee_delta", variation={"jitter": 0.05, "yaw": 0.5}))
    print(f"random actions: {success(env, None, 50):.0%}", flush=True)
    model = PPO("MlpPolicy", env, n_steps=1024, batch_size=256, learning_rate=1e-3, gamma=0.95, device="cpu", seed=0)
    start = time.process_time()
    model.learn(arguments.steps)
    print(f"PPO, {arguments.steps} steps, {time.process_time() - start:.0f} CPU s: {success(env, model, 50):.0%}")
