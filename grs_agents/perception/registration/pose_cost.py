"""How well an asset at a pose explains what the camera saw of an object: its points, and the free space before it."""

from dataclasses import dataclass, replace

import numpy as np

from grs_agents.perception.asset_surfaces import Surface, Tree
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import pixels_in_mask
from grs_agents.perception.table_finding import measured_depth_at_points, pixels_to_robot_frame
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

CONFIG = DEFAULT.registration.cost


@dataclass(frozen=True)
class ObservedPoints:
    """What the camera saw of one object."""

    points: Array  # (N, 3) of its surface, m, robot frame
    frame: RGBDFrame  # frame, table: the photo and its pose
    table: TableFrame
    samples: int = DEFAULT.registration.cost.samples  # so many points of an asset's surface are held against the photo

    @property
    def camera_position(self) -> Array:
        """Where the camera is, (3,) m, robot frame."""
        return np.asarray(self.table.T_robot_cam)[:3, 3]

    def subsample_points(self, factor: int) -> "ObservedPoints":
        """The same with one of ``factor`` samples."""
        return replace(self, points=self.points[::factor], samples=self.samples // factor)


def sample_observed_points(frame: RGBDFrame, table: TableFrame, mask: Mask) -> ObservedPoints:
    """The points of a mask (H, W), at most as many as the configuration says, evenly drawn."""
    rows, columns = pixels_in_mask(mask & (frame.depth > 0))
    step = -(-len(rows) // CONFIG.samples) or 1
    return ObservedPoints(
        pixels_to_robot_frame(frame, table, rows[::step], columns[::step]), frame, table, CONFIG.samples
    )


def residual_per_pose(surface: Surface, tree: Tree, poses: Array, seen: ObservedPoints) -> Array:
    """How far the object's points are off the surface at each of ``poses`` (K, 4, 4): mean of the nearest 90 %, m."""
    turns, shifts = poses[:, :3, :3], poses[:, None, :3, 3]
    local = ((seen.points - shifts) @ turns).reshape(-1, 3)
    nearest, squares = tree.find_nearest_points(local)
    across = np.abs(np.einsum("ni,ni->n", local - surface.points[nearest], surface.normals[nearest]))
    off = np.minimum(np.where(squares < (2 * surface.spacing) ** 2, across, np.sqrt(squares)), CONFIG.farthest)
    off = off.reshape(len(poses), -1)
    kept = max(1, round(CONFIG.trimmed * off.shape[1]))
    return np.partition(off, kept - 1, axis=1)[:, :kept].mean(axis=1)


def free_space_cost(surface: Surface, poses: Array, seen: ObservedPoints) -> Array:
    """How far the surface that faces the camera stands before what was measured, or below the table: means (K,), m."""
    turns = poses[:, :3, :3].transpose(0, 2, 1)
    points = surface.points[: seen.samples] @ turns + poses[:, None, :3, 3]
    facing = ((surface.normals[: seen.samples] @ turns) * (points - seen.camera_position)).sum(axis=2) < 0
    depths = measured_depth_at_points(points.reshape(-1, 3), seen.frame, seen.table)
    measured, depth = (values.reshape(points.shape[:2]) for values in depths)
    known = facing & (measured > 0)
    before = np.where(known, np.clip(measured - depth - CONFIG.free_space, 0, CONFIG.farthest), 0.0).sum(axis=1)
    below = np.where(facing, np.clip(-points[..., 2] - CONFIG.free_space / 2, 0, CONFIG.farthest), 0.0).sum(axis=1)
    return before / np.maximum(known.sum(axis=1), 1) + below / np.maximum(facing.sum(axis=1), 1)


def total_cost_per_pose(surface: Surface, tree: Tree, poses: Array, seen: ObservedPoints) -> Array:
    """The residual, and what stands in free space or below the table, at each of ``poses`` (K, 4, 4): (K,) m."""
    return residual_per_pose(surface, tree, poses, seen) + CONFIG.free_space_weight * free_space_cost(
        surface, poses, seen
    )
