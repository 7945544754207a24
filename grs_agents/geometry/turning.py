"""Turns and poses as matrices."""

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def pose_of(turn: Array, shift: Array) -> Array:
    """(4, 4) of a rotation (3, 3) and a shift (3,), m."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


def about_z(yaw: float) -> Array:
    """(3, 3) by an angle, rad."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])


def about(axis: Array, angle: float) -> Array:
    """(3, 3) about an axis (3,) of any length, by an angle, rad."""
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
