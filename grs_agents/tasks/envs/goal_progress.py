"""Shaping potential of dense rewards: distances of objects to their goals' places, computed in microseconds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.tasks.envs.task_episode import TaskEpisode

_LEVEL: Final = np.array([1.0, 1.0, 0.0])
_NEARER: Final = 5.0
"""A distance d (m) scores ``1 - tanh(5 d)``: about a half at 10 cm."""
_BROUGHT, _REACHED, _HELD = 0.4, 0.25, 0.25
"""Weights in an object's score: its nearness to its place, the tip's nearness to it, and being held."""


@dataclass(frozen=True)
class ShapingState:
    """Objects against their places."""

    targets: FloatArray  # (N, 7) nearest place of each object, turned by its symmetry; its own pose without any
    open: npt.NDArray[np.bool_]  # (N,) the object has a place and is not there
    scores: FloatArray  # (K,) of the objects with a place: 1 there, less elsewhere
    approached: int = -1  # row of ``scores`` that gains by the tip's nearness; -1 for none
    center: FloatArray | None = None  # (3,) of that object, metres
    top: FloatArray | None = None  # (3,) from its centre to the point approached, metres; None for any height

    def potential(self, tip: FloatArray) -> float:
        """0..1 with the tip at (3,), metres; 1 when all objects are in place."""
        scores = self.scores
        if self.center is not None:
            offset, scores = tip - self.center, scores.copy()
            gap = offset * _LEVEL if self.top is None else offset - self.top
            scores[self.approached] += _REACHED * (1 - float(np.tanh(_NEARER * math.sqrt(gap @ gap))))
        return float(np.add.reduce(scores)) / len(scores)


@dataclass(frozen=True)
class GoalPlace:
    """A place of a goal for an object's centre: a rectangle at a pose, and a tolerance (m)."""

    pose: Pose
    half: tuple[float, float] = (0.0, 0.0)  # half extents of the rectangle, metres
    slack: float = 1e-9
    beside: int | None = None  # id of the object that the rectangle is fixed to, at its centre
    symmetry: float = 2 * math.pi  # turn after which the object looks the same, rad; 0: any turn


def find_goal_places_per_object(episode: TaskEpisode) -> dict[int, list[GoalPlace]]:
    """Places for each object, by its id, in the order of the goals.

    The last goal of an object counts. Goals without a place (``upright``, ``aligned``) have none.
    """
    last: dict[int, list[GoalPlace]] = {}
    for goal in episode.task.grs.stated:
        for index, number in enumerate(goal.objects):
            if places := _places_in_goal(goal, index, episode.sim, episode.task.pos_eps):
                last[number] = places
    return last


def _places_in_goal(goal: Goal, index: int, sim: TabletopSim, pos_eps: float) -> list[GoalPlace]:
    width = min(sim.get_object_size(goal.objects[index])[:2])
    if goal.metric == "pose":
        symmetry, allowed = goal.symmetries[index], goal.allowed_target_indices(index)
        return [GoalPlace(goal.targets[target], slack=pos_eps, symmetry=symmetry) for target in allowed]
    if goal.metric == "zone":
        return [
            GoalPlace(zone.pose, _half_extents_of_free_room((zone.size[0], zone.size[1]), width)) for zone in goal.zones
        ]
    if goal.relation_kind == "stacked":
        return [_place_in_or_on_object(goal.objects[index - 1], width, sim)] if index else []
    if goal.relation_kind in ("aligned", "upright"):
        return []
    number = goal.reference_id
    if goal.relation_kind == "near":
        apart = (goal.required_distance or 0.0) + (width + min(sim.get_object_size(number)[:2])) / 2
        return [GoalPlace(sim.get_object_pose(number), slack=apart, beside=number)]
    return [_place_in_or_on_object(number, width, sim)]


def _place_in_or_on_object(number: int, width: float, sim: TabletopSim) -> GoalPlace:
    """Place in or on an object, for an object of a width (m)."""
    x, y, _ = sim.get_object_size(number)
    return GoalPlace(sim.get_object_pose(number), _half_extents_of_free_room((x, y), width), beside=number)


def _half_extents_of_free_room(size: tuple[float, float], width: float) -> tuple[float, float]:
    """Half extents of the room for the centre of an object of a width (m) in a rectangle, metres."""
    x, y = (max(side - width, side / 4) / 2 for side in size)
    return x, y


class _PlaceTable:
    """Places of K objects, M for each: objects with fewer repeat theirs."""

    def __init__(self, places: Sequence[Sequence[GoalPlace]]) -> None:
        most = max((len(row) for row in places), default=1)
        table = [[row[index % len(row)] for index in range(most)] for row in places]
        shape = (len(table), most)
        poses = [[(*place.pose[0], *place.pose[1]) for place in row] for row in table]
        self.poses: FloatArray = np.array(poses, dtype=np.float64).reshape(*shape, 7)
        yaws = np.array([[transforms.yaw_of_quaternion(place.pose[1]) for place in row] for row in table]).reshape(
            shape
        )
        self._cos, self._sin = np.cos(yaws), np.sin(yaws)
        halves: FloatArray = np.array([[place.half for place in row] for row in table]).reshape(*shape, 2)
        self._half_x, self._half_y = halves[:, :, 0], halves[:, :, 1]
        self._slack: FloatArray = np.array([[place.slack for place in row] for row in table]).reshape(shape)
        self._symmetry: FloatArray = np.array([[place.symmetry for place in row] for row in table]).reshape(shape)
        self._each = np.arange(len(table))

    def find_nearest(self, objects: FloatArray) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Nearest places of objects (K, 7): poses (K, 7), distances (K,) in metres, within tolerance (K,).

        Of the turns by which an object looks the same, a pose has that nearest to the object's.
        """
        away = objects[:, None, :2] - self.poses[:, :, :2]
        x, y = away[:, :, 0], away[:, :, 1]
        out_x = np.maximum(np.abs(self._cos * x + self._sin * y) - self._half_x, 0.0)
        out_y = np.maximum(np.abs(self._cos * y - self._sin * x) - self._half_y, 0.0)
        distance = np.hypot(out_x, out_y)
        nearest = (self._each, distance.argmin(axis=1))
        far: FloatArray = distance[nearest]
        poses = self.poses[nearest]
        x, y, z, w = poses[:, 3:].T
        # The turn from the place to the object about the vertical, then rounded to whole symmetries.
        yaws: FloatArray = 2 * np.arctan2(objects[:, 5] * w - objects[:, 6] * z, objects[:, 6] * w + objects[:, 5] * z)
        yaws = (yaws + np.pi) % (2 * np.pi) - np.pi
        symmetry = self._symmetry[nearest]
        repeats = symmetry > 0
        whole: FloatArray = symmetry * np.round(yaws / np.where(repeats, symmetry, 1.0))
        turns: FloatArray = np.where(repeats, whole, yaws) / 2
        sine, cosine = np.sin(turns), np.cos(turns)
        turned = (x * cosine + y * sine, y * cosine - x * sine, z * cosine + w * sine, w * cosine - z * sine)
        poses[:, 3:] = np.stack(turned, axis=1)
        return poses, far, far <= self._slack[nearest]


class GoalProgress:
    """Progress of an episode's objects, in the order of ``episode.object_ids``."""

    def __init__(self, episode: TaskEpisode) -> None:
        row_of = {number: row for row, number in enumerate(episode.object_ids)}
        places = find_goal_places_per_object(episode)
        self._rows: npt.NDArray[np.intp] = np.array([row_of[number] for number in places], dtype=np.intp)
        self._table = _PlaceTable(list(places.values()))
        beside = [(index, row[0].beside) for index, row in enumerate(places.values())]
        moving = [(index, row_of[number]) for index, number in beside if number is not None]
        self._moving: npt.NDArray[np.intp] = np.array(moving, dtype=np.intp).reshape(-1, 2)
        sizes = [episode.sim.get_object_size(number) for number in episode.object_ids]
        self._tops = np.array([(0.0, 0.0, size[2] / 2) for size in sizes]).reshape(-1, 3)
        self._push = episode.instance.primitive == "push"

    def measure(self, poses: FloatArray, held: int) -> ShapingState:
        """State for objects' poses (N, 7), and the row of the held object, or -1."""
        targets, is_open, rows = poses.copy(), np.zeros(len(poses), dtype=bool), self._rows
        if not len(rows):
            return ShapingState(targets, is_open, np.ones(1))
        if len(self._moving):
            self._table.poses[self._moving[:, 0]] = poses[self._moving[:, 1], None]
        nearest, far, is_there = self._table.find_nearest(poses[rows])
        waits = ~is_there | (rows == held)
        targets[rows], is_open[rows] = nearest, waits
        # An object in place scores 1, others less; the next object gains by the tip's nearness, or by being held.
        scores = np.where(waits, _BROUGHT * (1 - np.tanh(_NEARER * far)), 1.0)
        if not waits.any():
            return ShapingState(targets, is_open, scores)
        carried = np.flatnonzero(rows == held)
        if len(carried):
            scores[carried[0]] += _REACHED + _HELD
            return ShapingState(targets, is_open, scores)
        index = int(waits.argmax())  # the tip approaches the middle of the object's top, or any height if it pushes
        row = rows[index]
        return ShapingState(targets, is_open, scores, index, poses[row, :3], None if self._push else self._tops[row])
