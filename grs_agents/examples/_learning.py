"""The parts that the scripts share: an optimisation, and the eye of `closed_loop`.

The eye tells the state of the task from a picture of a camera that stands still and the state of the arm: a linear map
finds objects and their places in the whole picture, a small network looks closer at a patch around each.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
import pyarrow.parquet as pq
import torch
from torch.nn import functional

EVERY, BATCH = 3, 128  # every third frame
POOL, PATCH = 3, 24  # pixels: of the linear map, and side of a patch
NOISE = 0.007  # m, of the centre of a patch in the training: the error of the linear map in scenes that it has not seen
POSE_UNITS = (0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 0.05)  # m, and 0.05 in a quaternion is 6 degrees


def fit(net: torch.nn.Module, loss: Callable[[torch.Tensor], torch.Tensor], count: int, steps: int, batch: int) -> None:
    """Minimise the loss of ``batch`` random rows of ``count``, by AdamW with one cycle of the rate."""
    optimizer = torch.optim.AdamW(net.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 1e-3, total_steps=steps)
    for rows in torch.randint(count, (steps, batch)):
        optimizer.zero_grad()
        loss(rows).backward()
        optimizer.step()
        schedule.step()


class Eye(torch.nn.Module):
    """``observation.environment_state`` (B, 16 N) from pictures (B, H, W, 3) uint8 and ``observation.state`` (B, D).

    Args:
        camera: a camera of the data set's ``grs.json`` that stands still.
        pictures: of the training (T, H, W, 3).
        state: the states with them (T, D).
        task: what is to be learned (T, 16 N).
    """

    def __init__(self, camera: dict[str, Any], pictures: torch.Tensor, state: torch.Tensor, task: torch.Tensor) -> None:
        super().__init__()
        self._name, self._poses = str(camera["name"]), task.shape[1] // 8  # of objects and of their places
        projection = np.array(camera["intrinsics"]) @ np.linalg.inv(camera["pose"])[:3]
        self._projection = torch.tensor(projection, dtype=torch.float32)
        self._background = self._shrink(pictures[::50]).mean(0)
        self._state_mean, self._state_std = state.mean(0), state.std(0) + 1e-3
        self._task_mean, self._task_std = task.mean(0), task.std(0)
        held = state[:, -15] > 0.5  # what is held moves with the tip
        self._free, self._held = (self._regress(pictures[rows], state[rows], task[rows]) for rows in (~held, held))
        objects, places = task[:, : 7 * self._poses].chunk(2, 1)
        self._own = (objects == places).all(0)  # of an object that no goal moves
        inputs = (3 * PATCH**2 + 3) * self._poses + state.shape[1]
        layers = [layer for size in (inputs, 256, 256) for layer in (torch.nn.Linear(size, 256), torch.nn.GELU())]
        self._net = torch.nn.Sequential(*layers, torch.nn.Linear(256, task.shape[1]))

    def _shrink(self, pictures: torch.Tensor) -> torch.Tensor:
        return functional.avg_pool2d(pictures.permute(0, 3, 1, 2).float(), POOL)

    def _normalize(self, state: torch.Tensor) -> torch.Tensor:
        return (state - self._state_mean) / self._state_std

    def _positions(self, task: torch.Tensor) -> torch.Tensor:
        return task[:, : 7 * self._poses].unflatten(1, (-1, 7))[..., :3]

    def _describe(self, pictures: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        """Inputs of the linear maps."""
        small = (self._shrink(pictures) - self._background).flatten(1) / 255
        return torch.cat([small, self._normalize(state), torch.ones(len(state), 1)], 1)

    def _regress(self, pictures: torch.Tensor, state: torch.Tensor, task: torch.Tensor) -> torch.Tensor:
        """A ridge regression of the positions."""
        gram, right = torch.tensor(0.0), torch.tensor(0.0)
        for rows in torch.arange(len(pictures)).split(1000):
            inputs = self._describe(pictures[rows], state[rows])
            gram, right = gram + inputs.T @ inputs, right + inputs.T @ self._positions(task[rows]).flatten(1)
        return torch.cholesky_solve(right, torch.linalg.cholesky(gram + torch.eye(len(gram))))

    def find(self, pictures: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        """Positions (B, 2 N, 3) of objects and places, by the linear maps."""
        inputs, held = self._describe(pictures, state), state[:, -15, None] > 0.5
        return torch.where(held, inputs @ self._held, inputs @ self._free).unflatten(1, (-1, 3))

    def forward(self, pictures: torch.Tensor, state: torch.Tensor, near: torch.Tensor) -> torch.Tensor:
        """The state of the task by patches around the positions ``near`` (B, 2 N, 3)."""
        pixels = functional.pad(near, (0, 1), value=1.0) @ self._projection.T
        steps = torch.arange(PATCH) - (PATCH - 1) / 2
        offsets = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1)
        pixels = (pixels[..., :2] / pixels[..., 2:])[:, :, None, None] + offsets
        grid = 2 * pixels / (torch.tensor(pictures.shape[2:0:-1]) - 1) - 1
        patches = functional.grid_sample(pictures.permute(0, 3, 1, 2).float(), grid.flatten(1, 2), align_corners=True)
        places = (near - self._positions(self._task_mean[None])) / 0.05
        inputs = [(patches / 128 - 1).flatten(1), places.flatten(1), self._normalize(state)]
        outputs = self._net(torch.cat(inputs, 1))
        positions = near + outputs[:, : 3 * self._poses].unflatten(1, (-1, 3)) / 100
        rest = outputs * self._task_std + self._task_mean
        poses = torch.cat([positions, rest[:, : 7 * self._poses].unflatten(1, (-1, 7))[..., 3:]], 2)
        return torch.cat([poses.flatten(1), rest[:, 7 * self._poses :]], 1)

    def look(self, observation: dict[str, Any]) -> npt.NDArray[np.float32]:
        """``environment_state`` (1, 16 N) from the other observations of `make_env`."""
        pictures = torch.from_numpy(observation["pixels"][self._name])
        state = torch.from_numpy(observation["agent_pos"])
        with torch.no_grad():
            task = self(pictures, state, near := self.find(pictures, state))
        task[:, 2 : 7 * self._poses : 7] = near[..., 2]  # heights, which the linear map has without noise
        objects, places, flags = task.tensor_split((7 * self._poses // 2, 7 * self._poses), 1)
        return torch.cat([objects, torch.where(self._own, objects, places), (flags > 0.5).float()], 1).numpy()


def open_eye(data: str, camera: str, steps: int) -> Eye:
    """Train on a LeRobot data set with pictures, by least absolute error."""
    table, card = pq.read_table(f"{data}/data"), json.loads(Path(data, "grs.json").read_text(encoding="utf-8"))
    cameras = {item["name"]: item for item in card["dataset"]["cameras"] if item["frame"] == "robot"}
    if camera not in cameras:
        raise SystemExit(f"{data} has no pictures of {camera}, or it moves; there are {', '.join(cameras) or 'none'}")
    columns = ("observation.state", "observation.environment_state")
    state, task = (torch.tensor(np.stack(table[name].to_numpy()[::EVERY])) for name in columns)
    films = sorted(Path(data).glob(f"videos/observation.images.{camera}/*/*.mp4"))
    frames = (frame for film in films for frame in av.open(str(film)).decode(video=0))
    kept = [frame.to_ndarray(format="rgb24") for number, frame in enumerate(frames) if number % EVERY == 0]
    pictures = torch.tensor(np.stack(kept))
    eye = Eye(cameras[camera], pictures, state, task)
    unit = torch.tensor(POSE_UNITS * (task.shape[1] // 8) + (0.5,) * (task.shape[1] // 8))

    def loss(rows: torch.Tensor) -> torch.Tensor:
        near = eye.find(pictures[rows], state[rows])
        near += NOISE * torch.randn_like(near)
        return ((eye(pictures[rows], state[rows], near) - task[rows]) / unit).abs().mean()

    fit(eye, loss, len(pictures), steps, BATCH)
    return eye
