"""One wall of a bin, in the bin's axes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.types import Array, Mask

SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))
"""Axis across each wall, and the sign of its outward side."""


@dataclass(frozen=True)
class Wall:
    """A wall in the bin's axes: from ``inner`` to ``outer`` across, outward positive, ``start`` to ``end`` along; m."""

    side: int  # of `SIDES`
    inner: float
    outer: float
    start: float
    end: float
    height: float

    @property
    def middle(self) -> float:
        return (self.inner + self.outer) / 2


def rim_points(wall: Wall, axes: Array, start: float, end: float) -> Array:
    """(N, 3) points along the middle of a wall's rim, robot frame."""
    axis, sign = SIDES[wall.side]
    along = np.arange(start, end, CONFIG.line)
    across = np.full(len(along), sign * wall.middle)
    local = np.stack([across, along] if axis == 0 else [along, across], axis=1)
    return np.column_stack([local @ axes, np.full(len(along), wall.height)])


def side_points(wall: Wall, place: float, axes: Array) -> Array:
    """(N, 3) points of a wall's side at a place across, robot frame, from its rim down to the lowest that is raised."""
    rim = rim_points(replace(wall, inner=place, outer=place), axes, wall.start, wall.end)
    heights = np.arange(wall.height, CONFIG.raised, -CONFIG.line)
    return np.concatenate([np.column_stack([rim[:, :2], np.full(len(rim), height)]) for height in heights])


def extend_to_corners(wall: Wall, walls: dict[int, Wall]) -> Wall:
    """A wall that reaches to the outsides of those that it meets, and beyond the picture where it meets none."""
    first = 2 * (1 - SIDES[wall.side][0])
    low, high = walls.get(first), walls.get(first + 1)
    start = -low.outer if low else wall.start - CONFIG.open
    end = high.outer if high else wall.end + CONFIG.open
    return Wall(wall.side, wall.inner, wall.outer, start, end, wall.height)


def outside_mask(walls: Sequence[Wall], local: Array, eye: Array) -> Mask:
    """(N,) which of the (N, 3) points in the bin's axes are outside of a wall, but for those that the ``eye`` (3,) sees
    along its rim: their depth is mixed with the rim's."""
    out = np.zeros(len(local), np.bool_)
    for wall in walls:
        axis, sign = SIDES[wall.side]
        across, near = sign * local[:, axis], sign * eye[axis]
        beyond = across > wall.outer + CONFIG.strip
        share = (wall.middle - near) / np.where(beyond, across - near, np.inf)
        crossing = eye[2] + share * (local[:, 2] - eye[2])
        out |= beyond & ~((share > 0) & (np.abs(crossing - wall.height) < CONFIG.level))
    return out


def pixels_near_walls(
    walls: Sequence[Wall], axes: Array, points: Array, low: float, margins: tuple[float, float]
) -> Mask:
    """(H, W) the pixels of which the ``points`` (H, W, 3) are higher than ``low`` and within ``margins`` (m, beside it
    and over its rim) of a wall."""
    local = points[..., :2] @ axes.T
    found = np.zeros(points.shape[:2], np.bool_)
    margin, over = margins
    for wall in walls:
        axis, sign = SIDES[wall.side]
        across, along = sign * local[..., axis], local[..., 1 - axis]
        own = (across > wall.inner - margin) & (across < wall.outer + margin)
        own &= (along > wall.start - margin) & (along < wall.end + margin)
        found |= own & (points[..., 2] > low) & (points[..., 2] < wall.height + over)
    return found


def pixels_beyond_walls(walls: Sequence[Wall], axes: Array, points: Array, margin: float) -> Mask:
    """(H, W) the pixels of which the ``points`` (H, W, 3) lie farther than ``margin``, m, outside of a wall."""
    local = points[..., :2] @ axes.T
    beyond = np.zeros(points.shape[:2], np.bool_)
    for wall in walls:
        axis, sign = SIDES[wall.side]
        beyond |= sign * local[..., axis] > wall.outer + margin
    return beyond
