"""A small network with torch that moves the tip at 25 Hz, by chunks of actions, learned from noisy replays.

grs demos runs/boxes --control ee_delta --episodes 200 --replays 3 --camera none
python -m grs_agents.examples.closed_loop runs/boxes --steps 36000 --episodes 50
python -m grs_agents.examples.closed_loop runs/boxes --camera front    # demonstrations with pictures, see the docs
"""

import argparse
import time
from operator import itemgetter
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import torch

from grs_agents.envs import make_env
from grs_agents.examples._learning import fit, open_eye
from grs_agents.tasks.suites.statistics import wilson_interval

CHUNK, TAKEN, BATCH, WIDTH = 16, 8, 256, 256
VARIATION, SIZE = {"jitter": 0.03, "yaw": 0.5236}, (96, 96)  # m, rad; pixels
COLUMNS = ("observation.state", "observation.environment_state", "action")


def see(state: Any, task: Any) -> torch.Tensor:
    """Inputs (T, F) from ``observation.state`` (T, dof + 15) and ``observation.environment_state`` (T, 16 N)."""
    rows, count = len(task), task.shape[1] // 16
    suction, tip, sent = np.split(state[:, -15:], (1, 8), axis=1)
    poses = np.concatenate([sent, task[:, : 14 * count]], axis=1).reshape(rows, -1, 7)  # of tip, objects, places
    yaws, here = 2 * np.arctan2(poses[:, :, 5], poses[:, :, 6]), poses[:, :1, :3]
    ways = np.concatenate([poses[:, 1:, :3] - here, poses[:, 1 + count :, :3] - poses[:, 1 : 1 + count, :3]], axis=1)
    parts = [suction, here[:, 0], tip[:, :3] - here[:, 0], np.cos(yaws), np.sin(yaws), task[:, 14 * count :]]
    return torch.tensor(np.concatenate([*parts, ways.reshape(rows, -1)], axis=1, dtype=np.float32))


def train(data: str, steps: int) -> torch.nn.Module:
    """A policy from inputs (T, F) to chunks (T, CHUNK, 5), of least absolute error on a LeRobot data set."""
    table = pq.read_table(f"{data}/data")
    state, task, actions = (np.stack(table[name].to_numpy()) for name in COLUMNS)
    last = np.searchsorted(table["episode_index"], table["episode_index"], side="right") - 1
    ahead = np.minimum(np.arange(len(actions))[:, None] + np.arange(CHUNK), last[:, None])  # the last is repeated
    x, y = see(state, task), torch.tensor(actions[ahead])
    norm = torch.nn.BatchNorm1d(x.shape[1], eps=1e-6, affine=False).eval()  # keeps the data's statistics
    norm.running_mean, norm.running_var, unit = x.mean(0), x.var(0), y.std((0, 1)).clamp(min=1e-3)
    layers = [layer for size in (x.shape[1], WIDTH, WIDTH) for layer in (torch.nn.Linear(size, WIDTH), torch.nn.GELU())]
    net = torch.nn.Sequential(norm, *layers, torch.nn.Linear(WIDTH, y[0].numel()), torch.nn.Unflatten(1, y.shape[1:]))

    def loss(rows: torch.Tensor) -> torch.Tensor:
        return ((net(x[rows]) - y[rows]) / unit).abs().mean()

    fit(net, loss, len(x), steps, BATCH)
    return net


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Behaviour cloning at 25 Hz.")
    parser.add_argument("run", help="an accepted run; its demonstrations lie in RUN-demos")
    for name, default in (("camera", ""), ("steps", 36_000), ("looks", 4_000), ("episodes", 50), ("seed", 0)):
        parser.add_argument(f"--{name}", type=type(default), default=default)
    given = parser.parse_args()
    torch.manual_seed(given.seed)
    torch.set_num_threads(1)
    policy, solved = train(data := f"{given.run.rstrip('/')}-demos", given.steps), 0
    cameras = (given.camera,) if given.camera else ()
    look = open_eye(data, given.camera, given.looks).look if given.camera else itemgetter("environment_state")
    env = make_env(given.run, control="ee_delta", variation=VARIATION, cameras=cameras, image_size=SIZE).popitem()[1][0]
    for seed in range(10_000, 10_000 + given.episodes):
        now, info, chunk = env.reset(seed=seed)[0], {}, []
        while "final_info" not in info:
            chunk = chunk or list(policy(see(now["agent_pos"], look(now))).detach().numpy()[0, :TAKEN])
            now, *_, info = env.step(chunk.pop(0)[None])
        solved += int(info["final_info"]["is_success"][0])
    rate, minutes = wilson_interval(solved, given.episodes), time.process_time() / 60
    print(f"solved {solved} of {rate.count} ({rate.low:.0%} to {rate.high:.0%}), {minutes:.1f} CPU minutes in all")
