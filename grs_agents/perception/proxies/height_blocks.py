"""Things whose top or underside is stepped: what they fill over a grid as a few upright boxes."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3

Floats = npt.NDArray[np.float64]
Block = tuple[Vec3, Vec3]
"""Size and centre of a box, m."""
MOST = (24, 14)
"""At most so many boxes; fewer where those leave out too much."""
KEPT = 0.7
"""Together they have at least this share of the measured extents."""
LEVEL = 0.006
"""Heights that differ by less than this (m) on average are one."""
THINNEST = 0.003
"""What is lower than this (m) is nothing."""
STEADY = 0.005
"""What stands has the centre of its mass at least so far (m) within its foot."""
DIRECTIONS = 32


@dataclass(frozen=True)
class Columns:
    """What a thing may fill of a box, over each cell of a grid spread evenly over the box's x (rows) and y (columns).

    Attributes:
        floors, heights: (R, C) where it begins and ends, m above the bottom of the box.
        firm: (R, C) cells in which another thing stands for certain: there it begins no lower and ends no higher.
    """

    floors: Floats
    heights: Floats
    firm: npt.NDArray[np.bool_]

    @classmethod
    def up_to(cls, heights: Floats) -> "Columns":
        """From the bottom to heights (R, C), m, with no other thing near."""
        return cls(np.zeros_like(heights), heights, np.zeros(heights.shape, np.bool_))

    def part(self, rows: range, columns: range) -> "Columns":
        """Some of the cells."""
        window = (slice(rows.start, rows.stop), slice(columns.start, columns.stop))
        return Columns(self.floors[window], self.heights[window], self.firm[window])


@dataclass(frozen=True)
class _Patch:
    """Cells of a grid, and the one floor and the one height (m) that stand for them.

    ``off`` is what those are off them in sum, m, or more where others stand; ``uneven`` the sum of squares about their
    means.
    """

    rows: range
    columns: range
    floor: float
    height: float
    off: float
    uneven: float


def whole_relief(fill: Columns, size: Vec3) -> list[Block]:
    """Boxes that fill the columns of a box of ``size`` (m), nearly as large together; none where none do.

    They stand, unless there is something below that they may lean on.
    """
    for apart, most in product((True, False), MOST):
        blocks = relief_blocks(fill, size, most, apart)
        if blocks and _reaches(blocks, size) and (stands(blocks) or fill.floors.any()):
            return blocks
    return []


def relief_blocks(fill: Columns, size: Vec3, most: int = MOST[0], apart: bool = False) -> list[Block]:
    """At most so many boxes that fill the columns of a box of ``size`` (m), in its frame about its centre."""
    counts = fill.heights.shape
    patches = [_patch(fill, range(counts[0]), range(counts[1]), apart)]
    while len(patches) < most:
        worst = max(patches, key=lambda patch: patch.off)
        if worst.off <= LEVEL * len(worst.rows) * len(worst.columns):
            break
        patches.remove(worst)
        patches += _split(fill, worst, apart)
    cell = (size[0] / counts[0], size[1] / counts[1])
    return [_block(patch, cell, size) for patch in patches if patch.height - patch.floor >= THINNEST]


def _reaches(blocks: list[Block], size: Vec3) -> bool:
    """Whether boxes together are about as large as what was measured."""
    low, high = reach(blocks)
    return bool((high - low >= KEPT * np.array(size)).all())


def reach(blocks: list[Block]) -> tuple[Floats, Floats]:
    """The lowest and the highest corner, (3,) m, of boxes together."""
    low = np.min([np.subtract(center, np.array(size) / 2) for size, center in blocks], axis=0)
    high = np.max([np.add(center, np.array(size) / 2) for size, center in blocks], axis=0)
    return low, high


def stands(blocks: list[Block]) -> bool:
    """Whether boxes together stand on the lowest of them: the centre of their mass is above what touches the ground."""
    sizes, centers = (np.array(part) for part in zip(*blocks, strict=True))
    middle = np.average(centers[:, :2], axis=0, weights=sizes.prod(axis=1))
    bottoms = centers[:, 2] - sizes[:, 2] / 2
    foot = bottoms < bottoms.min() + THINNEST
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    reaches = (centers[foot, :2] - middle) @ ways.T + sizes[foot, :2] / 2 @ np.abs(ways).T
    return bool(reaches.max(axis=0).min() > STEADY)


def stretched(blocks: list[Block], size: Vec3) -> list[Block]:
    """Boxes, moved and stretched so that together they fill a box of ``size`` about the origin from end to end."""
    low, high = reach(blocks)
    scale, middle = np.array(size) / (high - low), (low + high) / 2
    found: list[Block] = []
    for extents, center in blocks:
        x, y, z = (float(value) for value in (center - middle) * scale)
        length, width, height = (float(value) for value in extents * scale)
        found.append(((length, width, height), (x, y, z)))
    return found


def relief_off(points: Floats, blocks: list[Block]) -> float:
    """How far points (N, 3) lie from the surface of boxes together, on average, m."""
    inside = np.full(len(points), np.inf)
    for size, center in blocks:
        beyond = np.abs(points - center) - np.asarray(size) / 2
        outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
        inside = np.minimum(inside, outside + np.minimum(beyond.max(axis=1), 0))
    return float(np.abs(inside).mean())


def _patch(fill: Columns, rows: range, columns: range, apart: bool) -> _Patch:
    part = fill.part(rows, columns)
    floor, height = float(np.median(part.floors)), float(np.median(part.heights))
    if apart:
        floor = max(floor, float(part.floors[part.firm].max(initial=0.0)))
        height = min(height, float(part.heights[part.firm].min(initial=np.inf)))
    lower, higher = part.floors - floor, height - part.heights
    off = float(np.abs(lower).sum() + np.abs(higher).sum())
    entered = float(np.maximum(lower, higher)[part.firm].max(initial=0.0)) * part.firm.size
    uneven = float((part.floors.var() + part.heights.var()) * part.firm.size)
    return _Patch(rows, columns, floor, height, max(off, entered), uneven)


def _split(fill: Columns, patch: _Patch, apart: bool) -> tuple[_Patch, _Patch]:
    """The two parts, cut straight, each most even in itself."""
    rows, columns = patch.rows, patch.columns
    ways = [
        (_patch(fill, range(rows.start, cut), columns, apart), _patch(fill, range(cut, rows.stop), columns, apart))
        for cut in rows[1:]
    ] + [
        (_patch(fill, rows, range(columns.start, cut), apart), _patch(fill, rows, range(cut, columns.stop), apart))
        for cut in columns[1:]
    ]
    return min(ways, key=lambda parts: parts[0].uneven + parts[1].uneven)


def _block(patch: _Patch, cell: tuple[float, float], size: Vec3) -> Block:
    x = (patch.rows.start + patch.rows.stop) / 2 * cell[0] - size[0] / 2
    y = (patch.columns.start + patch.columns.stop) / 2 * cell[1] - size[1] / 2
    extents = (len(patch.rows) * cell[0], len(patch.columns) * cell[1], patch.height - patch.floor)
    return extents, (x, y, (patch.floor + patch.height - size[2]) / 2)
