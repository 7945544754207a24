"""How high a candidate may be over each part of its box: not into space that the photo shows empty, nor into others."""

from dataclasses import dataclass

import numpy as np

from grs_agents.geometry import rotation_about_z
from grs_agents.perception.proxies.height_blocks import FreeColumns
from grs_agents.perception.proxies.neighbors import Surroundings
from grs_agents.perception.table_finding import BEHIND, pixels_to_robot_frame, project_to_pixels
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame, UprightBox

FREE = 0.01  # where the photo shows something more than this (m) behind a point, it shows the point to be free


def observed_free_points_mask(points: Array, frame: RGBDFrame, table: TableFrame) -> Mask:
    """Which of (N, 3) points, m, robot frame, the photo shows to be free: what it shows there is behind them."""
    x, y, depth = project_to_pixels(points, frame.camera, table)
    columns, rows = np.rint(x), np.rint(y)
    height, width = frame.depth.shape
    seen = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width) & (depth > BEHIND)
    free = np.zeros(len(points), np.bool_)
    free[seen] = frame.depth[rows[seen].astype(np.int64), columns[seen].astype(np.int64)] > depth[seen] + FREE
    return free


CELL = 0.008  # heights are told of cells of at least this size, m
MOST = 16  # there are at most so many along an edge
FEWEST = 3  # fewer points in a cell say nothing
DEEP = 0.005  # what reaches deeper than this (m) into a box stands in it
CLEAR = 0.01  # what is lower than this (m) above the bottom of a box may be what the box stands on


def free_space_map(
    frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox, around: Surroundings | None = None
) -> FreeColumns:
    """What a candidate, (H, W) pixels, may fill of its box, from the bottom of that or from what stands below it.
    It reaches up to where space is shown to be free or another object stands, at least as high as the candidate was
    measured, and 0 where only other objects were."""
    grid = _Grid.from_box(box)
    middles = grid.cell_centers() @ rotation_about_z(box.yaw).T + box.center
    free, level = observed_free_points_mask(middles, frame, table).reshape(grid.counts), box.size[2] / grid.counts[2]
    taken = np.zeros_like(free)
    if around is not None:
        side = float((grid.size / grid.counts)[:2].max())  # what is thinner stands between the middles of two cells
        taken = around.occupied_points_mask(middles, side / 2).reshape(grid.counts)
    free |= taken
    heights = np.where(free.any(axis=2), free.argmax(axis=2), grid.counts[2]) * level
    known = frame.depth > 0
    others = points_in_box_frame(frame, table, _projected_box_mask(frame, table, box) & known & ~mask, box)
    own = grid.column_top_heights(points_in_box_frame(frame, table, mask & known, box))
    heights[grid.column_top_heights(others[others[:, 2] > CLEAR - box.size[2] / 2]) > own] = 0
    below = taken & ((np.arange(grid.counts[2]) + 1) * level < own[..., None])
    floors = np.where(below.any(axis=2), grid.counts[2] - below[..., ::-1].argmax(axis=2), 0) * level
    return FreeColumns(floors, np.maximum(np.maximum(heights, own), floors), np.asarray(taken.any(axis=2), np.bool_))


def is_box_crowded(box: UprightBox, around: Surroundings) -> bool:
    """Whether other objects reach deep into a box."""
    inner = np.array(box.size) - 2 * np.minimum(DEEP, np.array(box.size) / 4)
    middles = _Grid.from_box(box.model_copy(update={"size": tuple(inner)})).cell_centers()
    return int(around.occupied_points_mask(middles @ rotation_about_z(box.yaw).T + box.center).sum()) >= FEWEST


def points_in_box_frame(frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox) -> Array:
    """(N, 3) points of measured pixels, m, about the centre of the box and along its axes."""
    return (pixels_to_robot_frame(frame, table, *np.nonzero(mask)) - box.center) @ rotation_about_z(box.yaw)


@dataclass(frozen=True)
class _Grid:
    """Cells all over a box of a size, m, about its centre and along its axes."""

    counts: tuple[int, int, int]
    size: Array

    @classmethod
    def from_box(cls, box: UprightBox) -> "_Grid":
        x, y, z = (min(max(int(np.ceil(side / CELL)), 1), MOST) for side in box.size)
        return cls((x, y, z), np.array(box.size))

    def cell_centers(self) -> Array:
        """(N, 3) of all cells, the last axis fastest."""
        return np.asarray((np.indices(self.counts).reshape(3, -1).T + 0.5) / self.counts - 0.5, np.float64) * self.size

    def column_top_heights(self, points: Array) -> Array:
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


def _projected_box_mask(frame: RGBDFrame, table: TableFrame, box: UprightBox) -> Mask:
    """The pixels (H, W) of the rectangle in which a box is seen."""
    corners = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * box.size @ rotation_about_z(box.yaw).T + box.center
    columns, rows, _ = project_to_pixels(corners, frame.camera, table)
    window = np.zeros(frame.depth.shape, np.bool_)
    top, left = max(0, int(rows.min())), max(0, int(columns.min()))
    window[top : max(0, int(rows.max()) + 1), left : max(0, int(columns.max()) + 1)] = True
    return window
