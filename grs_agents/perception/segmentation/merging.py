"""Merge the patches that are parts of one object: the walls of hollow things, what lies inside them, handles and other
parts that hang in the air, and fragments."""

from dataclasses import dataclass
from functools import cached_property
from operator import sub

import cv2
import numpy as np

from grs_agents.perception.image_geometry import (
    Labels,
    hull_of,
    inside_hull,
    is_open,
    is_solid,
    percentiles,
    pixels_of,
    within,
)
from grs_agents.perception.segmentation.occlusion_edges import OcclusionEdges
from grs_agents.perception.types import Array

TOUCHING = 0.012
"""Parts nearer than this (m) touch."""
LEVEL = 0.02
"""Rims within this height (m) of each other are one rim."""
BESIDE = 0.02
"""Walls nearer than this (m) are one beside the other."""
RIM_GAP = 0.05
"""Ends of one rim are nearer than this (m)."""
WITHIN = 0.5
"""What has this share of its points over the footprint of another lies in it or on it: it is not its near wall."""
NARROW = 0.022
"""What is thinner than this (m) may be a wall, a handle or a fragment."""
THICK = 0.04
"""What is thicker than this (m) is no wall, however a bad sensor blurs it."""
FIN = (0.025, 0.065)
"""What is thinner and shorter than this (m) and sticks out of something higher is its tab, lip or fin."""
CAP = 0.045
"""What is smaller than this (m) across and lower, on top of something larger, is its cap."""
SHORTEST = 6
"""Parts whose border is shorter than this (pixels) do not go over into each other."""
CARRIED = 0.02
"""What hangs higher than this (m) above the table wants a support."""


@dataclass(frozen=True)
class Part:
    """A patch in the robot frame.

    Attributes:
        cloud: (N, 3) points, metres; a sample of at most 800.
        hull: (M, 2) corners of its footprint.
        width, length: of its footprint, metres.
        bottom, top: metres above the table.
        count: how many pixels it has.
    """

    cloud: Array
    hull: Array
    width: float
    length: float
    bottom: float
    top: float
    count: int

    @cached_property
    def ends(self) -> tuple[list[float], list[float]]:
        """Lowest and highest corner of the points, m."""
        return self.cloud.min(axis=0).tolist(), self.cloud.max(axis=0).tolist()

    @cached_property
    def lifted(self) -> tuple[Array, Array]:
        """(N, 5) and (5, N) of every other point: one part's first times another's second are squares of distances."""
        points = self.cloud[::2]
        squares = (points**2).sum(axis=1, keepdims=True)
        ones = np.ones_like(squares)
        return np.hstack([points, squares, ones]), np.hstack([-2 * points, ones, squares]).T

    @cached_property
    def solid(self) -> bool:
        """Whether it is a thing of its own, and neither a wall nor the inside of a hollow one."""
        return self.width > THICK and is_solid(self.cloud)


def part_of(points: Array) -> Part | None:
    """Measure a patch's (N, 3) points; ``None`` where too few are known."""
    known = points.compress(np.isfinite(points[:, 2]), axis=0)
    if len(known) < 20:
        return None
    low, high = percentiles(known, (2, 98))
    inner = known.compress(within(known, low, high), axis=0)
    inner = inner if len(inner) >= 20 else known
    hull = hull_of(inner)
    _, sides, _ = cv2.minAreaRect(hull.astype(np.float32))
    sample = inner[:: len(inner) // 800 + 1]
    return Part(sample, hull, min(sides), max(sides), float(low[2]), float(high[2]), len(known))


def gap(one: Part, other: Part) -> float:
    """The smallest distance between two parts' points, metres; at least 0.05 where they are far from each other."""
    (low, high), (least, most) = one.ends, other.ends
    apart = max(*map(sub, low, most), *map(sub, least, high))
    if apart > 0.05:
        return apart
    squares = one.lifted[0] @ other.lifted[1]
    return float(np.sqrt(max(float(squares.min()), 0.0)))


def covered(one: Part, other: Part, margin: float = 0.006) -> float:
    """The share of ``one``'s points over the footprint of ``other``."""
    return float(inside_hull(one.cloud[:, :2], other.hull, margin).mean())


class Merger:
    """Merges the parts of a label image, the smallest first, until no two belong together."""

    def __init__(self, labels: Labels, points: Array) -> None:
        self.labels = labels
        self.points = points.reshape(-1, 3)
        self.numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
        self.pixels = dict(enumerate(pixels_of(labels), 1))
        measured = {label: part_of(self.points.take(pixels, axis=0)) for label, pixels in self.pixels.items()}
        self.parts = {label: part for label, part in measured.items() if part is not None}
        self.columns = {label: self._columns(label) for label in self.parts}
        # For each part those that it was not yet compared with since either of the two last grew.
        self.waiting = {label: set(self.parts) - {label} for label in self.parts}
        table = np.flatnonzero((labels == 0) & (np.abs(points[..., 2]) < 0.015))
        self.table = self.points.take(table[::5], axis=0)
        self.brinks = OcclusionEdges(labels, points)

    def _columns(self, label: int) -> int:
        """How many columns of the picture a part is seen in."""
        return int(np.count_nonzero(np.bincount(self.pixels[label] % self.labels.shape[1])))

    def run(self) -> Labels:
        """The (H, W) merged labels."""
        while (pair := self._next()) is not None:
            self._merge(*pair)
        return self.numbers[self.labels]

    def _merge(self, small: int, big: int) -> None:
        self.numbers[self.numbers == small] = big
        self.pixels[big] = np.sort(np.concatenate([self.pixels[big], self.pixels.pop(small)]))
        self.columns[big] = self._columns(big)
        self.brinks.rename(small, big)
        del self.parts[small], self.waiting[small]
        whole = part_of(self.points.take(self.pixels[big], axis=0))
        if whole is not None:
            self.parts[big] = whole
        for others in self.waiting.values():
            others.discard(small)
            others.add(big)
        self.waiting[big] = set(self.parts) - {big}

    def _next(self) -> tuple[int, int] | None:
        """The smallest part that belongs to another, and the nearest that it belongs to."""
        for small in sorted(self.parts, key=lambda label: self.parts[label].count):
            found: list[tuple[float, int]] = []
            for big in self.waiting[small]:
                if self.parts[big].count < self.parts[small].count:
                    continue
                distance = gap(self.parts[small], self.parts[big])
                if self._belongs(small, big, distance):
                    found.append((distance, big))
            self.waiting[small].clear()
            if found:
                return small, min(found)[1]
        return None

    def _belongs(self, small: int, big: int, distance: float) -> bool:
        """Whether the smaller part is a piece of the larger one, from which it is ``distance`` (m) away."""
        one, other = self.parts[small], self.parts[big]
        walls = abs(one.top - other.top) < LEVEL and not (one.solid or other.solid)
        if walls and self._one_rim(small, big, distance):
            return True
        if distance > TOUCHING:
            return False
        return self._is_inside(one, other) or self._is_cap(one, other) or self._is_fin(one, other, small)

    def _is_inside(self, one: Part, other: Part) -> bool:
        """Whether ``one`` is the floor or inner wall of a hollow object whose walls are ``other``."""
        lower = one.top < other.top + 0.008
        return lower and not one.solid and covered(one, other) > 0.7 and self._open(one, other)

    def _is_cap(self, one: Part, other: Part) -> bool:
        """Whether ``one`` is the cap of ``other``, or a ridge along its top."""
        if one.count >= 0.4 * other.count or not other.top - 0.03 < one.bottom or one.top >= other.top + CAP:
            return False
        ridge = one.width < FIN[0] and one.length < 0.1 and one.count < 0.2 * other.count
        return (one.length < CAP or ridge) and covered(one, other) > 0.5

    def _is_fin(self, one: Part, other: Part, small: int) -> bool:
        """Whether ``one`` is a tab, lip or fin of ``other``, or a narrow part that nothing else carries."""
        if one.count >= 0.4 * other.count:
            return False
        fin = one.width < FIN[0] and one.length < FIN[1] and one.count < 0.2 * other.count and one.top < other.top
        hangs = one.bottom > CARRIED and one.width < 2 * NARROW and one.length < 0.12
        return fin or (hangs and not self._carried(small))

    def _open(self, one: Part, other: Part) -> bool:
        """Whether two parts together are a hollow thing, open at the top."""
        return is_open(np.concatenate([one.cloud, other.cloud]), self.table)

    def _one_rim(self, small: int, big: int, distance: float) -> bool:
        """Whether two parts whose tops are level are walls, or a wall and the inside, of one hollow thing."""
        one, other = self.parts[small], self.parts[big]
        width, top = min(self.columns[small], self.columns[big]), min(one.top, other.top)
        walls = [
            (near, far)
            for near, far in ((small, big), (big, small))
            if self.brinks.span(near, far, width) and covered(self.parts[near], self.parts[far]) < WITHIN
        ]
        if any(self.brinks.closes(near, far, top) for near, far in walls):
            return True
        if distance >= RIM_GAP:
            return False
        beside = bool(walls) or distance < BESIDE or covered(one, other, TOUCHING) > WITHIN
        return (beside or self._meet(small, big)) and self._open(one, other)

    def _meet(self, small: int, big: int) -> bool:
        """Whether one part goes over into another: of large parts the samples are too coarse to tell."""
        owners, pixels = self.labels.ravel(), self.pixels[small]
        count = 0
        for step in (1, -1, self.labels.shape[1], -self.labels.shape[1]):
            beside = pixels[(pixels + step >= 0) & (pixels + step < owners.size)]
            beside = beside[self.numbers[owners[beside + step]] == big]
            apart = np.linalg.norm(self.points.take(beside, axis=0) - self.points.take(beside + step, axis=0), axis=1)
            count += int((apart < TOUCHING).sum())
        return count >= SHORTEST

    def _carried(self, small: int) -> bool:
        one = self.parts[small]
        for label, other in self.parts.items():
            if label != small and abs(other.top - one.bottom) < 0.025 and covered(one, other, 0.002) > 0.25:
                return True
        return False


def merge_parts(labels: Labels, points: Array) -> Labels:
    """(H, W) labels with the parts of each object merged; ``points`` are (H, W, 3) in the robot frame."""
    return Merger(labels, points).run()
