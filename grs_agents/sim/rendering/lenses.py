"""Pinhole cameras of views, and their rays."""

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray, pose_matrix
from grs_agents.library.asset_rendering import Lens
from grs_agents.sim.rendering.views import View


def camera_ray_directions(view: View) -> FloatArray:
    """Directions (H * W, 3) with length 1 along the optical axis, robot frame."""
    right, down, forward = _camera_axes(view)
    focal = view.height / 2 / np.tan(np.deg2rad(view.field_of_view) / 2)
    u, v = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    x, y = (u - view.width / 2) / focal, (v - view.height / 2) / focal
    return (forward + x[..., None] * right + y[..., None] * down).reshape(-1, 3)


def _camera_axes(view: View) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Right, down and forward, (3,) each, robot frame."""
    forward = np.subtract(view.target, view.position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([0.0, -1.0, 0.0])
    return right, np.cross(forward, right), forward


def view_pose(view: View) -> FloatArray:
    """T_robot_cam (4, 4) of a view, OpenCV axes, m."""
    return pose_matrix(np.stack(_camera_axes(view), axis=1), np.array(view.position, np.float64))


def lens_from_field_of_view(field_of_view: float, height: int, width: int) -> Lens:
    """The lens with a vertical field of view (deg) that looks through the picture's middle."""
    focal = float(height / 2 / np.tan(np.deg2rad(field_of_view) / 2))
    return Lens(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)


def lens_ray_directions(lens: Lens) -> FloatArray:
    """Directions (H, W, 3) of the pixels' centres with length 1 along the optical axis, camera frame."""
    rows, columns = np.indices((lens.height, lens.width), dtype=np.float64)
    return np.stack([(columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy, np.ones_like(rows)], axis=-1)


def resize_lens(lens: Lens, height: int, width: int) -> Lens:
    """The whole of a lens's picture in one of another size; the centre of the first pixel is at (0, 0) in both."""
    across, down = width / lens.width, height / lens.height
    return Lens(
        lens.fx * across,
        lens.fy * down,
        (lens.cx + 0.5) * across - 0.5,
        (lens.cy + 0.5) * down - 0.5,
        width,
        height,
    )
