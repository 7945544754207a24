"""Cost of an asset at a pose: residual of the object's points, free-space violation, silhouette."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.perception.asset_surfaces import SurfaceSamples, Tree
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import mask_bounding_slices, pixels_in_mask
from grs_agents.perception.table_finding import measured_depth_at_points, pixels_to_robot_frame
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

CONFIG = DEFAULT.registration.cost
SILHOUETTE = DEFAULT.registration.silhouette


@dataclass(frozen=True)
class ObservedPoints:
    """The measured points of an object, and the photo around them."""

    points: Array  # (N, 3) m, robot frame
    frame: RGBDFrame
    table: TableFrame
    samples: int = CONFIG.samples  # number of surface points of an asset that are compared with the photo

    @property
    def camera_position(self) -> Array:
        """The camera's position (3,) in the robot frame, m."""
        return self.table.camera_position

    def subsample_points(self, factor: int) -> "ObservedPoints":
        """The same with a ``factor`` times smaller number of points and samples."""
        return replace(self, points=self.points[::factor], samples=self.samples // factor)


def sample_observed_points(frame: RGBDFrame, table: TableFrame, mask: Mask) -> ObservedPoints:
    """The measured points of a mask (H, W), evenly subsampled to the configured number."""
    rows, columns = pixels_in_mask(mask & (frame.depth > 0))
    step = -(-len(rows) // CONFIG.samples) or 1
    points = pixels_to_robot_frame(frame, table, rows[::step], columns[::step])
    return ObservedPoints(points, frame, table, CONFIG.samples)


def residual_per_pose(surface: SurfaceSamples, tree: Tree, poses: Array, seen: ObservedPoints) -> Array:
    """Residuals (K,), m, of the points at poses (K, 4, 4) of the surface: mean distance of the nearest 90 %."""
    turns, shifts = poses[:, :3, :3], poses[:, None, :3, 3]
    local = ((seen.points - shifts) @ turns).reshape(-1, 3)
    nearest, squares = tree.find_nearest_points(local)
    across = np.abs(np.einsum("ni,ni->n", local - surface.points[nearest], surface.normals[nearest]))
    off = np.minimum(np.where(squares < (2 * surface.spacing) ** 2, across, np.sqrt(squares)), CONFIG.farthest)
    off = off.reshape(len(poses), -1)
    kept = max(1, round(CONFIG.trimmed * off.shape[1]))
    return np.partition(off, kept - 1, axis=1)[:, :kept].mean(axis=1)


def free_space_cost(surface: SurfaceSamples, poses: Array, seen: ObservedPoints) -> Array:
    """Means (K,), m, of the depth by which the visible surface lies in measured free space or below the table."""
    turns = poses[:, :3, :3].transpose(0, 2, 1)
    points = surface.points[: seen.samples] @ turns + poses[:, None, :3, 3]
    facing = ((surface.normals[: seen.samples] @ turns) * (points - seen.camera_position)).sum(axis=2) < 0
    depths = measured_depth_at_points(points.reshape(-1, 3), seen.frame, seen.table)
    measured, depth = (values.reshape(points.shape[:2]) for values in depths)
    known = facing & (measured > 0)
    before = np.where(known, np.clip(measured - depth - CONFIG.free_space, 0, CONFIG.farthest), 0.0).sum(axis=1)
    below = np.where(facing, np.clip(-points[..., 2] - CONFIG.free_space / 2, 0, CONFIG.farthest), 0.0).sum(axis=1)
    return before / np.maximum(known.sum(axis=1), 1) + below / np.maximum(facing.sum(axis=1), 1)


def total_cost_per_pose(surface: SurfaceSamples, tree: Tree, poses: Array, seen: ObservedPoints) -> Array:
    """Residual and weighted free-space cost (K,), m, at poses (K, 4, 4)."""
    return residual_per_pose(surface, tree, poses, seen) + CONFIG.free_space_weight * free_space_cost(
        surface, poses, seen
    )


@dataclass(frozen=True)
class SilhouetteWindow:
    """A subsampled window of the photo around an object, with which silhouettes are compared."""

    mask: Mask  # (h, w) the object's pixels
    depth: npt.NDArray[np.float32]  # (h, w) m, 0 where nothing was measured
    focal: tuple[float, float]  # pixels
    center: tuple[float, float]  # principal point, pixels of the window
    T_robot_cam: Array  # (4, 4)

    @classmethod
    def from_mask(cls, frame: RGBDFrame, table: TableFrame, mask: Mask) -> "SilhouetteWindow":
        """The window around a mask (H, W) with at least one pixel."""
        rows, columns = mask_bounding_slices(mask)
        side, camera = max(rows.stop - rows.start, columns.stop - columns.start), frame.camera
        margin = int(SILHOUETTE.margin * side) + 1
        step = max(1, round(side / SILHOUETTE.pixels))
        top, left = max(rows.start - margin, 0), max(columns.start - margin, 0)
        window = np.s_[top : rows.stop + margin : step, left : columns.stop + margin : step]
        focal, center = (camera.fx / step, camera.fy / step), ((camera.cx - left) / step, (camera.cy - top) / step)
        return cls(mask[window], frame.depth[window], focal, center, np.asarray(table.T_robot_cam))

    def difference_per_pose(self, corners: Array, poses: Array) -> Array:
        """1 - intersection over union of mask and silhouette, (K,), at poses (K, 4, 4) of triangles (T, 3, 3).

        Pixels hidden by nearer surfaces, and pixels beside the mask without depth, do not count.
        """
        differences: list[float] = []
        height, width = self.mask.shape
        for pose in poses:
            placed = corners @ pose[:3, :3].T + pose[:3, 3]
            local = (placed.reshape(-1, 3) - self.T_robot_cam[:3, 3]) @ self.T_robot_cam[:3, :3]
            nearness = 1 / np.maximum(local[:, 2], SILHOUETTE.nearest)
            pixels = local[:, :2] * nearness[:, None] * self.focal + self.center
            drawn = rasterise_triangles(pixels.reshape(-1, 3, 2), nearness.reshape(-1, 3), width, height)
            shown = drawn.triangle >= 0
            nearness = np.where(shown, drawn.nearness, 0)
            hidden = self.depth * nearness < 1 - SILHOUETTE.nearer * nearness
            shown &= self.mask | ((self.depth > 0) & ~hidden)
            union = max(np.count_nonzero(shown | self.mask), 1)
            differences.append(1 - np.count_nonzero(shown & self.mask) / union)
        return np.array(differences)
