"""What the rays of a camera meet: the one place where they are cast."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.rendering.stage import Stage

_FARTHEST: Final = 1e10


@dataclass(frozen=True)
class Hits:
    """What N rays meet; the arrays are written again by the next rays of the same ``RayCaster``."""

    geom: npt.NDArray[np.int32]  # (N,) geom id, -1 for nothing
    depth: FloatArray  # (N,) how many times the ray's own length it is away, which for rays of a camera is metres
    normal: FloatArray  # (N, 3) of the surface, unit length


class RayCaster:
    """Casts up to ``most`` rays at once, again and again without new memory."""

    def __init__(self, most: int) -> None:
        self._geom, self._depth, self._normal = np.empty(most, np.int32), np.empty(most), np.empty(3 * most)

    def cast(self, stage: Stage, eye: FloatArray, directions: FloatArray, table: bool = True, arm: bool = True) -> Hits:
        """What rays (N, 3) from ``eye`` (3,), m, meet; they pass through the table and the robot if told to."""
        count = len(directions)
        groups: npt.NDArray[Any] = np.array([table, arm, 1, 0, 0, 0], np.uint8)
        geom, depth, normal = self._geom[:count], self._depth[:count], self._normal[: 3 * count]
        flat = np.ascontiguousarray(directions, np.float64).ravel()
        mujoco.mj_multiRay(stage.model, stage.data, eye, flat, groups, 1, -1, geom, depth, normal, count, _FARTHEST)
        return Hits(geom, depth, normal.reshape(-1, 3))
