"""Poses ((x, y, z), (qx, qy, qz, qw)), quaternions xyzw, rotation and pose matrices; metres, radians."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Quat, Vec3

FloatArray = npt.NDArray[np.float64]

IDENTITY: Quat = (0.0, 0.0, 0.0, 1.0)


def to_vec3(values: Sequence[float] | FloatArray) -> Vec3:
    """The first three numbers of ``values`` as plain floats."""
    return (float(values[0]), float(values[1]), float(values[2]))


def to_unit_quaternion(values: Sequence[float] | FloatArray) -> Quat:
    """The four numbers of ``values`` as a unit quaternion (x, y, z, w)."""
    if len(values) != 4:
        return IDENTITY
    x, y, z, w = map(float, values)
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not math.isfinite(norm) or norm < 1e-9:
        return IDENTITY
    return (x / norm, y / norm, z / norm, w / norm)


def parse_pose(value: Any) -> Pose | None:
    """Parse a pose from a pair of three and four finite numbers; None for anything else."""
    try:
        (x, y, z), (a, b, c, d) = value
        numbers = (x, y, z, a, b, c, d)
        if not all(isinstance(number, float | int) for number in numbers) or not math.isfinite(sum(numbers)):
            return None
        return to_vec3((x, y, z)), to_unit_quaternion((a, b, c, d))
    except (TypeError, ValueError, OverflowError):
        return None


def eulerXYZ_to_quatXYZW(rotation: Sequence[float]) -> Quat:
    """Roll, pitch, yaw in radians (fixed axes x, then y, then z) to (x, y, z, w)."""
    roll, pitch, yaw = (float(angle) / 2 for angle in rotation)
    cr, sr, cp, sp, cy, sy = (np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw))
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    return to_unit_quaternion((x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy))


def quatXYZW_to_eulerXYZ(quaternion_xyzw: Sequence[float]) -> Vec3:
    """(x, y, z, w) to roll, pitch, yaw in radians (fixed axes)."""
    x, y, z, w = to_unit_quaternion(quaternion_xyzw)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return (float(roll), float(pitch), float(yaw))


def yaw_of_quaternion(quaternion: Sequence[float]) -> float:
    """The rotation about the vertical, radians in (-pi, pi]."""
    x, y, z, w = to_unit_quaternion(quaternion)
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def angle_between_up_axes(first: Sequence[float], second: Sequence[float]) -> float:
    """The angle (rad) between the z axes of two rotations (x, y, z, w)."""

    def up_axis(quaternion: Sequence[float]) -> tuple[float, float, float]:
        x, y, z, w = quaternion
        return (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))

    cosine = sum(a * b for a, b in zip(up_axis(first), up_axis(second), strict=True))
    return math.acos(max(-1.0, min(1.0, cosine)))


def quaternion_to_matrix(quaternion: Sequence[float]) -> FloatArray:
    """The 3 x 3 matrix of (x, y, z, w)."""
    x, y, z, w = to_unit_quaternion(quaternion)
    first = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]
    second = [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]
    return np.array([first, second, [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def matrix_to_quaternion(rotation: FloatArray) -> Quat:
    """A 3 x 3 rotation matrix as (x, y, z, w) with w >= 0."""
    w = math.sqrt(max(0.0, 1 + float(np.trace(rotation)))) / 2
    signs = (rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1])
    squares = (1 + 2 * np.diagonal(rotation) - np.trace(rotation)).clip(0.0) / 4
    xyz = [math.copysign(math.sqrt(square), sign) for square, sign in zip(squares.tolist(), signs, strict=True)]
    if w < 1e-6:  # half a turn: the signs come from the products
        axis = int(np.argmax(np.abs(xyz)))
        xyz = [abs(value) * (1 if i == axis else math.copysign(1, rotation[axis, i])) for i, value in enumerate(xyz)]
    norm = math.sqrt(sum(value * value for value in xyz) + w * w)
    return (xyz[0] / norm, xyz[1] / norm, xyz[2] / norm, w / norm)


def multiply_quaternions(first: Sequence[float], second: Sequence[float]) -> Quat:
    """The rotation ``second`` followed by ``first``."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    x, y = aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx
    return to_unit_quaternion((x, y, aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz))


def angle_between(first: Sequence[float], second: Sequence[float]) -> float:
    """The angle (rad) between two unit quaternions."""
    return 2 * math.acos(min(1.0, abs(sum(a * b for a, b in zip(first, second, strict=True)))))


def compose_poses(pose0: Pose, pose1: Pose) -> Pose:
    """``pose1``, given in the frame of ``pose0``, in the frame that ``pose0`` is given in."""
    position = np.asarray(pose0[0], dtype=np.float64) + quaternion_to_matrix(pose0[1]) @ np.asarray(pose1[0])
    return (to_vec3(position), multiply_quaternions(to_unit_quaternion(pose0[1]), to_unit_quaternion(pose1[1])))


def invert_pose(pose: Pose) -> Pose:
    """The inverse transform: multiplied with ``pose``, it gives the identity."""
    x, y, z, w = to_unit_quaternion(pose[1])
    back: Quat = (-x, -y, -z, w)
    return (to_vec3(-(quaternion_to_matrix(back) @ np.asarray(pose[0], dtype=np.float64))), back)


def transform_points(pose: Pose, position: FloatArray | Sequence[float]) -> FloatArray:
    """Transform one point (3,) or many points (3, N) by ``pose``."""
    points = np.asarray(position, dtype=np.float64)
    offset = np.asarray(pose[0], dtype=np.float64)
    return quaternion_to_matrix(pose[1]) @ points + (offset if points.ndim == 1 else offset[:, None])


def pose_matrix(turn: FloatArray, shift: FloatArray) -> FloatArray:
    """(4, 4) of a rotation (3, 3) and a shift (3,), m."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


def rotation_about_z(yaw: float) -> FloatArray:
    """(3, 3) by an angle, rad."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])


def rotation_about_axis(axis: FloatArray, angle: float) -> FloatArray:
    """(3, 3) about an axis (3,) of any length, by an angle, rad."""
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
