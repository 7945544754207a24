"""Few solid boxes around many points of a surface: MuJoCo takes a mesh for its convex hull, which would fill a room."""

from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.perception.frame import Array

MOST: Final = 200
"""Boxes; of more the cells are made larger."""
THICKNESS: Final = 0.01
"""A box is at least this thick (m)."""
_Cells = npt.NDArray[np.int32]


def boxes_around(points: Array, cell: float) -> Array:
    """(B, 2, 3) lowest and highest corners (m) of at most `MOST` boxes that hold all (N, 3) ``points``.

    Space is cut into cells; cells with points are joined to the largest blocks that are full, and each block is shrunk
    to its points, so that a wall along an axis is as thin as it was measured.

    Args:
        points: metres.
        cell: edge of a cell, metres; larger where there would be too many boxes.
    """
    if not len(points):
        return np.zeros((0, 2, 3))
    while True:
        index = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
        blocks = _blocks(index)
        if blocks.max() <= MOST:
            break
        cell *= 1.25
    owner = blocks[index[:, 0], index[:, 1], index[:, 2]] - 1
    low, high = np.full((owner.max() + 1, 3), np.inf), np.full((owner.max() + 1, 3), -np.inf)
    np.minimum.at(low, owner, points)
    np.maximum.at(high, owner, points)
    thin = np.maximum(THICKNESS - (high - low), 0) / 2
    return np.stack([low - thin, high + thin], axis=1)


def _blocks(index: npt.NDArray[np.int64]) -> _Cells:
    """A grid with the number, from 1, of the block that each full cell of (N, 3) ``index`` belongs to."""
    free = np.zeros(index.max(axis=0) + 1, np.bool_)
    free[index[:, 0], index[:, 1], index[:, 2]] = True
    numbers = np.zeros(free.shape, np.int32)
    number = 0
    for start in np.argwhere(free):
        if not free[tuple(start)]:
            continue
        end = start + 1
        for axis in np.argsort([-_run(free, start, axis) for axis in range(3)]):
            end = _grown(free, start, end, int(axis))
        number += 1
        block = tuple(slice(first, last) for first, last in zip(start, end, strict=True))
        free[block], numbers[block] = False, number
    return numbers


def _run(free: npt.NDArray[np.bool_], start: npt.NDArray[np.int64], axis: int) -> int:
    """How many full cells follow on each other along an axis."""
    along = tuple(slice(int(start[at]), None) if at == axis else int(start[at]) for at in range(3))
    line = free[along]
    return int(line.argmin()) if not line.all() else len(line)


def _grown(
    free: npt.NDArray[np.bool_], start: npt.NDArray[np.int64], end: npt.NDArray[np.int64], axis: int
) -> npt.NDArray[np.int64]:
    """The end of the block from ``start``, moved on along an axis for as long as all its cells are full."""
    end = end.copy()
    while end[axis] < free.shape[axis]:
        layer = tuple(
            slice(int(end[at]), int(end[at]) + 1) if at == axis else slice(int(start[at]), int(end[at]))
            for at in range(3)
        )
        if not free[layer].all():
            break
        end[axis] += 1
    return end
