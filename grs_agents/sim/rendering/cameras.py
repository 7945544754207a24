"""Pinhole cameras, their rays, and the images they take."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix, quaternion_to_matrix
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.hands.hand import Tool
from grs_agents.sim.instance.task_instance import InstanceCamera, InstanceObject


@dataclass(frozen=True)
class LookAtCamera:
    """A camera by position and target (m), vertical field of view (deg), rows and columns."""

    position: Vec3
    target: Vec3
    field_of_view: float = 45.0
    height: int = 480
    width: int = 640


_NEAREST = 0.05
"""Least distance along the optical axis at which a point counts as before the camera, metres."""
FRONT = LookAtCamera((1.35, 0.0, 0.75), (0.45, 0.0, 0.05))
LEFT = LookAtCamera((0.15, 0.85, 0.65), (0.5, 0.0, 0.05))
RIGHT = LookAtCamera((0.15, -0.85, 0.65), (0.5, 0.0, 0.05))


@dataclass(frozen=True)
class RenderedImage:
    """color (H, W, 3) uint8; depth (H, W) float32, m along the optical axis, 0 without a hit; owner (H, W) id or -1."""

    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    owner: npt.NDArray[np.int32]


@dataclass(frozen=True)
class VisibleScene:
    """A scene to be rendered."""

    objects: Sequence[InstanceObject]
    library: Library
    joints: FloatArray | None = None  # positions (dof,), perhaps with the fingers'; None leaves the arm out
    arm: Arm | None = None  # None for the default
    tool: Tool = "suction"
    poses: Sequence[Pose] | None = None  # of the objects, in place of their own
    background: str | None = None  # library name of the fixed surroundings of the robot


def encode_png(color: npt.NDArray[np.uint8]) -> bytes:
    """An image (H, W, 3) as a PNG file's content."""
    height, width = color.shape[:2]
    rows = np.hstack([np.zeros((height, 1), np.uint8), color.reshape(height, -1)])  # filter type 0 before each row

    def png_chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = png_chunk(b"IHDR", header) + png_chunk(b"IDAT", zlib.compress(rows.tobytes())) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def camera_ray_directions(view: LookAtCamera) -> FloatArray:
    """Directions (H * W, 3) with length 1 along the optical axis, robot frame."""
    right, down, forward = _camera_axes(view)
    focal = view.height / 2 / np.tan(np.deg2rad(view.field_of_view) / 2)
    u, v = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    x, y = (u - view.width / 2) / focal, (v - view.height / 2) / focal
    return (forward + x[..., None] * right + y[..., None] * down).reshape(-1, 3)


def _camera_axes(view: LookAtCamera) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Right, down and forward, (3,) each, robot frame."""
    forward = np.subtract(view.target, view.position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([0.0, -1.0, 0.0])
    return right, np.cross(forward, right), forward


def view_pose(view: LookAtCamera) -> FloatArray:
    """T_robot_cam (4, 4) of a camera, OpenCV axes, m."""
    return pose_matrix(np.stack(_camera_axes(view), axis=1), np.array(view.position, np.float64))


def lens_from_field_of_view(field_of_view: float, height: int, width: int) -> Lens:
    """Lens with a vertical field of view (deg) and the principal point in the middle of the image."""
    focal = float(height / 2 / np.tan(np.deg2rad(field_of_view) / 2))
    return Lens(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)


def photo_lens_and_pose(camera: InstanceCamera, side: int, shown: FloatArray) -> tuple[Lens, FloatArray]:
    """Lens and pose (T_robot_cam (4, 4), OpenCV axes, m) of the photo's camera.

    Args:
        camera: the photo's.
        side: bound on the longer side of the picture, pixels.
        shown: points (N, 3), m, robot frame, for which the picture is widened, at most by half on each side: the photo
            need not show the place to which an object is brought.
    """
    position, rotation = camera.pose
    pose = pose_matrix(quaternion_to_matrix(rotation), np.array(position))
    seen = (shown.reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]
    seen = seen[seen[:, 2] > _NEAREST]
    size, focal = np.array([camera.width, camera.height]), np.array([camera.fx, camera.fy])
    pixels = np.vstack([seen[:, :2] / seen[:, 2:] * focal + (camera.cx, camera.cy), (size - 1) / 2])
    before = np.clip(np.ceil(-pixels.min(axis=0)), 0, size // 2)
    left, top = before.tolist()
    width, height = (size + before + np.clip(np.ceil(pixels.max(axis=0)) + 1 - size, 0, size // 2)).astype(int).tolist()
    lens = Lens(camera.fx, camera.fy, camera.cx + left, camera.cy + top, width, height)
    scale = min(1.0, side / max(height, width))
    return resize_lens(lens, max(1, round(scale * height)), max(1, round(scale * width))), pose


def lens_ray_directions(lens: Lens) -> FloatArray:
    """Directions (H, W, 3) of the pixel centres with length 1 along the optical axis, camera frame."""
    rows, columns = np.indices((lens.height, lens.width), dtype=np.float64)
    return np.stack([(columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy, np.ones_like(rows)], axis=-1)


def resize_lens(lens: Lens, height: int, width: int) -> Lens:
    """Lens of the same view in an image of another size; the centre of the first pixel is (0, 0) in both."""
    across, down = width / lens.width, height / lens.height
    return Lens(
        lens.fx * across,
        lens.fy * down,
        (lens.cx + 0.5) * across - 0.5,
        (lens.cy + 0.5) * down - 0.5,
        width,
        height,
    )
