"""One object of a frame, as a shape is reconstructed from it."""

import numpy as np

from grs_agents.base.geometry.transforms import pose_matrix, rotation_about_z
from grs_agents.perception.shapes.types import ObjectView
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame, UprightBox


def make_object_view(
    frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox, noise: float, hollow: bool = False
) -> ObjectView:
    """The view of the object with this mask (H, W), measured by its upright box; the rest is as in `ObjectView`."""
    to_object = np.linalg.inv(object_pose(box)) @ np.asarray(table.T_robot_cam, np.float64)
    return ObjectView(frame.rgb, frame.depth, mask, frame.camera.intrinsics, to_object, box.size, noise, hollow)


def object_pose(box: UprightBox) -> Array:
    """(4, 4) transform from the frame of the object with that box to the robot frame, metres."""
    return pose_matrix(rotation_about_z(box.yaw), np.subtract(box.center, (0.0, 0.0, box.size[2] / 2)))
