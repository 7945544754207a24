"""Pixels of a photo that show the robot, if the camera is calibrated and the arm's joints are given."""

from collections.abc import Sequence

import cv2
import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import Array, Mask, RGBDFrame
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays

CONFIG = DEFAULT.robot


def require_joints_within_limits(joints: Sequence[float], robot: str) -> None:
    """Check joint positions (dof,) of an arm, by name or path; rad, or m of a slide.

    Raises:
        InputError: their number is wrong, or a position is outside its limits.
    """
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


def render_robot_depth(frame: RGBDFrame, robot: str, library: Library, hand: str = DEFAULT_HAND) -> Array:
    """(H, W) depth, m, of an arm alone, by name or path, at the joints of the frame's camera; infinite beside it, and
    everywhere without calibration or joints.

    Raises:
        InputError: the arm cannot be at these joints.
    """
    seen, _ = _render_arm_depth(frame, robot, library, hand)
    return _enlarge(seen, frame)


def robot_pixel_mask(frame: RGBDFrame, robot: str, library: Library, hand: str = DEFAULT_HAND) -> Mask:
    """(H, W) pixels that show an arm, by name or path, at the joints of the frame's camera.

    These are the pixels whose point lies within a margin of the rendered arm. The margin grows with the measured error
    of model and calibration. None without calibration or joints.

    Raises:
        InputError: the arm cannot be at these joints.
    """
    if not frame.camera.arm_is_known:
        return np.zeros(frame.depth.shape, np.bool_)
    seen, step = _render_arm_depth(frame, robot, library, hand)
    on_arm = np.isfinite(_enlarge(seen, frame)) & (frame.depth <= 0)
    if not np.isfinite(seen).any():
        return np.asarray(on_arm, np.bool_)
    # The margin follows from the depth errors where the arm should be, away from its edges.
    arm, (margin, widest) = _enlarge(seen, frame), CONFIG.margin
    inside = cv2.erode(np.isfinite(arm).astype(np.uint8), np.ones((CONFIG.inset,) * 2, np.uint8)) > 0
    errors = np.abs(frame.depth - arm)[inside & (frame.depth > 0)]
    errors = errors[errors < 2 * widest]  # a larger error is an occluder
    if len(errors) < CONFIG.fewest:
        margin = widest
    else:
        estimate = CONFIG.blur + CONFIG.errors * np.percentile(errors, CONFIG.percentile)
        margin = float(np.clip(estimate, margin, widest))
    # In layers of depth: a margin is many pixels of a near link and few of a far link, without the space in between.
    start, end = 0.0, max(float(seen.min()), CONFIG.nearest)
    while np.isfinite(seen[seen >= start]).any():
        layer = np.where((seen >= start) & (seen < end * CONFIG.layer), seen, np.inf)
        reach = int(np.ceil(margin * frame.camera.fx / end / step))
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1,) * 2)
        near, far = cv2.erode(layer, around), cv2.dilate(np.where(np.isfinite(layer), layer, -np.inf), around)
        low, high = (_enlarge(np.asarray(cells, np.float64), frame) for cells in (near, far))
        on_arm |= (frame.depth > low - margin) & (frame.depth < high + margin)
        start = end = end * CONFIG.layer
    return np.asarray(on_arm, np.bool_)


def _enlarge(cells: Array, frame: RGBDFrame) -> Array:
    """(H, W) the ``cells`` (h, w) enlarged to the frame's size, by the nearest cell."""
    size = (frame.camera.width, frame.camera.height)
    return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_NEAREST), np.float64)


def _render_arm_depth(frame: RGBDFrame, robot: str, library: Library, hand: str) -> tuple[Array, int]:
    """(h, w) depth (m) of the arm alone, infinite beside it, and the spacing of the rays in pixels."""
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
    picture = render_along_rays(VisibleScene((), library, joints, get_arm(robot, hand)), pose[:3, 3].copy(), rays)
    height = pose[2, 3] + picture.depth * rays[..., 2]
    return np.where((picture.depth > 0) & (height > CONFIG.over_table), picture.depth, np.inf).astype(np.float64), step
