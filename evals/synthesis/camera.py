"""Random camera poses: downward tilt, bearing, distance, roll and focal length."""

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.perception.types import Camera

Floats = npt.NDArray[np.float64]
MILLIMETRE = 0.001
LOWEST_TILT, HIGHEST_TILT = 20.0, 90.0
"""Downward tilt, degrees: 90 is straight from above."""
_ROLL = 4.0


def random_camera(tilt: float, target: Vec3, size: tuple[int, int], rng: np.random.Generator) -> Camera:
    """A calibrated camera that looks at about ``target``.

    Args:
        tilt: downward, degrees.
        target: m, robot frame.
        size: width and height of the picture in pixels.
        rng: source of bearing, distance (0.75 to 1.1 m), roll (4 degrees) and focal length (0.8 to 0.96 of the width).
    """
    width, height = size
    bearing, roll = float(rng.uniform(-np.pi, np.pi)), np.deg2rad(float(rng.normal(0, _ROLL / 2)))
    aim = np.array(target) + rng.normal(0, 0.02, 3)
    focal, distance = width * float(rng.uniform(0.80, 0.96)), float(rng.uniform(0.75, 1.1))
    rotation = camera_rotation(bearing, np.deg2rad(tilt), roll)
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, aim - distance * rotation[:, 2]
    return Camera(
        fx=focal,
        fy=focal,
        cx=(width - 1) / 2 + float(rng.normal(0, 0.008 * width)),
        cy=(height - 1) / 2 + float(rng.normal(0, 0.008 * height)),
        width=width,
        height=height,
        depth_scale=MILLIMETRE,
        T_robot_cam=tuple(tuple(round(float(value), 9) for value in row) for row in transform),
    )


def camera_rotation(bearing: float, tilt: float, roll: float) -> Floats:
    """The rotation (3, 3) from a camera's axes (x right, y down, z forward) to the robot frame.

    Args:
        bearing: of the view over the table, rad from x towards y.
        tilt: downward, rad.
        roll: about its own axis, rad.
    """
    forward = np.array([np.cos(tilt) * np.cos(bearing), np.cos(tilt) * np.sin(bearing), -np.sin(tilt)])
    right = np.array([np.sin(bearing), -np.cos(bearing), 0.0])
    down = np.cross(forward, right)
    turned = np.cos(roll) * right + np.sin(roll) * down
    return np.stack([turned, np.cross(forward, turned), forward], axis=1)
