"""A synthesised room: a table with things on it, a wall and a shelf behind it, seen by casting rays at their boxes."""

import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.types import Camera, RGBDFrame

Floats = npt.NDArray[np.float64]
TABLE, ROOM, THINGS = (0,), (1, 2, 3), (4, 5)
BOXES: Floats = np.array(
    [
        ((-0.2, -0.9, -0.05), (0.95, 0.9, 0.0)),  # table
        ((1.2, -1.6, -0.8), (1.25, 1.6, 1.2)),  # wall
        ((1.0, 0.3, -0.8), (1.2, 0.8, 0.5)),  # shelf
        ((1.0, -0.8, 0.3), (1.2, -0.3, 0.33)),  # board on the wall
        ((0.45, -0.15, 0.0), (0.51, -0.07, 0.12)),
        ((0.5, 0.1, 0.0), (0.56, 0.16, 0.06)),
    ]
)
"""Lowest and highest corners, metres, robot frame."""
_COLORS = ((200, 180, 150), (215, 215, 225), (120, 80, 40), (90, 60, 40), (200, 30, 30), (30, 60, 200), (0, 0, 0))


def camera(yaw: float = 0.0, width: int = 320, height: int = 240) -> Camera:
    """A calibrated camera that looks down by 28 degrees over the table, turned by ``yaw`` (rad)."""
    tilt = np.deg2rad(28.0)
    forward = np.array([np.cos(tilt) * np.cos(yaw), np.cos(tilt) * np.sin(yaw), -np.sin(tilt)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = np.array([0.5, 0.0, 0.1]) - 1.1 * forward
    focal = 0.75 * width
    matrix = tuple(tuple(float(value) for value in row) for row in pose)
    cx, cy = (width - 1) / 2, (height - 1) / 2
    return Camera(fx=focal, fy=focal, cx=cx, cy=cy, width=width, height=height, depth_scale=0.0005, T_robot_cam=matrix)


def photo(
    seen_by: Camera, noise: float = 0.0, boxes: Floats = BOXES
) -> tuple[RGBDFrame, Floats, npt.NDArray[np.int64]]:
    """The frame, the true points (H, W, 3) in the robot frame, and the number of the box in each pixel, -1 for none.

    Args:
        seen_by: the camera.
        noise: standard deviation of depth at 1 m, metres; it grows with the square of the distance.
        boxes: (N, 2, 3) of what there is.
    """
    pose = np.asarray(seen_by.T_robot_cam)
    rows, columns = np.indices((seen_by.height, seen_by.width))
    flat = [(columns - seen_by.cx) / seen_by.fx, (rows - seen_by.cy) / seen_by.fy, np.ones(rows.shape)]
    rays, eye = np.stack(flat, axis=-1) @ pose[:3, :3].T, pose[:3, 3]
    depth, owner = np.full(rows.shape, np.inf), np.full(rows.shape, -1, np.int64)
    axes = [np.ascontiguousarray(rays[..., axis]) for axis in range(3)]  # a maximum over an axis of three is slow
    for number, (low, high) in enumerate(boxes):
        near, far = np.full(rows.shape, -np.inf), np.full(rows.shape, np.inf)
        for axis, along in enumerate(axes):
            first, second = (low[axis] - eye[axis]) / along, (high[axis] - eye[axis]) / along
            near, far = np.maximum(near, np.minimum(first, second)), np.minimum(far, np.maximum(first, second))
        hit = (near < far) & (near > 0) & (near < depth)
        depth[hit], owner[hit] = near[hit], number
    depth[owner < 0] = 0
    points = eye + rays * depth[..., None]
    shaken = depth + noise * depth**2 * np.random.default_rng(0).normal(size=depth.shape)
    rgb = np.array(_COLORS, np.uint8)[np.where(owner < 0, -1, owner % (len(_COLORS) - 1))]
    frame = RGBDFrame(rgb, np.where(owner < 0, 0, shaken).astype(np.float32), seen_by, Path("room"))
    return frame, np.asarray(points, np.float64), owner


def write(frame: RGBDFrame, folder: Path) -> Path:
    """The frame as a scene folder."""
    folder.mkdir()
    cv2.imwrite(str(folder / "rgb.png"), cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))
    cv2.imwrite(str(folder / "depth.png"), np.rint(frame.depth / frame.camera.depth_scale).astype(np.uint16))
    (folder / "camera.json").write_text(json.dumps(frame.camera.model_dump(mode="json")))
    return folder
