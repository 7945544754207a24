"""Which pixels of a photo show the robot, where the camera is calibrated and the arm's joints are given."""

from collections.abc import Sequence

import cv2
import numpy as np

from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import Array, Camera, Mask, RGBDFrame
from grs_agents.sim.arms import get_arm
from grs_agents.sim.rendering import VisibleScene, render_along_rays

CONFIG = DEFAULT.robot


def require_joints_within_limits(joints: Sequence[float], robot: str) -> None:
    """Whether an arm, by name or path, can be at joint positions (dof,), rad, or m of a slide.
    Raises InputError: their number is another, or one is outside its limits."""
    arm = get_arm(robot)
    if len(joints) != arm.dof:
        raise InputError(
            f"camera.json: joints has {len(joints)} numbers, but {robot} has {arm.dof} joints",
            "give the position of each joint, rad, base first; name the arm with --set robot=...; or leave joints out",
        )
    for number, value in enumerate(joints, 1):
        low, high = float(arm.lower_joint_limits[number - 1]), float(arm.upper_joint_limits[number - 1])
        if not low - CONFIG.slack <= value <= high + CONFIG.slack:
            raise InputError(
                f"camera.json: joints: joint {number} of {robot} is at {value:g}, outside {low:.3f}..{high:.3f} rad",
                "give radians, not degrees, base first; name the arm with --set robot=...; or leave joints out",
            )


def robot_pixel_mask(frame: RGBDFrame, robot: str, library: Library) -> Mask:
    """(H, W) the pixels that show an arm, by name or path, at the joints that the frame's camera tells.

    A pixel does if its point lies within a margin of the arm as the photo's camera sees it: the model and the
    calibration are not exact. None does where the camera is not calibrated, or the joints are not given.

    Raises:
        InputError: the arm cannot be at these joints.
    """
    camera = frame.camera
    if camera.joints is None or camera.T_robot_cam is None:
        return np.zeros(frame.depth.shape, np.bool_)
    require_joints_within_limits(camera.joints, robot)
    step = max(1, round((frame.depth.size / CONFIG.rays) ** 0.5))
    seen = _render_arm_depth(camera, np.asarray(camera.joints, np.float64), robot, library, step)
    if not np.isfinite(seen).any():
        return np.zeros(frame.depth.shape, np.bool_)
    reach = CONFIG.margin * camera.fx / float(np.median(seen[np.isfinite(seen)])) / step
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(np.ceil(reach)) + 1,) * 2)
    near = cv2.erode(seen, around)
    far = cv2.dilate(np.where(np.isfinite(seen), seen, -np.inf), around)
    size = (camera.width, camera.height)
    low, high, own = (cv2.resize(one, size, interpolation=cv2.INTER_NEAREST) for one in (near, far, seen))
    on_arm = (frame.depth > low - CONFIG.margin) & (frame.depth < high + CONFIG.margin)
    return np.asarray(on_arm | (np.isfinite(own) & (frame.depth <= 0)), np.bool_)


def _render_arm_depth(camera: Camera, joints: Array, robot: str, library: Library, step: int) -> Array:
    """(h, w) depth (m) of the arm alone at every so many pixels, infinite where it is not seen."""
    pose = np.asarray(camera.T_robot_cam, np.float64)
    columns, rows = np.meshgrid(
        (np.arange(-(-camera.width // step)) + 0.5) * step - 0.5,
        (np.arange(-(-camera.height // step)) + 0.5) * step - 0.5,
    )
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], axis=-1)
    rays = np.asarray(local @ pose[:3, :3].T, np.float64)
    picture = render_along_rays(VisibleScene((), library, joints, get_arm(robot)), pose[:3, 3].copy(), rays)
    height = pose[2, 3] + picture.depth * rays[..., 2]
    return np.where((picture.depth > 0) & (height > CONFIG.over_table), picture.depth, np.inf).astype(np.float64)
