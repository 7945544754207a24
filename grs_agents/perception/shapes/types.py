"""Input and output of shape reconstruction.

Object frame: origin on the support under the middle of the measured box, z up, x along the first side of that box.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import pose_matrix, rotation_about_z
from grs_agents.perception.types import Array, Image, Intrinsics, Mask, RGBDFrame, TableFrame, UprightBox

ShapeMethod = Literal["box", "lathe", "mirror", "voxels", "model"]
"""A box; revolved about an upright axis; carved by the view and its mirror images; carved by the view alone; or made by
the user's model."""


@dataclass(frozen=True)
class ObjectView:
    """An object in a photo with depth."""

    rgb: Image  # (H, W, 3) uint8
    depth: npt.NDArray[np.float32]  # (H, W) metres along the optical axis, 0 where nothing was measured
    mask: Mask  # (H, W) bool: the object's pixels
    intrinsics: Intrinsics
    T_object_cam: Array  # (4, 4) from the camera frame (OpenCV axes) to the object frame, metres
    size: tuple[float, float, float]  # of the measured upright box along the object frame's axes, metres
    noise: float  # standard deviation of depth at the object's distance, metres
    hollow: bool = False  # whether its measured points are open at the top


@dataclass(frozen=True)
class ObjectMesh:
    """A closed triangle mesh with a picture on it."""

    vertices: Array  # (V, 3) metres, object frame
    faces: npt.NDArray[np.int64]  # (F, 3) vertex indices, counter-clockwise from outside
    uvs: Array  # (V, 2) texture coordinates, origin lower left
    texture: Image  # (h, w, 3) uint8


@dataclass(frozen=True)
class ObjectShape:
    """A reconstructed object: mesh, walls if hollow, agreement with the photo."""

    mesh: ObjectMesh
    method: ShapeMethod
    hollow: bool  # open at the top: objects can be put into it
    # of a hollow lathe: (N, 3) inner radius, outer radius, height above the support, metres, from the floor to the rim
    walls: Array | None
    silhouette_iou: float  # of the mesh seen by the photo's camera with the mask, where nothing nearer hides it
    depth_error: float  # 90th percentile of |mesh - measured| over the mask's pixels with depth, metres


def make_object_view(
    frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox, noise: float, hollow: bool = False
) -> ObjectView:
    """The view of the object with this mask (H, W) and measured upright box; the rest is as in `ObjectView`."""
    T_object_cam = np.linalg.inv(object_pose(box)) @ np.asarray(table.T_robot_cam, np.float64)
    return ObjectView(frame.rgb, frame.depth, mask, frame.camera.intrinsics, T_object_cam, box.size, noise, hollow)


def object_pose(box: UprightBox) -> Array:
    """(4, 4) transform from the frame of the object with that box to the robot frame, metres."""
    return pose_matrix(rotation_about_z(box.yaw), np.subtract(box.center, (0.0, 0.0, box.size[2] / 2)))
