"""How well an asset at a pose explains what the camera saw of an object: its points, and the air before it."""

from dataclasses import dataclass, replace

import numpy as np

from grs_agents.perception.surfaces import Surface, Tree
from grs_agents.perception.table import robot_points_at
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

SAMPLES = 500
"""So many of an object's points, and of the asset's surface, are compared."""
FAR = 0.03
"""What is farther off than this (m) counts as this far: it belongs to another thing."""
AIR = 0.006
"""A surface so far (m) in front of what was measured there stands in the air; depth is not better than that."""
TRIMMED = 0.9
"""The nearest of the points say how good a fit is; the rest are flying pixels."""
AIR_WEIGHT = 0.7


@dataclass(frozen=True)
class ObservedPoints:
    """What the camera saw of one object.

    Attributes:
        points: (N, 3) of its surface, m, robot frame.
        frame, table: the photo and its pose.
        samples: so many points of an asset's surface are held against the photo.
    """

    points: Array
    frame: RGBDFrame
    table: TableFrame
    samples: int = SAMPLES

    @property
    def eye(self) -> Array:
        """Where the camera is, (3,) m, robot frame."""
        return np.asarray(self.table.T_robot_cam)[:3, 3]

    def coarse(self, factor: int) -> "ObservedPoints":
        """The same with one of ``factor`` samples."""
        return replace(self, points=self.points[::factor], samples=self.samples // factor)


def observed_points(frame: RGBDFrame, table: TableFrame, mask: Mask) -> ObservedPoints:
    """The points of a mask (H, W), at most `SAMPLES` of them, evenly drawn."""
    rows, columns = np.nonzero(mask & (frame.depth > 0))
    step = -(-len(rows) // SAMPLES) or 1
    return ObservedPoints(robot_points_at(frame, table, rows[::step], columns[::step]), frame, table)


def residuals(surface: Surface, tree: Tree, poses: Array, seen: ObservedPoints) -> Array:
    """How far the object's points are off the surface at each of ``poses`` (K, 4, 4): mean of the nearest 90 %, m."""
    turns, shifts = poses[:, :3, :3], poses[:, None, :3, 3]
    local = ((seen.points - shifts) @ turns).reshape(-1, 3)
    nearest, squares = tree.nearest(local)
    across = np.abs(np.einsum("ni,ni->n", local - surface.points[nearest], surface.normals[nearest]))
    off = np.minimum(np.where(squares < (2 * surface.spacing) ** 2, across, np.sqrt(squares)), FAR)
    off = off.reshape(len(poses), -1)
    kept = max(1, round(TRIMMED * off.shape[1]))
    return np.partition(off, kept - 1, axis=1)[:, :kept].mean(axis=1)


def free_space_cost(surface: Surface, poses: Array, seen: ObservedPoints) -> Array:
    """How far the surface that faces the camera stands before what was measured, or below the table: means (K,), m."""
    turns = poses[:, :3, :3].transpose(0, 2, 1)
    points = surface.points[: seen.samples] @ turns + poses[:, None, :3, 3]
    facing = ((surface.normals[: seen.samples] @ turns) * (points - seen.eye)).sum(axis=2) < 0
    camera, transform = seen.frame.camera, np.asarray(seen.table.T_robot_cam)
    x, y, z = np.moveaxis((points - transform[:3, 3]) @ transform[:3, :3], 2, 0)
    depth = np.maximum(z, 1e-3)
    height, width = seen.frame.depth.shape
    columns = np.rint(np.clip(x / depth * camera.fx + camera.cx, -1, width)).astype(np.int64)
    rows = np.rint(np.clip(y / depth * camera.fy + camera.cy, -1, height)).astype(np.int64)
    inside = facing & (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    measured = np.where(inside, seen.frame.depth[rows.clip(0, height - 1), columns.clip(0, width - 1)], 0.0)
    known = measured > 0
    before = np.where(known, np.clip(measured - depth - AIR, 0, FAR), 0.0).sum(axis=1)
    below = np.where(facing, np.clip(-points[..., 2] - AIR / 2, 0, FAR), 0.0).sum(axis=1)
    return before / np.maximum(known.sum(axis=1), 1) + below / np.maximum(facing.sum(axis=1), 1)


def costs(surface: Surface, tree: Tree, poses: Array, seen: ObservedPoints) -> Array:
    """The residual, and what stands in the air or below the table, at each of ``poses`` (K, 4, 4): (K,) m."""
    return residuals(surface, tree, poses, seen) + AIR_WEIGHT * free_space_cost(surface, poses, seen)
