"""Check that the asset of an object has the measured size, at the measured place."""

from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import rotation_about_z, to_vec3
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.asset_surfaces import asset_triangle_corners
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import Aabb, SceneObject, Solid, UprightBox


@dataclass(frozen=True)
class Deviation:
    """Deviation of an asset from a measured box."""

    centre: float  # distance of the centres, m
    size: float  # largest relative deviation of an extent

    @property
    def is_within_tolerance(self) -> bool:
        """Whether size and place agree with the measurement."""
        return self.centre <= DEFAULT.size.center and self.size <= DEFAULT.size.size

    def __str__(self) -> str:
        return f"centre {1000 * self.centre:.0f} mm, size {100 * self.size:.0f} % off"


def deviation_from_measured_box(asset: str, pose: Pose, library: Library, measured: UprightBox) -> Deviation:
    """Deviation of an asset from a measured box.

    ``pose`` is that of the centre of the asset's bounding box (m, xyzw).
    """
    corners = asset_triangle_corners(asset, library).reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    placed = (corners - middle) @ matrix_from_quaternion(pose[1]).T + pose[0]
    local = (placed - measured.center) @ rotation_about_z(measured.yaw)
    low, high = local.min(axis=0), local.max(axis=0)
    return Deviation(
        float(np.linalg.norm(low + high)) / 2, float(np.abs((high - low) / np.array(measured.size) - 1).max())
    )


def is_match_certain(item: SceneObject) -> bool:
    """Whether a match is certain enough that the asset may exceed the measured box, which others may partly hide."""
    confidence = None if item.match is None else item.match.confidence
    if not item.matched or item.method != "registered" or confidence is None or item.residual is None:
        return False
    return confidence >= DEFAULT.size.certain and item.residual <= DEFAULT.size.near


def enclosing_aabb(box: UprightBox, shape: Solid) -> Aabb:
    """The axis-aligned box around an upright box, or around the cylinder in it."""
    reach = (np.eye(3) if shape == "cylinder" else np.abs(rotation_about_z(box.yaw))) @ np.array(box.size) / 2
    return Aabb(low=to_vec3(np.array(box.center) - reach), high=to_vec3(np.array(box.center) + reach))


def upright_box_from_aabb(box: Aabb) -> UprightBox:
    """An axis-aligned box as an upright box without yaw."""
    return UprightBox(center=box.center, size=box.size, yaw=0.0)
