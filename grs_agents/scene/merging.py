"""Merge the segments that are parts of one object: what lies inside, the walls of hollow things, parts that nothing
carries, and small tops such as caps."""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.scene.frame import Array
from grs_agents.scene.geometry import Labels, inside_hull

TOUCHING = 0.012
"""Segments nearer than this (m) touch."""
LEVEL = 0.015
"""Rims within this height (m) of each other are one rim."""
WALL = 0.022
"""What is thinner than this (m) may be a wall."""
CAP = 0.045
"""What is smaller than this (m) across, on top of something, is part of it."""
CELL = 0.006
"""Footprints are counted in squares of this side (m)."""
CARRIED = 0.013
"""What hangs higher than this (m) above the table wants a support."""


@dataclass(frozen=True)
class Part:
    """A segment in the robot frame.

    Attributes:
        cloud: (N, 3) points, metres; a sample of at most 1500.
        hull: (M, 2) corners of its footprint.
        width, length: of its footprint, metres.
        bottom, top: metres above the table.
        flat: share of its footprint that is closed at its top.
        count: how many pixels it has.
    """

    cloud: Array
    hull: Array
    width: float
    length: float
    bottom: float
    top: float
    flat: float
    count: int

    @property
    def hollow(self) -> bool:
        """A thin wall, or a slope without a top: what hollow things are made of."""
        return self.width < WALL or self.flat < 0.45


def part_of(points: Array) -> Part | None:
    """Measure a segment's (N, 3) points; ``None`` where too few are known."""
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < 20:
        return None
    low, high = np.percentile(known, 2, axis=0), np.percentile(known, 98, axis=0)
    inner = known[((known >= low) & (known <= high)).all(axis=1)]
    inner = inner if len(inner) >= 20 else known
    footprint = inner[:, :2].astype(np.float32)
    hull = cv2.convexHull(footprint).reshape(-1, 2).astype(np.float64)
    _, sides, _ = cv2.minAreaRect(footprint)
    upper = inner[inner[:, 2] > high[2] - 0.012]
    cells = len(np.unique(np.floor(upper[:, :2] / CELL).astype(np.int64), axis=0))
    flat = cells * CELL**2 / max(float(cv2.contourArea(hull.astype(np.float32))), 1e-6)
    sample = inner[:: max(1, len(inner) // 1500)]
    return Part(sample, hull, min(sides), max(sides), float(low[2]), float(high[2]), flat, len(known))


def gap(one: Part, other: Part) -> float:
    """The smallest distance between two segments' points, metres."""
    if (one.cloud.min(axis=0) - other.cloud.max(axis=0)).max() > 0.05:
        return np.inf
    if (other.cloud.min(axis=0) - one.cloud.max(axis=0)).max() > 0.05:
        return np.inf
    near = one.cloud[::3][:, None, :] - other.cloud[::3][None, :, :]
    return float(np.sqrt((near**2).sum(axis=2).min()))


def covered(one: Part, other: Part, margin: float = 0.004) -> float:
    """Share of ``one``'s points over the footprint of ``other``."""
    return float(inside_hull(one.cloud[:, :2], other.hull, margin).mean())


def merge_parts(labels: Labels, points: Array) -> Labels:
    """(H, W) labels with the parts of each object merged; ``points`` are (H, W, 3) in the robot frame."""
    merged = labels.copy()
    parts: dict[int, Part] = {}
    for label in range(1, int(labels.max()) + 1):
        found = part_of(points[merged == label])
        if found is not None:
            parts[label] = found
    while True:
        pair = _next_pair(parts)
        if pair is None:
            return merged
        small, big = pair
        merged[merged == small] = big
        del parts[small]
        whole = part_of(points[merged == big])
        if whole is not None:
            parts[big] = whole


def _next_pair(parts: dict[int, Part]) -> tuple[int, int] | None:
    """The smallest segment that is part of another, and that other."""
    for small in sorted(parts, key=lambda label: parts[label].count):
        best: tuple[float, int] | None = None
        for big, other in parts.items():
            if big == small or other.count < parts[small].count:
                continue
            distance = gap(parts[small], other)
            if distance < 0.03 and _belongs(parts[small], other, distance, parts):
                if best is None or distance < best[0]:
                    best = distance, big
        if best is not None:
            return small, best[1]
    return None


def _belongs(small: Part, big: Part, distance: float, parts: dict[int, Part]) -> bool:
    level = abs(small.top - big.top) < LEVEL
    if small.hollow and big.hollow and level and distance < 0.025 and not _filled(small, big):
        return True
    share = covered(small, big)
    if share > 0.7 and small.top <= big.top + 0.008:
        return True  # inside it
    if distance > TOUCHING:
        return False
    if share > 0.2 and small.top <= big.top + 0.01 and big.hollow:
        return True  # the outside of a wall whose inside is the larger part
    on_top = share > 0.5 and small.bottom > big.top - 0.03
    if on_top and small.length < CAP and small.count < 0.4 * big.count:
        return True  # a cap
    if small.bottom < CARRIED or on_top:
        return False
    carriers = [other for other in parts.values() if other is not small and covered(small, other, 0.002) > 0.25]
    return not any(abs(other.top - small.bottom) < 0.025 for other in carriers)  # nothing carries it


def _filled(one: Part, other: Part) -> bool:
    """Whether two level segments together have a closed top, as solid things have."""
    both = part_of(np.concatenate([one.cloud, other.cloud]))
    return both is not None and both.flat > 0.6 and min(one.width, other.width) > WALL
