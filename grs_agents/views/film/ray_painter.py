"""A picture of a MuJoCo model made of rays, where there is no graphics library."""

from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.engine import mujoco

_LIGHT = np.array([0.2, -0.3, 0.93])
_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
_SKY = 0.90


def paint(
    model: Any, data: Any, eye: npt.NDArray[np.float64], directions: npt.NDArray[np.float64]
) -> npt.NDArray[np.uint8]:
    """(H, W, 3) colours that rays (H, W, 3) from ``eye`` (m) meet, lit from above."""
    shape, count = directions.shape[:2], directions.shape[0] * directions.shape[1]
    geom, distance, normal = np.full(count, -1, np.int32), np.empty(count), np.empty(3 * count)
    mujoco.mj_multiRay(
        model, data, eye, np.ascontiguousarray(directions).ravel(), _GROUPS, 1, -1, geom, distance, normal, count, 1e10,
    )  # fmt: skip
    hit = geom >= 0
    shade = np.clip(np.abs(normal.reshape(-1, 3) @ _LIGHT), 0.3, 1.0)
    color = np.where(hit[:, None], np.asarray(model.geom_rgba)[geom, :3] * shade[:, None], _SKY)
    return (color * 255).astype(np.uint8).reshape(*shape, 3)
