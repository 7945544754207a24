"""What rises above the table, seen from above, and the straight lines in it."""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.wall import SIDES
from grs_agents.perception.image_geometry import axes_from_yaws
from grs_agents.perception.types import Array


def raised_cells(cloud: Array) -> Array:
    """(N, 3) x, y and greatest height of the cells of the table that something rises over; from (M, 3) points."""
    cloud = cloud[(cloud[:, 2] > CONFIG.raised) & (cloud[:, 2] < CONFIG.highest)]
    if not len(cloud):
        return np.zeros((0, 3))
    index = np.floor(cloud[:, :2] / CONFIG.cell).astype(np.int64)
    index -= index.min(axis=0)
    keys, owners = np.unique(index[:, 0] * (index[:, 1].max() + 1) + index[:, 1], return_inverse=True)
    tops = np.zeros(len(keys))
    np.maximum.at(tops, owners, cloud[:, 2])
    count = np.bincount(owners)
    middle = [np.bincount(owners, cloud[:, axis]) / count for axis in (0, 1)]
    return np.stack([*middle, tops], axis=1)


def likely_axes(cells: Array) -> list[Array]:
    """(2, 2) each, the directions across the walls, the likeliest first: those in which outermost straight lines hold
    more than in any that is turned by a little. The picture's border cuts straight lines too."""
    yaws = np.deg2rad(np.arange(0, 90, CONFIG.turn))
    turned = [cells @ rotation_to_axes(axes) for axes in axes_from_yaws(yaws)]
    scores = np.array([sum(_longest_line(local, *side)[1] for side in SIDES) for local in turned])
    beside = [np.roll(scores, shift) for shift in range(-CONFIG.apart_yaws, CONFIG.apart_yaws + 1) if shift]
    peaks = np.flatnonzero(scores >= np.max(beside, axis=0))
    best = peaks[np.argsort(-scores[peaks], kind="stable")][: CONFIG.hypotheses]
    return list(axes_from_yaws(yaws[best]))


def rotation_to_axes(axes: Array) -> Array:
    """(3, 3) what turns rows of (N, 3) points into the bin's axes."""
    turn = np.eye(3)
    turn[:2, :2] = axes.T
    return turn


def _straight_lines(local: Array, axis: int, sign: float) -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Lines along a side, from the innermost: where they lie across it, m outward; how many centimetres of each are
    occupied; and the share of all that lies beyond. ``local`` are (N, 3) cells in the bin's axes."""
    across, along = sign * local[:, axis], local[:, 1 - axis]
    bins = ((across - across.min()) / CONFIG.line).astype(np.int64)
    places = ((along - along.min()) / CONFIG.line).astype(np.int64)
    grid = np.zeros((bins.max() + 4, places.max() + 1), np.bool_)
    grid[bins, places] = True
    held = (grid[:-3] | grid[1:-2]).sum(axis=1)
    within = np.cumsum(np.bincount(bins, minlength=len(grid)))
    beyond = 1 - within[3:] / len(local)
    return across.min() + (np.arange(len(held)) + 1) * CONFIG.line, held, beyond


def _longest_line(local: Array, axis: int, sign: float) -> tuple[float, int]:
    """Of the lines along a side that hardly anything lies beyond, where the longest lies and its length, m and cm."""
    places, held, beyond = _straight_lines(local, axis, sign)
    held[beyond > CONFIG.outside] = 0
    best = int(np.argmax(held))
    return float(places[best]), int(held[best])


def possible_rim_places(local: Array, number: int, level: float) -> list[float]:
    """Where across a side rims at ``level`` may lie, m outward."""
    rim = local[np.abs(local[:, 2] - level) < CONFIG.level]
    if not len(rim):
        return []
    axis, sign = SIDES[number]
    places, held, _ = _straight_lines(rim, axis, sign)
    limit = np.quantile(sign * local[local[:, 2] > level / 2, axis], 1 - CONFIG.outside) - CONFIG.strip
    peaks = held == np.asarray(cv2.dilate(held.astype(np.float32), np.ones((5, 5), np.uint8))).ravel()
    return [float(place) for place in places[peaks & (held * CONFIG.line > CONFIG.short) & (places > limit)]]


def outermost_places(low: Array, number: int) -> list[float]:
    """Where across a side straight lines lie that hardly anything is beyond, m outward, the outermost last."""
    axis, sign = SIDES[number]
    across = sign * low[:, axis]
    places, held, beyond = _straight_lines(low, axis, sign)
    held[beyond > CONFIG.stray] = 0
    peaks = held == np.asarray(cv2.dilate(held.astype(np.float32), np.ones((3, 3), np.uint8))).ravel()
    near = [np.abs(across - place) < CONFIG.line for place in places[peaks & (held > CONFIG.columns)]]
    return [float(np.median(across[own])) for own in near]


def rim_level(local: Array) -> float:
    """The height at which most of what rises along the outermost lines ends. What hides a rim lets its wall end
    anywhere below it."""
    tops = np.concatenate([_tops_along_line(local, *side) for side in SIDES])
    alike = np.abs(tops[:, None] - tops) < CONFIG.level / 2
    return float(np.median(tops[alike[int(np.argmax(alike.sum(axis=1)))]]))


def _tops_along_line(local: Array, axis: int, sign: float) -> Array:
    """(N,) the greatest heights, m, in each occupied centimetre of the longest line along a side."""
    place, _ = _longest_line(local, axis, sign)
    own = np.abs(sign * local[:, axis] - place) < CONFIG.strip
    _, owners = np.unique(np.floor(local[own, 1 - axis] / CONFIG.line).astype(np.int64), return_inverse=True)
    tops = np.zeros(int(owners.max(initial=-1)) + 1)
    np.maximum.at(tops, owners, local[own, 2])
    return tops
