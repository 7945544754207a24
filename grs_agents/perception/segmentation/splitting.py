"""Split segments that are two things: a thing is about convex or hollow, so what lies deep below the convex hull of its
own points and is not its inside belongs to something else."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from grs_agents.perception.image_geometry import Labels, components, is_open, percentiles, values_at, within
from grs_agents.perception.types import Array, Mask

DEEP = 0.0085
"""Points that lie on average this far (m) below the hull of them all are those of two things."""
SHARE = 0.033
"""And at least this share of the segment's length: a necked bottle is one thing."""
BETTER = 0.65
"""Split, they lie at most so much as far below the hulls of either part."""
SAMPLES = 400
DIRECTIONS = 162
YAWS, PLACES = 8, 7
"""A segment is cut at so many yaws, and in so many places along each and along its height."""
OUTLIERS = 1.5
"""Percent of the points at each end of each axis that are left out."""
FEWEST = 30
"""A part has at least so many of the samples."""


@dataclass(frozen=True)
class _Cut:
    """What is beyond ``place`` (m) along ``axis`` (3,) is the other part; ``off`` is what `_off` says of both, m."""

    axis: Array
    place: float
    off: float


def split(labels: Labels, points: Array, smallest: int) -> Labels:
    """(H, W) labels, 1..N, with what is two things cut in two.

    Args:
        labels: (H, W) segments.
        points: (H, W, 3) in the robot frame, NaN where unknown.
        smallest: pixels that a part has at least.
    """
    result, waiting = labels.copy(), list(range(1, int(labels.max()) + 1))
    while waiting:
        label = waiting.pop()
        whole: Mask = result == label
        cloud = values_at(points, whole)
        cut = _cut(cloud) if len(cloud) >= 2 * smallest else None
        if cut is None:
            continue
        beyond = np.zeros(labels.shape, np.bool_)
        beyond[whole] = cloud @ cut.axis > cut.place
        other = _tidied(beyond, whole, smallest)
        if min(int(other.sum()), len(cloud) - int(other.sum())) >= smallest:
            new = int(result.max()) + 1
            result[other] = new
            waiting += [label, new]
    return result


def _cut(cloud: Array) -> _Cut | None:
    """Where (N, 3) points are best cut in two; ``None`` if they are one thing."""
    known = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)
    known = known[:: len(known) // SAMPLES + 1]
    if len(known) < 2 * FEWEST:
        return None
    least, most = percentiles(known, (OUTLIERS, 100 - OUTLIERS))
    inner = known.compress(within(known, least, most), axis=0)
    before = _off(inner)
    if before < max(DEEP, SHARE * float(np.linalg.norm(most - least))) or is_open(inner, np.zeros((0, 3))):
        return None
    best: _Cut | None = None
    angles = np.arange(YAWS) * np.pi / YAWS
    for axis in (np.array([0.0, 0.0, 1.0]), *np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)):
        along = inner @ axis
        low, high = float(along.min()), float(along.max())
        for place in [low + (high - low) * step / (PLACES + 1) for step in range(1, PLACES + 1)]:
            one, other = inner[along <= place], inner[along > place]
            if min(len(one), len(other)) < FEWEST:
                continue
            off = (len(one) * _off(one) + len(other) * _off(other)) / len(inner)
            if off < BETTER * before and (best is None or off < best.off):
                best = _Cut(axis, place, off)
    return best


def _off(cloud: Array) -> float:
    """How far (N, 3) points lie below about their convex hull, on average, m."""
    reach = _directions() @ cloud.T
    return float((reach.max(axis=1, keepdims=True) - reach).min(axis=0).mean())


@cache
def _directions() -> Array:
    """(K, 3) unit vectors spread evenly over the sphere (Fibonacci lattice)."""
    number = np.arange(DIRECTIONS) + 0.5
    height, angle = 1 - 2 * number / DIRECTIONS, np.pi * (1 + 5**0.5) * number
    around = np.sqrt(1 - height**2)
    return np.stack([around * np.cos(angle), around * np.sin(angle), height], axis=1)


def _tidied(beyond: Mask, whole: Mask, smallest: int) -> Mask:
    """Which pixels of a segment (H, W) are beyond a cut, without islands on either side."""
    smooth = (cv2.medianBlur(beyond.astype(np.uint8), 5) > 0) & whole
    large = components(smooth.astype(np.uint8), smallest) > 0
    rest = components((whole & ~large).astype(np.uint8), smallest) > 0
    return whole & ~rest & (large | beyond)
