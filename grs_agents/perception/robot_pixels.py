"""Which pixels of a photo show the robot, where the camera is calibrated and the arm's joints are given."""

from collections.abc import Sequence

import cv2
import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import Array, Mask, RGBDFrame
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.rendering.plain_pictures import render_along_rays
from grs_agents.sim.rendering.views import VisibleScene

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


def render_robot_depth(frame: RGBDFrame, robot: str, library: Library) -> Array:
    """(H, W) the depth, m, of an arm alone, by name or path, at the joints that the frame's camera tells; infinite
    where it is not seen, and everywhere where the camera is not calibrated, or the joints are not given.

    Raises:
        InputError: the arm cannot be at these joints.
    """
    seen, _ = _render_arm_depth(frame, robot, library)
    return _enlarge(seen, frame)


def robot_pixel_mask(frame: RGBDFrame, robot: str, library: Library) -> Mask:
    """(H, W) the pixels that show an arm, by name or path, at the joints that the frame's camera tells.

    A pixel does if its point lies within a margin of the arm as the photo's camera sees it: the model and the
    calibration are not exact, and the margin is the wider the more the photo's depth is off the arm's. None does where
    the camera is not calibrated, or the joints are not given.

    Raises:
        InputError: the arm cannot be at these joints.
    """
    if not frame.camera.arm_is_known:
        return np.zeros(frame.depth.shape, np.bool_)
    seen, step = _render_arm_depth(frame, robot, library)
    on_arm = np.isfinite(_enlarge(seen, frame)) & (frame.depth <= 0)
    if not np.isfinite(seen).any():
        return np.asarray(on_arm, np.bool_)
    margin = _measure_margin(_enlarge(seen, frame), frame)
    # By layers: a margin is many pixels of a near link and few of a far one, and what lies between both is no arm.
    start, end = 0.0, max(float(seen.min()), CONFIG.nearest)
    while np.isfinite(seen[seen >= start]).any():
        layer = np.where((seen >= start) & (seen < end * CONFIG.layer), seen, np.inf)
        near, far = _depths_within(layer, margin * frame.camera.fx / end / step)
        low, high = _enlarge(near, frame), _enlarge(far, frame)
        on_arm |= (frame.depth > low - margin) & (frame.depth < high + margin)
        start = end = end * CONFIG.layer
    return np.asarray(on_arm, np.bool_)


def _measure_margin(arm: Array, frame: RGBDFrame) -> float:
    """How far, m, from an arm of this depth (H, W) what the photo shows may be the arm. How far calibration and model
    are off is seen in the depth where the arm should be, away from its edges."""
    least, widest = CONFIG.margin
    inside = cv2.erode(np.isfinite(arm).astype(np.uint8), np.ones((CONFIG.inset,) * 2, np.uint8)) > 0
    errors = np.abs(frame.depth - arm)[inside & (frame.depth > 0)]
    errors = errors[errors < 2 * widest]  # what is off by more is something before the arm
    if len(errors) < CONFIG.fewest:
        return widest
    return float(np.clip(CONFIG.blur + CONFIG.errors * np.percentile(errors, CONFIG.percentile), least, widest))


def _depths_within(seen: Array, reach: float) -> tuple[Array, Array]:
    """(h, w) the least and the greatest depth within so many pixels of each: infinite, and minus, where none is."""
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(np.ceil(reach)) + 1,) * 2)
    near = cv2.erode(seen, around)
    far = cv2.dilate(np.where(np.isfinite(seen), seen, -np.inf), around)
    return np.asarray(near, np.float64), np.asarray(far, np.float64)


def _enlarge(cells: Array, frame: RGBDFrame) -> Array:
    """(H, W) what the (h, w) ``cells`` hold, at the frame's size."""
    size = (frame.camera.width, frame.camera.height)
    return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_NEAREST), np.float64)


def _render_arm_depth(frame: RGBDFrame, robot: str, library: Library) -> tuple[Array, int]:
    """(h, w) depth (m) of the arm alone, infinite where it is not seen, and every how many pixels that is."""
    camera, step = frame.camera, max(1, round((frame.depth.size / CONFIG.rays) ** 0.5))
    columns, rows = np.meshgrid(
        (np.arange(-(-camera.width // step)) + 0.5) * step - 0.5,
        (np.arange(-(-camera.height // step)) + 0.5) * step - 0.5,
    )
    if camera.joints is None or camera.T_robot_cam is None:
        return np.full(rows.shape, np.inf), step
    require_joints_within_limits(camera.joints, robot)
    joints, pose = np.asarray(camera.joints, np.float64), np.asarray(camera.T_robot_cam, np.float64)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], axis=-1)
    rays = np.asarray(local @ pose[:3, :3].T, np.float64)
    picture = render_along_rays(VisibleScene((), library, joints, get_arm(robot)), pose[:3, 3].copy(), rays)
    height = pose[2, 3] + picture.depth * rays[..., 2]
    return np.where((picture.depth > 0) & (height > CONFIG.over_table), picture.depth, np.inf).astype(np.float64), step
