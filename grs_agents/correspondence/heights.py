"""How high a candidate may be over each part of its box: not into air that the photo shows, nor where others are."""

from dataclasses import dataclass

import numpy as np

from grs_agents.scene import Mask, RGBDFrame, TableFrame, UprightBox, shown_free
from grs_agents.scene.frame import Array
from grs_agents.scene.table import projected, robot_points_at
from grs_agents.scene.turning import about_z

CELL = 0.008
"""Heights are told of cells of at least this size, m."""
MOST = 16
"""There are at most so many along an edge."""
FEWEST = 3
"""Fewer points in a cell say nothing."""
CLEAR = 0.01
"""What is lower than this (m) above the bottom of a box may be what the box stands on."""


def heights_of(frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox) -> Array:
    """(R, C) m above the bottom of a candidate's box, of cells spread evenly over its x (rows) and y (columns).

    Up to where the air is shown to be free, at least as high as the candidate was measured, and 0 where only other
    things were.

    Args:
        frame, table: the photo and its pose.
        mask: (H, W) pixels of the candidate.
        box: measured of it.
    """
    grid = _Grid.over(box)
    free = shown_free(grid.middles() @ about_z(box.yaw).T + box.center, frame, table).reshape(grid.counts)
    level = box.size[2] / grid.counts[2]
    heights = np.where(free.any(axis=2), free.argmax(axis=2), grid.counts[2]) * level
    known = frame.depth > 0
    others = local_points(frame, table, _window(frame, table, box) & known & ~mask, box)
    own = grid.tops(local_points(frame, table, mask & known, box))
    heights[grid.tops(others[others[:, 2] > CLEAR - box.size[2] / 2]) > own] = 0
    return np.asarray(np.maximum(heights, own), np.float64)


def local_points(frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox) -> Array:
    """(N, 3) points of measured pixels, m, about the centre of the box and along its axes."""
    return (robot_points_at(frame, table, *np.nonzero(mask)) - box.center) @ about_z(box.yaw)


@dataclass(frozen=True)
class _Grid:
    """Cells all over a box of a size, m, about its centre and along its axes."""

    counts: tuple[int, int, int]
    size: Array

    @classmethod
    def over(cls, box: UprightBox) -> "_Grid":
        x, y, z = (min(max(int(np.ceil(side / CELL)), 1), MOST) for side in box.size)
        return cls((x, y, z), np.array(box.size))

    def middles(self) -> Array:
        """(N, 3) of all cells, the last axis fastest."""
        return np.asarray((np.indices(self.counts).reshape(3, -1).T + 0.5) / self.counts - 0.5, np.float64) * self.size

    def tops(self, points: Array) -> Array:
        """(R, C) how high above the bottom (N, 3) points reach over each cell, m; 0 where there are too few."""
        columns = self.counts[0] * self.counts[1]
        cells = np.floor((points / self.size + 0.5) * self.counts).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.counts)).all(axis=1)
        index = cells[inside, 0] * self.counts[1] + cells[inside, 1]
        heights = points[inside, 2] + self.size[2] / 2
        order = np.lexsort((-heights, index))
        counted = np.bincount(index, minlength=columns)
        first = np.cumsum(counted) - counted
        tops, enough = np.zeros(columns), counted >= FEWEST
        tops[enough] = heights[order][first[enough] + FEWEST - 1]  # the highest but for those that fly
        return tops.reshape(self.counts[:2])


def _window(frame: RGBDFrame, table: TableFrame, box: UprightBox) -> Mask:
    """The pixels (H, W) of the rectangle in which a box is seen."""
    corners = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * box.size @ about_z(box.yaw).T + box.center
    columns, rows, _ = projected(corners, frame.camera, table)
    window = np.zeros(frame.depth.shape, np.bool_)
    top, left = max(0, int(rows.min())), max(0, int(columns.min()))
    window[top : max(0, int(rows.max()) + 1), left : max(0, int(columns.max()) + 1)] = True
    return window
