"""Things whose top or underside is stepped: what they fill over a grid as a few upright boxes."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.geometry import to_vec3

Floats = npt.NDArray[np.float64]
Block = tuple[Vec3, Vec3]  # size and centre of a box, m
MAX_BLOCKS = (24, 14)  # at most so many boxes; fewer where those leave out too much
KEPT = 0.7  # together they have at least this share of the measured extents
LEVEL = 0.006  # heights that differ by less than this (m) on average are one
THINNEST = 0.003  # what is lower than this (m) is nothing
STEADY = 0.005  # what stands has the centre of its mass at least so far (m) within its foot
DIRECTIONS = 32


@dataclass(frozen=True)
class FreeColumns:
    """What an object may fill of a box: over each cell of an even grid over its x (rows) and y (columns)."""

    floors: Floats  # floors, heights: (R, C) where it begins and ends, m above the bottom of the box
    heights: Floats
    # (R, C) cells in which another object stands for certain: there it begins no lower and ends no higher
    occupied: npt.NDArray[np.bool_]

    @classmethod
    def from_heights(cls, heights: Floats) -> "FreeColumns":
        """From the bottom to heights (R, C), m, with no other object near."""
        return cls(np.zeros_like(heights), heights, np.zeros(heights.shape, np.bool_))


@dataclass(frozen=True)
class _Patch:
    """Cells of a grid, and the one floor and the one height (m) that stand for them."""

    rows: range
    columns: range
    floor: float
    height: float
    off: float  # what the cells are off these in sum, m; more where others stand
    uneven: float  # sum of squares about the means


def fit_height_blocks(fillable: FreeColumns, size: Vec3) -> list[Block]:
    """Boxes that fill the columns of a box of ``size`` (m), nearly as large together; none where none do.
    They stand, unless there is something below that they may lean on."""
    for apart, most in product((True, False), MAX_BLOCKS):
        blocks = split_into_blocks(fillable, size, most, apart)
        low, high = bounds_of_blocks(blocks) if blocks else (0.0, 0.0)
        if np.all(np.subtract(high, low) >= KEPT * np.array(size)) and (
            are_blocks_stable(blocks) or fillable.floors.any()
        ):
            return blocks
    return []


def split_into_blocks(fillable: FreeColumns, size: Vec3, most: int = MAX_BLOCKS[0], apart: bool = False) -> list[Block]:
    """At most so many boxes that fill the columns of a box of ``size`` (m), in its frame about its centre."""
    counts = fillable.heights.shape
    patches = [_fit_patch(fillable, range(counts[0]), range(counts[1]), apart)]
    while len(patches) < most:
        worst = max(patches, key=lambda patch: patch.off)
        if worst.off <= LEVEL * len(worst.rows) * len(worst.columns):
            break
        patches.remove(worst)
        patches += _split_patch(fillable, worst, apart)
    cell = (size[0] / counts[0], size[1] / counts[1])
    return [_block_from_patch(patch, cell, size) for patch in patches if patch.height - patch.floor >= THINNEST]


def bounds_of_blocks(blocks: list[Block]) -> tuple[Floats, Floats]:
    """The lowest and the highest corner, (3,) m, of boxes together."""
    low = np.min([np.subtract(center, np.array(size) / 2) for size, center in blocks], axis=0)
    return low, np.max([np.add(center, np.array(size) / 2) for size, center in blocks], axis=0)


def are_blocks_stable(blocks: list[Block]) -> bool:
    """Whether boxes together stand on the lowest of them: the centre of their mass is above what touches the ground."""
    sizes, centers = (np.array(part) for part in zip(*blocks, strict=True))
    middle = np.average(centers[:, :2], axis=0, weights=sizes.prod(axis=1))
    bottoms = centers[:, 2] - sizes[:, 2] / 2
    foot = bottoms < bottoms.min() + THINNEST
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    reaches = (centers[foot, :2] - middle) @ ways.T + sizes[foot, :2] / 2 @ np.abs(ways).T
    return bool(reaches.max(axis=0).min() > STEADY)


def stretch_blocks_to_size(blocks: list[Block], size: Vec3) -> list[Block]:
    """Boxes, moved and stretched so that together they fill a box of ``size`` about the origin from end to end."""
    low, high = bounds_of_blocks(blocks)
    scale, middle = np.array(size) / (high - low), (low + high) / 2
    return [(to_vec3(extents * scale), to_vec3((center - middle) * scale)) for extents, center in blocks]


def mean_distance_to_blocks(points: Floats, blocks: list[Block]) -> float:
    """How far points (N, 3) lie from the surface of boxes together, on average, m."""
    apart = [signed_distances_from_sides(np.abs(points - center) - np.asarray(size) / 2) for size, center in blocks]
    return float(np.abs(np.min(apart, axis=0)).mean()) if apart else math.inf


def signed_distances_from_sides(beyond: Floats) -> Floats:
    """(N,) distances from a surface, negative inside, of points so far (N, D) beyond each of its sides."""
    return np.linalg.norm(np.clip(beyond, 0, None), axis=1) + np.minimum(beyond.max(axis=1), 0)


def _fit_patch(fillable: FreeColumns, rows: range, columns: range, apart: bool) -> _Patch:
    window = (slice(rows.start, rows.stop), slice(columns.start, columns.stop))
    floors, heights, occupied = fillable.floors[window], fillable.heights[window], fillable.occupied[window]
    floor, height = float(np.median(floors)), float(np.median(heights))
    if apart:
        floor = max(floor, float(floors[occupied].max(initial=0.0)))
        height = min(height, float(heights[occupied].min(initial=np.inf)))
    lower, higher = floors - floor, height - heights
    off = float(np.abs(lower).sum() + np.abs(higher).sum())
    entered = float(np.maximum(lower, higher)[occupied].max(initial=0.0)) * occupied.size
    uneven = float((floors.var() + heights.var()) * occupied.size)
    return _Patch(rows, columns, floor, height, max(off, entered), uneven)


def _split_patch(fillable: FreeColumns, patch: _Patch, apart: bool) -> tuple[_Patch, _Patch]:
    """The two parts, cut straight, each most even in itself."""
    rows, columns = patch.rows, patch.columns
    halves = [((range(rows.start, cut), columns), (range(cut, rows.stop), columns)) for cut in rows[1:]]
    halves += [((rows, range(columns.start, cut)), (rows, range(cut, columns.stop))) for cut in columns[1:]]
    pairs = [(_fit_patch(fillable, *first, apart), _fit_patch(fillable, *second, apart)) for first, second in halves]
    return min(pairs, key=lambda pair: pair[0].uneven + pair[1].uneven)


def _block_from_patch(patch: _Patch, cell: tuple[float, float], size: Vec3) -> Block:
    x = (patch.rows.start + patch.rows.stop) / 2 * cell[0] - size[0] / 2
    y = (patch.columns.start + patch.columns.stop) / 2 * cell[1] - size[1] / 2
    extents = (len(patch.rows) * cell[0], len(patch.columns) * cell[1], patch.height - patch.floor)
    return extents, (x, y, (patch.floor + patch.height - size[2]) / 2)
