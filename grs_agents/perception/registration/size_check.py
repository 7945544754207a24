"""Whether what stands for an object has the size that was measured of it, and is where it was measured."""

from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import rotation_about_z
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.asset_surfaces import asset_triangle_corners
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import Aabb, SceneObject, Solid, UprightBox


@dataclass(frozen=True)
class Deviation:
    """How far an asset is off a measured box: its centre, m, and the extent that is worst, a share of the box's."""

    centre: float
    size: float

    @property
    def is_within_tolerance(self) -> bool:
        """It is the size of what was measured, and there."""
        return self.centre <= DEFAULT.size.center and self.size <= DEFAULT.size.size

    def __str__(self) -> str:
        return f"centre {1000 * self.centre:.0f} mm, size {100 * self.size:.0f} % off"


def deviation_from_measured_box(asset: str, pose: Pose, library: Library, measured: UprightBox) -> Deviation:
    """How far an asset whose bounding box has its centre (m) and rotation (xyzw) at ``pose`` is off a measured box."""
    corners = asset_triangle_corners(asset, library).reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    placed = (corners - middle) @ matrix_from_quaternion(pose[1]).T + pose[0]
    local = (placed - measured.center) @ rotation_about_z(measured.yaw)
    low, high = local.min(axis=0), local.max(axis=0)
    return Deviation(
        float(np.linalg.norm(low + high)) / 2, float(np.abs((high - low) / np.array(measured.size) - 1).max())
    )


def is_match_certain(one: SceneObject) -> bool:
    """Whether its asset is known so well that more of it than was measured may be hidden behind other objects."""
    confidence = None if one.match is None else one.match.confidence
    if not one.matched or one.method != "registered" or confidence is None or one.residual is None:
        return False
    return confidence >= DEFAULT.size.certain and one.residual <= DEFAULT.size.near


def enclosing_aabb(box: UprightBox, shape: Solid) -> Aabb:
    """The axis-aligned box around an upright one, or around the cylinder in it."""
    reach = (np.eye(3) if shape == "cylinder" else np.abs(rotation_about_z(box.yaw))) @ np.array(box.size) / 2
    low, high = (np.array(box.center) - reach).tolist(), (np.array(box.center) + reach).tolist()
    return Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def upright_box_from_aabb(box: Aabb) -> UprightBox:
    """An axis-aligned box as one with a yaw."""
    return UprightBox(center=box.center, size=box.size, yaw=0.0)
