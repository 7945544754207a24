"""Which solid fits what was measured of an object: box, cylinder, bowl, open box, hull or relief.

The walls of hollow solids (open boxes and bowls) are parts of their own.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.perception.proxies.height_blocks import Block, Columns, relief_off, whole_relief
from grs_agents.perception.proxies.meshes import support

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


Fitted = Literal["box", "cylinder", "bowl", "open box", "hull", "relief"]
_OFF, _BETTER = 0.004, 0.6
"""Points that are more than this (m) off box and cylinder are given their hull, if that is so much nearer."""
_FEWEST = 50
_FLAT = 0.004
"""What of a hull is so near (m) to its top is flat: noise would make that pointed, and no cup would seal on it."""
_NEARLY = 0.001
"""Of what is hollow and has others in its box a relief may be so much (m) farther off: it leaves those out."""
_WASTED = 0.25
"""A solid of which a larger share than this stands in the air that the photo shows, or where others stand, is none."""
_WRONG, _NOT_HOLLOW, _HALF = 0.008, 0.012, 0.5
"""Points that are more than this (m) off a solid, or a hollow one, are not its: it is a relief, if that halves it."""


@dataclass(frozen=True)
class Measured:
    """What the photo tells of an object's shape, in the frame of its measured box.

    Attributes:
        points: (N, 3) m, about the centre of the box, along its axes.
        fill: what it may fill of the box at most; ``None`` if unknown.
        crowded: other things stand in the box.
    """

    points: Floats
    fill: Columns | None = None
    crowded: bool = False


def fitted_kind(measured: Measured, size: Vec3, around: bool, hollow: bool) -> Fitted:
    """Which solid fits best.

    Args:
        measured: of the object.
        size: of the measured box, m.
        around: its footprint is round.
        hollow: it is open at the top.
    """
    plain: Fitted = "cylinder" if around else "box"
    if hollow and min(size) > 4 * WALL:
        plain = "bowl" if around else "open box"
    points = measured.points
    if plain == "bowl" or len(points) < _FEWEST:
        return plain
    off: dict[Fitted, float] = {plain: _OFF_OF[plain](points, size)}
    solid = plain in ("box", "cylinder")
    if solid and off[plain] > _OFF:
        off["hull"] = float(np.abs(support(completed(points, size), points)).mean())
    best = min(off, key=lambda kind: off[kind])
    found = best if off[best] < _BETTER * off[plain] else plain
    if measured.fill is None:
        return found
    blocks = whole_relief(measured.fill, size)
    if not blocks:
        return found
    wasted = solid and (measured.crowded or _wasted(measured.fill.heights, size, around) > _WASTED)
    wrong = off[plain] > (_WRONG if solid else _NOT_HOLLOW)
    bound = _HALF * off[plain] if wrong else 0.0
    if wasted or measured.crowded:
        bound = off[plain] + (_OFF if wasted else _NEARLY)
    return "relief" if relief_off(points, blocks) < bound else found


def solid_off(points: Floats, size: Vec3, around: bool) -> float:
    """How far points (N, 3) about its centre lie from the surface of a box or cylinder of a size, on average, m."""
    return _OFF_OF["cylinder" if around else "box"](points, size)


def completed(points: Floats, size: Vec3) -> Floats:
    """(M, 3) points with their unseen side, taken to be like the seen one turned round, in a box of ``size``."""
    half = np.asarray(size) / 2
    kept = np.clip(points, -half, half)
    kept[kept[:, 2] > half[2] - _FLAT, 2] = half[2]
    whole = np.concatenate([kept, kept * (-1, -1, 1)])
    low = whole[whole[:, 2] < -0.2 * half[2]]
    foot = (low if len(low) else whole) * (1, 1, 0) - (0, 0, half[2])
    whole = np.concatenate([whole, foot])
    return whole * half / np.maximum(np.abs(whole).max(axis=0), 1e-9)


def _wasted(heights: Floats, size: Vec3, around: bool) -> float:
    """Which share of a box or cylinder of a size is higher than it may be; at edges the grid is too coarse to tell."""
    rows, columns = heights.shape
    framed = np.pad(heights, 1, mode="edge")
    highest = np.max([framed[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
    across = (np.indices(heights.shape).transpose(1, 2, 0) + 0.5) / heights.shape * 2 - 1
    inside = (np.linalg.norm(across, axis=2) <= 1) | (not around)
    return float(np.clip(1 - highest[inside] / size[2], 0, 1).mean())


def _box_off(points: Floats, size: Vec3) -> float:
    beyond = np.abs(points) - np.asarray(size) / 2
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return float(np.abs(outside + np.minimum(beyond.max(axis=1), 0)).mean())


def _cylinder_off(points: Floats, size: Vec3) -> float:
    radius = (size[0] + size[1]) / 4
    beyond = np.column_stack([np.hypot(points[:, 0], points[:, 1]) - radius, np.abs(points[:, 2]) - size[2] / 2])
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return float(np.abs(outside + np.minimum(beyond.max(axis=1), 0)).mean())


_OFF_OF: dict[Fitted, Callable[[Floats, Vec3], float]] = {
    "box": _box_off,
    "cylinder": _cylinder_off,
    "open box": lambda points, size: relief_off(points, slabs(size)),
}
"""How far points (N, 3) lie from the surface of a solid of a size on average, m."""
