"""Where the photo shows that nothing is."""

import numpy as np

from grs_agents.scene.frame import Array, Mask, RGBDFrame
from grs_agents.scene.types import TableFrame

FREE = 0.01
"""Where the photo shows something more than this (m) behind a point, it shows the point to be free."""


def shown_free(points: Array, frame: RGBDFrame, table: TableFrame) -> Mask:
    """Which of (N, 3) points, m, robot frame, the photo shows to be free: what it shows there is behind them."""
    transform, camera = np.asarray(table.T_robot_cam), frame.camera
    x, y, z = ((points - transform[:3, 3]) @ transform[:3, :3]).T
    depth = np.maximum(z, 1e-3)
    columns = np.rint(x / depth * camera.fx + camera.cx).astype(np.int64)
    rows = np.rint(y / depth * camera.fy + camera.cy).astype(np.int64)
    seen = (rows >= 0) & (rows < frame.depth.shape[0]) & (columns >= 0) & (columns < frame.depth.shape[1]) & (z > 0)
    free = np.zeros(len(points), np.bool_)
    free[seen] = frame.depth[rows[seen], columns[seen]] > depth[seen] + FREE
    return free
