"""An RGB-D frame and the camera that took it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from grs_agents.base import Frozen

FARTHEST_CAMERA = 10.0
"""A camera that sees the robot's table is at most this far from the robot, in metres."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Matrix = tuple[tuple[float, ...], ...]
Image = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Array = npt.NDArray[np.float64]


class Camera(Frozen):
    """A pinhole camera, OpenCV axes (x right, y down, z forward).

    Attributes:
        fx, fy, cx, cy: intrinsics in pixels.
        width, height: of the colour image in pixels.
        depth_scale: metres per unit of the depth image.
        T_robot_cam: 4x4 rigid transform from the camera frame to the robot frame, if it was calibrated.
    """

    fx: Positive
    fy: Positive
    cx: Finite
    cy: Finite
    width: Annotated[int, Field(gt=0)]
    height: Annotated[int, Field(gt=0)]
    depth_scale: Positive
    T_robot_cam: Matrix | None = None

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        longest = max(self.width, self.height)
        for name in ("fx", "fy"):
            if not 0.1 * longest <= getattr(self, name) <= 20 * longest:
                raise ValueError(
                    f"{name} = {getattr(self, name):g} is outside {0.1 * longest:g}..{20 * longest:g} pixels"
                )
        for name, extent in (("cx", self.width), ("cy", self.height)):
            if not -extent <= getattr(self, name) <= 2 * extent:
                raise ValueError(f"{name} = {getattr(self, name):g} is outside {-extent}..{2 * extent} pixels")
        return self

    @field_validator("T_robot_cam")
    @classmethod
    def _rigid(cls, matrix: Matrix | None) -> Matrix | None:
        if matrix is None:
            return None
        try:
            array = np.asarray(matrix, dtype=np.float64)
        except ValueError as error:
            raise ValueError("must be a 4x4 matrix of numbers") from error
        if array.shape != (4, 4) or not np.isfinite(array).all():
            raise ValueError("must be a 4x4 matrix of finite numbers")
        rotation = array[:3, :3]
        proper = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
        if not proper or not np.allclose(array[3], (0, 0, 0, 1), atol=1e-6):
            raise ValueError("must be a rigid transform: a rotation, a translation in metres, last row 0 0 0 1")
        distance = float(np.linalg.norm(array[:3, 3]))
        if distance > FARTHEST_CAMERA:
            raise ValueError(
                f"puts the camera {distance:g} m from the robot, more than {FARTHEST_CAMERA:g} m: give it in metres"
            )
        return matrix


@dataclass(frozen=True)
class RGBDFrame:
    """A photo with depth.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32 metres along the optical axis, 0 where nothing was measured.
        camera: intrinsics and, if calibrated, pose.
        source: what it was read from: a folder, a file, or ``bop:`` and an image of a data set.
        notes: what a reader of the scene should know about how it was read.
    """

    rgb: Image
    depth: npt.NDArray[np.float32]
    camera: Camera
    source: Path
    notes: tuple[str, ...] = ()

    def points(self) -> Array:
        """(H, W, 3) points in the camera frame, metres; (0, 0, 0) where there is no depth."""
        camera = self.camera
        height, width = self.depth.shape
        points = np.empty((height, width, 3))
        points[..., 2] = self.depth
        columns, rows = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)[:, None]
        points[..., 0] = (columns - camera.cx) / camera.fx * points[..., 2]
        points[..., 1] = (rows - camera.cy) / camera.fy * points[..., 2]
        return points
