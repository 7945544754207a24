"""How well an asset at a pose explains what the camera saw of an object: its points, and the air before it."""

from dataclasses import dataclass

import numpy as np

from grs_agents.scene.frame import Array, Mask, RGBDFrame
from grs_agents.scene.points import Tree
from grs_agents.scene.surface import Surface
from grs_agents.scene.table import robot_points_at
from grs_agents.scene.types import TableFrame

SAMPLES = 500
"""So many of an object's points are compared."""
FAR = 0.03
"""What is farther off than this (m) counts as this far: it belongs to another thing."""
AIR = 0.006
"""A surface so far (m) in front of what was measured there stands in the air; depth is not better than that."""
TRIMMED = 0.9
"""The nearest of the points say how good a fit is; the rest are flying pixels."""
AIR_WEIGHT = 0.7


@dataclass(frozen=True)
class Sighting:
    """What the camera saw of one object.

    Attributes:
        points: (N, 3) of its surface, m, robot frame.
        frame, table: the photo and its pose.
    """

    points: Array
    frame: RGBDFrame
    table: TableFrame

    @property
    def eye(self) -> Array:
        """Where the camera is, (3,) m, robot frame."""
        return np.asarray(self.table.T_robot_cam)[:3, 3]


def sighting_of(frame: RGBDFrame, table: TableFrame, mask: Mask) -> Sighting:
    """The points of a mask (H, W), at most `SAMPLES` of them, evenly drawn."""
    rows, columns = np.nonzero(mask & (frame.depth > 0))
    step = max(1, len(rows) // SAMPLES)
    return Sighting(robot_points_at(frame, table, rows[::step], columns[::step]), frame, table)


def residual(surface: Surface, tree: Tree, pose: Array, seen: Sighting) -> float:
    """How far the object's points are off the surface at ``pose`` (4, 4): mean of the nearest 90 %, m."""
    turn, shift = pose[:3, :3], pose[:3, 3]
    local = (seen.points - shift) @ turn
    nearest, squares = tree.nearest(local)
    across = np.abs(np.einsum("ni,ni->n", local - surface.points[nearest], surface.normals[nearest]))
    off = np.where(squares < (2 * surface.spacing) ** 2, across, np.sqrt(squares))
    kept = np.sort(np.minimum(off, FAR))[: max(1, round(TRIMMED * len(off)))]
    return float(kept.mean())


def in_the_air(surface: Surface, pose: Array, seen: Sighting) -> float:
    """How far the surface that faces the camera stands before what was measured, or below the table: mean, m."""
    turn, shift = pose[:3, :3], pose[:3, 3]
    points = surface.points[::2] @ turn.T + shift
    facing = np.einsum("ni,ni->n", surface.normals[::2] @ turn.T, points - seen.eye) < 0
    camera, transform = seen.frame.camera, np.asarray(seen.table.T_robot_cam)
    local = (points[facing] - transform[:3, 3]) @ transform[:3, :3]
    depth = np.maximum(local[:, 2], 1e-3)
    columns = np.rint(local[:, 0] / depth * camera.fx + camera.cx).astype(np.int64)
    rows = np.rint(local[:, 1] / depth * camera.fy + camera.cy).astype(np.int64)
    height, width = seen.frame.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    measured = np.zeros(len(depth))
    measured[inside] = seen.frame.depth[rows[inside], columns[inside]]
    before = np.clip(measured - depth - AIR, 0, FAR)[measured > 0]
    below = np.clip(-points[:, 2] - AIR / 2, 0, FAR)
    return (float(before.mean()) if len(before) else 0.0) + float(below.mean())


def cost(surface: Surface, tree: Tree, pose: Array, seen: Sighting) -> float:
    """The residual, and what stands in the air or below the table, m."""
    return residual(surface, tree, pose, seen) + AIR_WEIGHT * in_the_air(surface, pose, seen)
