"""Where the photo shows that nothing is."""

import numpy as np

from grs_agents.perception.frame import Array, Mask, RGBDFrame
from grs_agents.perception.table import BEHIND, projected
from grs_agents.perception.types import TableFrame

FREE = 0.01
"""Where the photo shows something more than this (m) behind a point, it shows the point to be free."""


def shown_free(points: Array, frame: RGBDFrame, table: TableFrame) -> Mask:
    """Which of (N, 3) points, m, robot frame, the photo shows to be free: what it shows there is behind them."""
    x, y, depth = projected(points, frame.camera, table)
    columns, rows = np.rint(x), np.rint(y)
    height, width = frame.depth.shape
    seen = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width) & (depth > BEHIND)
    free = np.zeros(len(points), np.bool_)
    pixels = rows[seen].astype(np.int64), columns[seen].astype(np.int64)
    free[seen] = frame.depth[pixels] > depth[seen] + FREE
    return free
