"""Whether what stands for an object has the size that was measured of it, and is where it was measured."""

from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.library.shapes import rotation_matrix
from grs_agents.scene.surface import corners_of
from grs_agents.scene.types import Aabb

CENTRE, SIZE = 0.02, 0.25
"""The centre may be off by so much (m), each extent by such a share."""


@dataclass(frozen=True)
class Deviation:
    """How far a stand-in is off a measured box: its centre, m, and the extent that is worst, a share of the box's."""

    centre: float
    size: float

    @property
    def agrees(self) -> bool:
        """It is the size of what was measured, and there."""
        return self.centre <= CENTRE and self.size <= SIZE

    def __str__(self) -> str:
        return f"centre {1000 * self.centre:.0f} mm, size {100 * self.size:.0f} % off"


def extent_of(asset: str, pose: Pose, library: Library) -> Aabb:
    """The axis-aligned box, m, around an asset whose bounding box has its centre and rotation (xyzw) at ``pose``.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    corners = corners_of(asset, library).reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    placed = (corners - middle) @ rotation_matrix(pose[1]).T + pose[0]
    low, high = placed.min(axis=0).tolist(), placed.max(axis=0).tolist()
    return Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def deviation(stand_in: Aabb, measured: Aabb) -> Deviation:
    """How far a stand-in is off what was measured, axis by axis."""
    centre = float(np.linalg.norm(np.subtract(stand_in.center, measured.center)))
    return Deviation(centre, float(np.abs(np.divide(stand_in.size, measured.size) - 1).max()))
