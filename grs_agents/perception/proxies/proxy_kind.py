"""Which solid fits what was measured of an object: box, cylinder, bowl, open box, hull or height blocks.
The walls of hollow solids (open boxes and bowls) are parts of their own."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.perception.proxies.height_blocks import (
    Block,
    FreeColumns,
    fit_height_blocks,
    mean_distance_to_blocks,
    signed_distances_from_sides,
)
from grs_agents.perception.proxies.meshes import signed_distance_from_hull

Floats = npt.NDArray[np.float64]
WALL = 0.005  # how thick walls and floors are, m
_SEGMENTS = 12


def open_box_walls(size: Vec3) -> list[Block]:
    """Size and centre of the floor and the four walls of an open box."""
    x, y, z = size
    return [
        ((x, y, WALL), (0.0, 0.0, (WALL - z) / 2)),
        *(((WALL, y, z), (side * (x - WALL) / 2, 0.0, 0.0)) for side in (1, -1)),
        *(((x, WALL, z), (0.0, side * (y - WALL) / 2, 0.0)) for side in (1, -1)),
    ]


def bowl_profile(size: Vec3) -> list[tuple[float, float]]:
    """The profile of a bowl, (radius, z) m, from its bottom's middle outwards and back in."""
    radius, half, foot = size[0] / 2, size[2] / 2, bowl_foot_radius(size)
    outside = [(foot, -half), ((foot + radius) / 2, 0), (radius, half)]
    inside = [(radius - WALL, half), (foot - WALL, WALL - half)]
    return [(0, -half), *outside, *inside, (0, WALL - half)]


def bowl_wall_pieces(size: Vec3) -> list[Floats]:
    """The corners (8, 3) of each piece of a bowl's wall."""
    half, foot, radius = size[2] / 2, bowl_foot_radius(size), size[0] / 2
    angles = np.arange(_SEGMENTS + 1) * 2 * np.pi / _SEGMENTS
    rings = [(foot, -half), (foot - WALL, -half), (radius, half), (radius - WALL, half)]
    pairs = (angles[at : at + 2] for at in range(_SEGMENTS))
    return [
        np.array([[r * math.cos(angle), r * math.sin(angle), z] for r, z in rings for angle in pair]) for pair in pairs
    ]


def inside_walls_mask(points: Floats, size: Vec3, around: bool, wall: float = WALL) -> npt.NDArray[np.bool_]:
    """Which of points (N, 3) in the box of an open box or bowl, about its centre, are in its walls or floor, (N,)."""
    x, y, z = (part / 2 for part in size)
    floor = points[:, 2] < wall - z
    if not around:
        return floor | (np.abs(points[:, 0]) > x - wall) | (np.abs(points[:, 1]) > y - wall)
    foot, radius = bowl_foot_radius(size), np.hypot(points[:, 0], points[:, 1])
    outer = foot + (x - foot) * (points[:, 2] / z + 1) / 2
    return (radius < outer) & (floor | (radius > outer - wall))


def bowl_foot_radius(size: Vec3) -> float:
    """The radius of a bowl's foot: what is flat has a small one, a mug is as wide below as above."""
    return size[0] / 2 * (0.65 if size[2] < 0.6 * size[0] else 1.0)


def size_with_mean_diameter(size: Vec3) -> Vec3:
    """The extents of a round object whose diameter is the mean of two."""
    diameter = round((size[0] + size[1]) / 2, 5)
    return (diameter, diameter, round(size[2], 5))


ProxyKind = Literal["box", "cylinder", "bowl", "open box", "hull", "height blocks"]
_OFF, _BETTER = 0.004, 0.6
"""Points that are more than this (m) off box and cylinder are given their hull, if that is so much nearer."""
_FEWEST = 50
_FLAT = 0.004
"""What of a hull is so near (m) to its top is flat: noise would make that pointed, and no cup would seal on it."""
_NEARLY = 0.001
"""Of what is hollow and has others in its box height blocks may be so much (m) farther off: they leave those out."""
_WASTED = 0.25
"""A solid of which a larger share than this stands in the air that the photo shows, or where others stand, is none."""
_WRONG, _NOT_HOLLOW, _HALF = 0.008, 0.012, 0.5
"""Points that are more than this (m) off a solid, or a hollow one, are not its: height blocks are, if they halve it."""


@dataclass(frozen=True)
class MeasuredShape:
    """What the photo tells of an object's shape, in the frame of its measured box."""

    points: Floats  # (N, 3) m, about the centre of the box, along its axes
    fillable: FreeColumns | None = None  # what it may fill of the box at most; ``None`` if unknown
    crowded: bool = False  # other objects stand in the box


def choose_proxy_kind(measured: MeasuredShape, size: Vec3, around: bool, hollow: bool) -> ProxyKind:
    """Which solid fits best an object with a box of ``size`` (m), a round footprint or not, hollow or not."""
    plain: ProxyKind = "cylinder" if around else "box"
    if hollow and min(size) > 4 * WALL:
        plain = "bowl" if around else "open box"
    points = measured.points
    if plain == "bowl" or len(points) < _FEWEST:
        return plain
    off = mean_distance_to_solid(points, size, plain)
    if measured.fillable is not None and _do_blocks_fit(measured.fillable, measured, size, plain, off):
        return "height blocks"
    if plain == "open box" or off <= _OFF:
        return plain
    off_hull = np.abs(signed_distance_from_hull(add_unseen_side(points, size), points)).mean()
    return "hull" if off_hull < _BETTER * off else plain


def _do_blocks_fit(fillable: FreeColumns, measured: MeasuredShape, size: Vec3, plain: ProxyKind, off: float) -> bool:
    """Whether boxes that fill the columns stand for an object better than a solid whose surface is so far off, m."""
    wasted = plain != "open box" and (
        measured.crowded or _fraction_in_free_space(fillable.heights, size, plain == "cylinder") > _WASTED
    )
    if wasted or measured.crowded:
        bound = off + (_OFF if wasted else _NEARLY)
    elif off > (_NOT_HOLLOW if plain == "open box" else _WRONG):
        bound = _HALF * off
    else:
        return False
    blocks = fit_height_blocks(fillable, size)
    return bool(blocks) and mean_distance_to_blocks(measured.points, blocks) < bound


def mean_distance_to_solid(points: Floats, size: Vec3, kind: ProxyKind) -> float:
    """Mean distance (m) of points (N, 3) about its centre from the surface of a box, cylinder or open box of a size."""
    if kind == "open box":
        return mean_distance_to_blocks(points, open_box_walls(size))
    if kind != "cylinder":
        return mean_distance_to_blocks(points, [(size, (0.0, 0.0, 0.0))])
    radius = (size[0] + size[1]) / 4
    beyond = np.column_stack([np.hypot(points[:, 0], points[:, 1]) - radius, np.abs(points[:, 2]) - size[2] / 2])
    return float(np.abs(signed_distances_from_sides(beyond)).mean())


def add_unseen_side(points: Floats, size: Vec3) -> Floats:
    """(M, 3) points with their unseen side, taken to be like the seen one turned round, in a box of ``size``."""
    half = np.asarray(size) / 2
    kept = np.clip(points, -half, half)
    kept[kept[:, 2] > half[2] - _FLAT, 2] = half[2]
    whole = np.concatenate([kept, kept * (-1, -1, 1)])
    low = whole[whole[:, 2] < -0.2 * half[2]]
    foot = (low if len(low) else whole) * (1, 1, 0) - (0, 0, half[2])
    whole = np.concatenate([whole, foot])
    return whole * half / np.maximum(np.abs(whole).max(axis=0), 1e-9)


def _fraction_in_free_space(heights: Floats, size: Vec3, around: bool) -> float:
    """Which share of a box or cylinder of a size is higher than it may be; at edges the grid is too coarse to tell."""
    rows, columns = heights.shape
    framed = np.pad(heights, 1, mode="edge")
    highest = np.max([framed[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
    across = (np.indices(heights.shape).transpose(1, 2, 0) + 0.5) / heights.shape * 2 - 1
    inside = (np.linalg.norm(across, axis=2) <= 1) | (not around)
    return float(np.clip(1 - highest[inside] / size[2], 0, 1).mean())
