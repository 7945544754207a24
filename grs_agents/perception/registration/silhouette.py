"""How well the silhouette of an asset at a pose agrees with the pixels of an object."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import mask_bounding_slices
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

CONFIG = DEFAULT.registration.silhouette


@dataclass(frozen=True)
class SeenSilhouette:
    """The part of a photo around an object, at fewer pixels."""

    mask: Mask  # (h, w) the object's pixels
    depth: npt.NDArray[np.float32]  # (h, w) m, 0 where nothing was measured
    focal: tuple[float, float]  # pixels
    center: tuple[float, float]  # principal point, pixels of this part
    T_robot_cam: Array  # (4, 4)

    @classmethod
    def from_mask(cls, frame: RGBDFrame, table: TableFrame, mask: Mask) -> "SeenSilhouette":
        """What is seen around a mask (H, W) that holds a pixel."""
        rows, columns = mask_bounding_slices(mask)
        side, camera = max(rows.stop - rows.start, columns.stop - columns.start), frame.camera
        margin = int(CONFIG.margin * side) + 1
        step = max(1, round(side / CONFIG.pixels))
        top, left = max(rows.start - margin, 0), max(columns.start - margin, 0)
        window = np.s_[top : rows.stop + margin : step, left : columns.stop + margin : step]
        focal, center = (camera.fx / step, camera.fy / step), ((camera.cx - left) / step, (camera.cy - top) / step)
        return cls(mask[window], frame.depth[window], focal, center, np.asarray(table.T_robot_cam))

    def difference_per_pose(self, corners: Array, poses: Array) -> Array:
        """(K,) one less the intersection over union of mask and silhouette, at each of (K, 4, 4) poses of triangles
        with ``corners`` (T, 3, 3). What something nearer hides, or lies beside the mask without depth, is not known."""
        return np.array([self._difference(corners @ pose[:3, :3].T + pose[:3, 3]) for pose in poses])

    def _difference(self, corners: Array) -> float:
        local = (corners.reshape(-1, 3) - self.T_robot_cam[:3, 3]) @ self.T_robot_cam[:3, :3]
        nearness = 1 / np.maximum(local[:, 2], CONFIG.nearest)
        pixels = local[:, :2] * nearness[:, None] * self.focal + self.center
        height, width = self.mask.shape
        drawn = rasterise_triangles(pixels.reshape(-1, 3, 2), nearness.reshape(-1, 3), width, height)
        shown = drawn.triangle >= 0
        nearness = np.where(shown, drawn.nearness, 0)
        hidden = self.depth * nearness < 1 - CONFIG.nearer * nearness
        shown &= self.mask | ((self.depth > 0) & ~hidden)
        return 1 - np.count_nonzero(shown & self.mask) / max(np.count_nonzero(shown | self.mask), 1)
