"""Join the pieces of one flat thing that another thing in front of it separates in the picture."""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.image_geometry import Labels, hull_of, outline_of, percentiles, values_at
from grs_agents.perception.segmentation.patches import Depth
from grs_agents.perception.types import Array, Mask, RGBDFrame

LEVEL = 0.01
"""Tops of two pieces of one thing are within this height (m) of each other."""
FLAT = 0.45
"""At least this share of a piece lies within `LEVEL` of its top."""
HUE = 0.05
"""Colours of one thing are this near: distance of the shares of red, green and blue."""
BRIGHTNESS = 1.6
"""The brighter piece is at most this many times as bright."""
BETWEEN = 0.6
"""At least this share of the shortest way between two pieces lies on one thing that hides them."""
LONGEST = 0.4
"""A joined thing is at most this long (m)."""


@dataclass(frozen=True)
class Piece:
    """A segment: its top (m), how much of it is flat, mean colour (3,), outline (M, 2 columns and rows), footprint."""

    top: float
    flat: float
    color: Array
    outline: Array
    footprint: Array


def join_hidden(labels: Labels, frame: RGBDFrame, points: Array) -> Labels:
    """(H, W) labels, 1..N, with the separated pieces joined; ``points`` are (H, W, 3) in the robot frame."""
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    pieces = {label: _piece(labels == label, frame, points) for label in range(1, len(numbers))}
    for one, first in pieces.items():
        for other, second in pieces.items():
            if one < other and _alike(first, second) and _hidden(first, second, labels, frame.depth):
                numbers[numbers == numbers[other]] = numbers[one]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


def _piece(mask: Mask, frame: RGBDFrame, points: Array) -> Piece:
    cloud = values_at(points, mask)
    cloud = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)[::5]
    top = float(percentiles(cloud[:, 2], [90])[0])
    flat = float((np.abs(cloud[:, 2] - top) < LEVEL).mean())
    outline = outline_of(mask)[::3].astype(np.float64)
    return Piece(top, flat, values_at(frame.rgb, mask).mean(axis=0), outline, hull_of(cloud))


def _alike(one: Piece, other: Piece) -> bool:
    if abs(one.top - other.top) > LEVEL or min(one.flat, other.flat) < FLAT:
        return False
    bright, dark = max(one.color.sum(), other.color.sum()), min(one.color.sum(), other.color.sum())
    hue = np.linalg.norm(one.color / one.color.sum() - other.color / other.color.sum()) if dark else np.inf
    both = np.concatenate([one.footprint, other.footprint])
    _, sides, _ = cv2.minAreaRect(both.astype(np.float32))
    return bool(hue < HUE and bright < BRIGHTNESS * dark and max(sides) < LONGEST)


def _hidden(one: Piece, other: Piece, labels: Labels, depth: Depth) -> bool:
    """Whether the shortest way between two pieces leads over a thing that is nearer than they are."""
    squares = ((one.outline[:, None] - other.outline[None]) ** 2).sum(axis=2)
    start, end = np.unravel_index(int(squares.argmin()), squares.shape)
    count = int(np.sqrt(squares.min()))
    if count < 4:
        return False
    share = np.linspace(0, 1, count)
    way = np.rint(one.outline[start] + share[:, None] * (other.outline[end] - one.outline[start])).astype(int)
    rows, columns = way[1:-1, 1], way[1:-1, 0]
    between = np.bincount(labels[rows, columns])
    between[0] = 0
    along = depth[way[:, 1], way[:, 0]].astype(np.float64)
    ends = along[[0, -1]]
    nearer = along[1:-1] < ends[0] + share[1:-1] * (ends[1] - ends[0])
    return bool(between.max() >= BETWEEN * len(rows) and nearer.mean() >= BETWEEN)
