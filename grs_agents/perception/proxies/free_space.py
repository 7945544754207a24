"""Where the photo shows that nothing is."""

import numpy as np

from grs_agents.perception.table_finding import BEHIND, project_to_pixels
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

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
