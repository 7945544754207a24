"""Rectification of a picture by the distortion of its lens."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.perception.types import Intrinsics

BROWN = ("plumb_bob", "rational_polynomial", "brown conrady", "modified brown conrady", "")
INVERSE_BROWN = "inverse brown conrady"  # of RealSense: coefficients map distorted to rectified coordinates
FISHEYE = ("equidistant", "kannala brandt4")
MODELS = (*BROWN[:-1], INVERSE_BROWN, *FISHEYE)
"""Names of distortion models in ROS and librealsense, lower case."""
NEGLIGIBLE = 1e-9
_PINHOLE = ("pinhole", "opencv", "none", "radtan", "radial tangential", "perspective", "full opencv")
"""Names of lenses in other programs whose coefficients are OpenCV's."""
MOST_COEFFICIENTS = 14


def normalize_lens_model(name: str) -> str:
    """A name of `MODELS` for the names of other programs; unknown names as they are, in lower case."""
    plain = name.lower().removeprefix("distortion.").replace("_", " ").replace("-", " ").strip()
    if plain in _PINHOLE:
        return ""
    return {"plumb bob": "plumb_bob", "rational polynomial": "rational_polynomial", "fisheye": "equidistant"}.get(
        plain, plain
    )


@dataclass(frozen=True)
class LensDistortion:
    """Coefficients of a distortion model: k1, k2, p1, p2, k3 and so on, or k1 to k4 of a fisheye."""

    model: str  # of `MODELS`
    coefficients: tuple[float, ...]
    where: str  # its name in errors

    @property
    def is_none(self) -> bool:
        """Whether every coefficient is negligible."""
        return all(abs(value) < NEGLIGIBLE for value in self.coefficients)


def rectification_map(camera: Intrinsics, lens: LensDistortion) -> npt.NDArray[np.float32]:
    """(H, W, 2) column and row, in the distorted picture, of each pixel of the rectified picture with the same camera.

    Raises:
        InputError: the model is unknown, or a coefficient is not finite.
    """
    name = lens.model.lower().replace("-", " ")
    values = np.array(lens.coefficients, np.float64)
    if not np.isfinite(values).all() or len(values) > MOST_COEFFICIENTS:
        raise InputError(
            f"{lens.where} has the distortion {list(lens.coefficients)!a:.80}", "calibrate the camera again"
        )
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    size = (camera.width, camera.height)
    if name in BROWN:
        lens_values = np.resize(np.append(values, np.zeros(5)), max(len(values), 5))
        across, down = cv2.initUndistortRectifyMap(matrix, lens_values, np.eye(3), matrix, size, cv2.CV_32FC1)
        return np.dstack([across, down]).astype(np.float32)
    if name == INVERSE_BROWN:
        grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 1, 2)
        found = cv2.undistortPoints(grid.astype(np.float64), matrix, values, P=matrix)
        return np.asarray(found, np.float32).reshape(size[1], size[0], 2)
    if name in FISHEYE and len(values) >= 4:
        across, down = cv2.fisheye.initUndistortRectifyMap(matrix, values[:4], np.eye(3), matrix, size, cv2.CV_32FC1)
        return np.dstack([across, down]).astype(np.float32)
    raise InputError(
        f"{lens.where} has the distortion model {lens.model[:40]!a} with {len(values)} coefficients",
        f"rectify the pictures first (ROS: image_proc); known models are {', '.join(MODELS)}",
    )


def rectify_picture(picture: "npt.NDArray[Any]", at: npt.NDArray[np.float32], interpolate: bool) -> "npt.NDArray[Any]":
    """A picture (H, W) or (H, W, C) sampled at ``at`` (H, W, 2): interpolated, or the nearest pixel; 0 outside."""
    how = cv2.INTER_LINEAR if interpolate else cv2.INTER_NEAREST
    across, down = (np.ascontiguousarray(at[..., axis]) for axis in range(2))
    return cv2.remap(picture, across, down, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
