"""The oracle for ropes: which bead to take to its place, so that the others come along as near to theirs as can be."""

from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.goals.scene_view import SceneView
from grs_agents.sim.instance.goal import Goal

FloatArray = npt.NDArray[np.float64]
_SAMPLES: Final = 24
_MISS: Final = 0.02
"""What a bead out of tolerance costs besides its distance, metres."""


def chain(goal: Goal, view: SceneView) -> bool:
    """Whether the objects of a goal are tied in a row, in their order, and each has a place of its own."""
    if goal.metric != "pose" or len(goal.objs) < 3 or len(goal.targ_poses) != len(goal.objs):
        return False
    tied = {frozenset((tie.parent, tie.child)) for tie in view.ties}
    return all(frozenset(pair) in tied for pair in zip(goal.objs, goal.objs[1:], strict=False)) and bool(_ways(goal))


def _ways(goal: Goal) -> list[FloatArray]:
    """Targets (N, 2) in the order of the beads: from either end, as far as the goal allows."""
    targets, count = np.array([pose[0][:2] for pose in goal.targ_poses]), len(goal.objs)
    orders = (np.arange(count), np.arange(count)[::-1])
    return [targets[order] for order in orders if goal.matches[np.arange(count), order].all()]


class RopePlanner:
    """Remembers from which end each rope is to be laid.

    A rope is taken for a chain of rods on a rough table: what is not held follows the bead before it.
    """

    def __init__(self) -> None:
        self._chosen: dict[tuple[int, ...], FloatArray] = {}

    def ranked(self, goal: Goal, view: SceneView, pos_eps: float) -> list[tuple[int, FloatArray]]:
        """Rows of beads to take and where to (2,), metres, the most useful first; empty: all are in place."""
        beads = np.array([view.pose(number)[0][:2] for number in goal.objs])
        key = tuple(goal.objs)
        if key not in self._chosen:
            ways = _ways(goal)
            self._chosen[key] = min(ways, key=lambda way: float(np.linalg.norm(way - beads, axis=1).sum()))
        wanted = self._chosen[key]
        now = _cost(beads, wanted, pos_eps)
        after = np.array([_cost(dragged(beads, row, wanted[row]), wanted, pos_eps) for row in range(len(beads))])
        off = np.linalg.norm(wanted - beads, axis=1)
        order = sorted(range(len(beads)), key=lambda row: (after[row] > now, round(float(after[row]), 4), -off[row]))
        return [(row, wanted[row]) for row in order if off[row] > 0.3 * pos_eps]


def dragged(beads: FloatArray, row: int, target: FloatArray) -> FloatArray:
    """Where beads (N, 2) come to lie when one of them is brought straight to a target (2,), metres."""
    points = beads.copy()
    lengths = np.linalg.norm(np.diff(beads, axis=0), axis=1)
    for share in np.linspace(0.0, 1.0, _SAMPLES)[1:]:
        points[row] = beads[row] + share * (target - beads[row])
        for index in range(row + 1, len(points)):
            points[index] = _follow(points[index], points[index - 1], lengths[index - 1])
        for index in range(row - 1, -1, -1):
            points[index] = _follow(points[index], points[index + 1], lengths[index])
    return points


def _follow(point: FloatArray, leader: FloatArray, length: float) -> FloatArray:
    x, y = point[0] - leader[0], point[1] - leader[1]
    scale = length / max(float((x * x + y * y) ** 0.5), 1e-9)
    return np.array([leader[0] + scale * x, leader[1] + scale * y])


def _cost(beads: FloatArray, wanted: FloatArray, pos_eps: float) -> float:
    off = np.linalg.norm(beads - wanted, axis=1)
    return float((off + _MISS * np.clip(off / (0.7 * pos_eps) - 0.4, 0.0, 1.0)).sum())
