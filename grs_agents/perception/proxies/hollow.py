"""The parts of hollow solids: the walls of open boxes and bowls."""

import math

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.perception.proxies.height_blocks import Block

Floats = npt.NDArray[np.float64]
WALL = 0.005
"""How thick walls and floors are, m."""
_SEGMENTS = 12


def slabs(size: Vec3) -> list[Block]:
    """Size and centre of the floor and the four walls of an open box."""
    x, y, z = size
    return [
        ((x, y, WALL), (0.0, 0.0, (WALL - z) / 2)),
        *(((WALL, y, z), (side * (x - WALL) / 2, 0.0, 0.0)) for side in (1, -1)),
        *(((x, WALL, z), (0.0, side * (y - WALL) / 2, 0.0)) for side in (1, -1)),
    ]


def bowl_profile(size: Vec3) -> list[tuple[float, float]]:
    """The profile of a bowl, (radius, z) m, from its bottom's middle outwards and back in."""
    radius, half, foot = size[0] / 2, size[2] / 2, foot_radius(size)
    return [(0, -half), (foot, -half), ((foot + radius) / 2, 0), (radius, half), (radius - WALL, half),
            (foot - WALL, WALL - half), (0, WALL - half)]  # fmt: skip


def staves(size: Vec3) -> list[Floats]:
    """The corners (8, 3) of each piece of a bowl's wall."""
    half, foot, radius = size[2] / 2, foot_radius(size), size[0] / 2
    angles = np.arange(_SEGMENTS + 1) * 2 * np.pi / _SEGMENTS
    rings = [(foot, -half), (foot - WALL, -half), (radius, half), (radius - WALL, half)]
    return [
        np.array([[r * math.cos(angle), r * math.sin(angle), z] for r, z in rings for angle in angles[at : at + 2]])
        for at in range(_SEGMENTS)
    ]


def in_walls(points: Floats, size: Vec3, around: bool, wall: float = WALL) -> npt.NDArray[np.bool_]:
    """Which of points (N, 3) in the box of an open box or bowl, about its centre, are in its walls or floor, (N,)."""
    x, y, z = (part / 2 for part in size)
    floor = points[:, 2] < wall - z
    if not around:
        return floor | (np.abs(points[:, 0]) > x - wall) | (np.abs(points[:, 1]) > y - wall)
    foot, radius = foot_radius(size), np.hypot(points[:, 0], points[:, 1])
    outer = foot + (x - foot) * (points[:, 2] / z + 1) / 2
    return (radius < outer) & (floor | (radius > outer - wall))


def foot_radius(size: Vec3) -> float:
    """The radius of a bowl's foot: what is flat has a small one, a mug is as wide below as above."""
    return size[0] / 2 * (0.65 if size[2] < 0.6 * size[0] else 1.0)


def round_size(size: Vec3) -> Vec3:
    """The extents of a round thing whose diameter is the mean of two."""
    diameter = round((size[0] + size[1]) / 2, 5)
    return (diameter, diameter, round(size[2], 5))
