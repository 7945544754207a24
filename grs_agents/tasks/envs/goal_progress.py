"""How near a task is to being solved, told in microseconds: for dense rewards, not for scores."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.tasks.envs.goal_places import Place, find_goal_places_per_object
from grs_agents.tasks.envs.task_episode import TaskEpisode

_LEVEL: Final = np.array([1.0, 1.0, 0.0])
_NEARER: Final = 5.0
"""Distances count as ``1 - tanh(5 d)``, d in metres: 10 cm away is half of the way."""
_BROUGHT, _REACHED, _HELD = 0.4, 0.25, 0.25
"""What of an object's share is for its nearness to its place, the tip's nearness to it, and that it is held."""


@dataclass(frozen=True)
class Progress:
    """Where the objects are against their places."""

    targets: FloatArray  # (N, 7) the nearest place of each object, its own pose if it has none
    open: npt.NDArray[np.bool_]  # (N,) it has a place and is not there
    potential: float  # 0..1, higher is nearer to done


class _PlaceTable:
    """The places of K objects, as many (M) for each: those of objects that have fewer are repeated."""

    def __init__(self, places: Sequence[Sequence[Place]]) -> None:
        most = max((len(row) for row in places), default=1)
        table = [[row[index % len(row)] for index in range(most)] for row in places]
        shape = (len(table), most)
        poses = [[(*one.pose[0], *one.pose[1]) for one in row] for row in table]
        self.poses: FloatArray = np.array(poses, dtype=np.float64).reshape(*shape, 7)
        yaws = np.array([[transforms.yaw_of_quaternion(one.pose[1]) for one in row] for row in table]).reshape(shape)
        self._cos, self._sin = np.cos(yaws), np.sin(yaws)
        halves: FloatArray = np.array([[one.half for one in row] for row in table]).reshape(*shape, 2)
        self._half_x, self._half_y = halves[:, :, 0], halves[:, :, 1]
        self._slack: FloatArray = np.array([[one.slack for one in row] for row in table]).reshape(shape)
        self._each = np.arange(len(table))

    def find_nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """For objects at (K, 2): the poses (K, 7) of their nearest places, how far (K,) those are (m), and whether that
        is near enough (K,)."""
        away = points[:, None] - self.poses[:, :, :2]
        x, y = away[:, :, 0], away[:, :, 1]
        out_x = np.maximum(np.abs(self._cos * x + self._sin * y) - self._half_x, 0.0)
        out_y = np.maximum(np.abs(self._cos * y - self._sin * x) - self._half_y, 0.0)
        distance = np.hypot(out_x, out_y)
        nearest = (self._each, distance.argmin(axis=1))
        far: FloatArray = distance[nearest]
        return self.poses[nearest], far, far <= self._slack[nearest]


class GoalProgress:
    """Watches the objects of one episode, in the order of ``episode.object_ids``."""

    def __init__(self, episode: TaskEpisode) -> None:
        row_of = {number: row for row, number in enumerate(episode.object_ids)}
        places = find_goal_places_per_object(episode)
        self._rows: npt.NDArray[np.intp] = np.array([row_of[number] for number in places], dtype=np.intp)
        self._table = _PlaceTable(list(places.values()))
        beside = [(index, one[0].beside) for index, one in enumerate(places.values())]
        moving = [(index, row_of[number]) for index, number in beside if number is not None]
        self._moving: npt.NDArray[np.intp] = np.array(moving, dtype=np.intp).reshape(-1, 2)
        sizes = [episode.env.get_object_size(number) for number in episode.object_ids]
        self._tops = np.array([(0.0, 0.0, size[2] / 2) for size in sizes]).reshape(-1, 3)
        self._push = episode.instance.primitive == "push"

    def measure(self, poses: FloatArray, tip: FloatArray, held: int) -> Progress:
        """How the objects stand: their poses (N, 7), the tip (3,), and the row of what is held, or -1."""
        targets, is_open, rows = poses.copy(), np.zeros(len(poses), dtype=bool), self._rows
        if not len(rows):
            return Progress(targets, is_open, 1.0)
        if len(self._moving):
            self._table.poses[self._moving[:, 0]] = poses[self._moving[:, 1], None]
        nearest, far, is_there = self._table.find_nearest(poses[rows, :2])
        waits = ~is_there | (rows == held)
        targets[rows], is_open[rows] = nearest, waits
        return Progress(targets, is_open, self._compute_shaping_potential(poses, tip, held, far, waits))

    def _compute_shaping_potential(
        self, poses: FloatArray, tip: FloatArray, held: int, far: FloatArray, waits: npt.NDArray[np.bool_]
    ) -> float:
        """The mean over the objects: 1 for those in place, less for the others, more for the one that is next."""
        scores = np.where(waits, _BROUGHT * (1 - np.tanh(_NEARER * far)), 1.0)
        if waits.any():
            carried = np.flatnonzero(self._rows == held)
            index = int(carried[0]) if len(carried) else int(waits.argmax())
            scores[index] += (
                _REACHED + _HELD if len(carried) else self._approach_score(poses[self._rows[index]], index, tip)
            )
        return float(scores.mean())

    def _approach_score(self, pose: FloatArray, index: int, tip: FloatArray) -> float:
        """For how near the tip is to an object: to the middle of its top, or where it pushes from above."""
        gap = (tip - pose[:3]) * _LEVEL if self._push else tip - pose[:3] - self._tops[self._rows[index]]
        return _REACHED * (1 - float(np.tanh(_NEARER * np.linalg.norm(gap))))
