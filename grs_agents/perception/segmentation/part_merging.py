"""Merging of patches that are parts of an object: walls of hollow objects and their inside, handles, caps, fragments.

Walls are recognised at occlusion boundaries. Over the near wall of a hollow object, the surface behind lies deep in the
middle and rises to the rim at both ends, where near and far wall meet. An object behind another object does not rise.
"""

from dataclasses import dataclass
from functools import cached_property
from operator import sub

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    pixels_by_label,
    points_in_box_mask,
    points_in_hull_mask,
)
from grs_agents.perception.segmentation.configuration import Segmentation
from grs_agents.perception.segmentation.footprints import is_open_at_top, is_solid_object
from grs_agents.perception.segmentation.piece_colors import color_bins, color_histogram, lab_colors
from grs_agents.perception.types import Array, Image

# A cap, or the wall of a bowl in its own shadow, often differs in colour from the whole; tabs and handles rarely do.
_OF_ONE_COLOR = frozenset({"tab", "unsupported"})
_EMPTY: Index = np.zeros(0, np.intp)


class OcclusionEdges:
    """Upper edges of the parts of a label image (H, W), each with the next part above it in the same column."""

    def __init__(self, labels: Labels, points: Array, config: Segmentation = DEFAULT.segmentation) -> None:
        self.config, self.deep = config.rim, config.hollow.deep
        rows, columns = np.nonzero((labels[1:] != labels[:-1]) & (labels[1:] > 0))
        numbers = np.arange(len(labels))[:, None]
        at = np.maximum.accumulate(np.where(labels > 0, numbers, -1), axis=0)[rows, columns]
        seen = at >= 0
        rows, at, self.columns = rows[seen] + 1, at[seen], columns[seen]
        self.edges, self.seen = points[rows, self.columns], points[at, self.columns]
        count = int(labels.max()) + 1
        pairs = labels[rows, self.columns].astype(np.int64) * count + labels[at, self.columns]
        order = np.argsort(pairs, kind="stable")
        kinds, first = np.unique(pairs[order], return_index=True)
        members = np.split(order, first)[1:]
        self.pairs = {divmod(int(kind), count): indices for kind, indices in zip(kinds, members, strict=True)}

    def relabel_part(self, old: int, new: int) -> None:
        """Merge part ``old`` into ``new``."""
        for near, far in [pair for pair in self.pairs if old in pair]:
            pair = (new if near == old else near), (new if far == old else far)
            renamed = self.pairs.pop((near, far))
            self.pairs[pair] = np.sort(np.concatenate([self.pairs.get(pair, _EMPTY), renamed]))

    def is_far_label_seen_over_edge(self, near: int, far: int, width: int) -> bool:
        """Whether ``far`` is seen over most of the edge of ``near``; ``width`` is the narrower part's, in columns.

        False if ``near`` mostly occludes itself, or ``far`` lies before ``near`` too: an object inside a hollow object,
        or a whole hollow object, is no wall."""
        pair = self.pairs.get((near, far), _EMPTY)
        if len(pair) < max(self.config.span * width, self.config.fewest):
            return False
        itself = np.isin(self.columns[pair], self.columns[self.pairs.get((near, near), _EMPTY)]).sum()
        return max(int(itself), len(self.pairs.get((far, near), _EMPTY))) <= self.config.span * len(pair)

    def reaches_rim_at_ends(self, near: int, far: int, top: float) -> bool:
        """Whether ``far``, as seen over ``near``, rises at both ends to about ``top``, their height (m)."""
        pairs = self.pairs.get((near, far), _EMPTY)
        pairs = pairs[np.argsort(self.columns[pairs], kind="stable")]
        edges, seen = self.edges[pairs], self.seen[pairs]
        known = np.isfinite(edges[:, 2]) & np.isfinite(seen[:, 2])
        edges, seen = edges[known], seen[known]
        if len(edges) < self.config.fewest:
            return False
        heights = np.minimum(edges[:, 2], seen[:, 2])
        apart = np.linalg.norm(edges - seen, axis=1)
        end = max(1, round(self.config.end * len(edges)))
        middle = float(np.percentile(heights[end:-end], 10))
        risen = min(float(heights[:end].max()), float(heights[-end:].max()))
        farthest = max(float(apart[:end].min()), float(apart[-end:].min()))
        width = float(np.linalg.norm(edges[0] - edges[-1]))
        return risen > max(self.config.risen * top, middle + self.deep) and farthest < self.config.closed * width


@dataclass(frozen=True)
class MeasuredPart:
    """A patch in the robot frame."""

    cloud: Array  # (N, 3) points, metres; a sample of at most 800
    hull: Array  # (M, 2) corners of its footprint
    width: float  # width, length: of its footprint, metres
    length: float
    bottom: float  # bottom, top: metres above the table
    top: float
    count: int  # pixels
    config: Segmentation

    @cached_property
    def bounding_box_corners(self) -> tuple[list[float], list[float]]:
        """Lowest and highest corner of the points, m."""
        return self.cloud.min(axis=0).tolist(), self.cloud.max(axis=0).tolist()

    @cached_property
    def squared_distance_factors(self) -> tuple[Array, Array]:
        """(N, 5) and (5, N) of every second point; the product of a part's first and another's second factor is their
        squared distances."""
        points = self.cloud[::2]
        squares = (points**2).sum(axis=1, keepdims=True)
        ones = np.ones_like(squares)
        return np.hstack([points, squares, ones]), np.hstack([-2 * points, ones, squares]).T

    @cached_property
    def is_solid_part(self) -> bool:
        """Whether it is an object by itself, and neither a wall nor the inside of a hollow object."""
        thick = self.width > self.config.merging.thickest_wall
        return "solid" in self.config.rules and thick and is_solid_object(self.cloud, self.config.hollow)


def measure_part(points: Array, config: Segmentation = DEFAULT.segmentation) -> MeasuredPart | None:
    """Measure a patch's (N, 3) points; ``None`` with fewer than 20 known points."""
    known = points.compress(np.isfinite(points[:, 2]), axis=0)
    if len(known) < 20:
        return None
    low, high = compute_percentiles(known, (2, 98))
    inner = known.compress(points_in_box_mask(known, low, high), axis=0)
    inner = inner if len(inner) >= 20 else known
    hull = convex_footprint_hull(inner)
    _, sides, _ = cv2.minAreaRect(hull.astype(np.float32))
    sample = inner[:: len(inner) // 800 + 1]
    return MeasuredPart(sample, hull, min(sides), max(sides), float(low[2]), float(high[2]), len(known), config)


def gap_between_parts(first: MeasuredPart, second: MeasuredPart) -> float:
    """Smallest distance between two parts' points, m; a lower bound of at least 0.05 if they are farther apart."""
    (low, high), (least, most) = first.bounding_box_corners, second.bounding_box_corners
    apart = max(*map(sub, low, most), *map(sub, least, high))
    if apart > 0.05:
        return apart
    squares = first.squared_distance_factors[0] @ second.squared_distance_factors[1]
    return float(np.sqrt(max(float(squares.min()), 0.0)))


def share_over_footprint(part: MeasuredPart, base: MeasuredPart, margin: float = 0.006) -> float:
    """Share of the points of ``part`` over the footprint of ``base``, grown by ``margin``, m."""
    return float(points_in_hull_mask(part.cloud[:, :2], base.hull, margin).mean())


class Merger:
    """Merges the parts of a label image, the smallest first, until no two belong together."""

    def __init__(self, labels: Labels, points: Array, rgb: Image, config: Segmentation) -> None:
        self.labels, self.config = labels, config
        self.bins = color_bins(lab_colors(rgb)).ravel()
        self.points = points.reshape(-1, 3)
        self.owners = np.arange(int(labels.max()) + 1, dtype=np.int32)
        self.pixels = dict(enumerate(pixels_by_label(labels), 1))
        measured = {label: measure_part(self.points.take(own, axis=0), config) for label, own in self.pixels.items()}
        self.parts = {label: part for label, part in measured.items() if part is not None}
        self.columns = {label: self._count_image_columns(label) for label in self.parts}
        self.histograms = {label: color_histogram(self.bins.take(self.pixels[label])) for label in self.parts}
        # The parts to which each part has not been compared since either of the two grew.
        self.uncompared = {label: set(self.parts) - {label} for label in self.parts}
        table = np.flatnonzero((labels == 0) & (np.abs(points[..., 2]) < config.filter.floor))
        self.table = self.points.take(table[::5], axis=0)
        self.edges = OcclusionEdges(labels, points, config)

    def _count_image_columns(self, label: int) -> int:
        """Number of image columns that a part covers."""
        return int(np.count_nonzero(np.bincount(self.pixels[label] % self.labels.shape[1])))

    def merge_all_parts(self) -> Labels:
        """The (H, W) merged labels."""
        while (pair := self._find_next_pair()) is not None:
            small, big = pair
            self.owners[self.owners == small] = big
            self.pixels[big] = np.sort(np.concatenate([self.pixels[big], self.pixels.pop(small)]))
            self.columns[big] = self._count_image_columns(big)
            self.histograms[big] = color_histogram(self.bins.take(self.pixels[big]))
            self.edges.relabel_part(small, big)
            del self.parts[small], self.uncompared[small]
            whole = measure_part(self.points.take(self.pixels[big], axis=0), self.config)
            if whole is not None:
                self.parts[big] = whole
            for others in self.uncompared.values():
                others.discard(small)
                others.add(big)
            self.uncompared[big] = set(self.parts) - {big}
        return self.owners[self.labels]

    def _find_next_pair(self) -> tuple[int, int] | None:
        """The smallest part that belongs to a larger part, and the nearest such larger part."""
        for small in sorted(self.parts, key=lambda label: self.parts[label].count):
            wholes: list[tuple[float, int]] = []
            for big in self.uncompared[small]:
                if self.parts[big].count < self.parts[small].count:
                    continue
                distance = gap_between_parts(self.parts[small], self.parts[big])
                alike = float(self.histograms[small] @ self.histograms[big]) >= self.config.merging.alike
                rules = self.config.rules if alike else self.config.rules - _OF_ONE_COLOR
                if ("common_rim" in rules and self._have_common_rim(small, big, distance)) or (
                    distance <= self.config.merging.touching and self._is_attached(small, big, rules)
                ):
                    wholes.append((distance, big))
            self.uncompared[small].clear()
            if wholes:
                return small, min(wholes)[1]
        return None

    def _have_common_rim(self, small: int, big: int, distance: float) -> bool:
        """Whether two parts with level tops are walls, or a wall and the inside, of the same hollow object."""
        part, whole, config = self.parts[small], self.parts[big], self.config.merging
        if abs(part.top - whole.top) >= config.rim_level or part.is_solid_part or whole.is_solid_part:
            return False
        walls = [
            (near, far)
            for near, far in ((small, big), (big, small))
            if self.edges.is_far_label_seen_over_edge(near, far, min(self.columns[small], self.columns[big]))
            and share_over_footprint(self.parts[near], self.parts[far]) < config.overlap
        ]
        if any(self.edges.reaches_rim_at_ends(near, far, min(part.top, whole.top)) for near, far in walls):
            return True
        if distance >= config.rim_gap:
            return False
        adjacent = (
            bool(walls)
            or distance < config.beside
            or share_over_footprint(part, whole, config.touching) > config.overlap
        )
        return adjacent and self._form_open_hollow_object(part, whole)

    def _form_open_hollow_object(self, part: MeasuredPart, whole: MeasuredPart) -> bool:
        """Whether two parts together are a hollow object, open at the top."""
        return is_open_at_top(np.concatenate([part.cloud, whole.cloud]), self.table, self.config.hollow)

    def _is_attached(self, small: int, big: int, rules: frozenset[str]) -> bool:
        """Whether by any of the rules a touching part is a piece of the whole."""
        part, whole, config = self.parts[small], self.parts[big], self.config.merging
        is_below_rim = part.top < whole.top + config.below_rim and not part.is_solid_part
        if (
            "interior" in rules
            and is_below_rim
            and share_over_footprint(part, whole) > config.interior_overlap
            and self._form_open_hollow_object(part, whole)
        ):
            return True
        is_smaller = part.count < config.smaller * whole.count
        is_short = part.top < whole.top + config.cap and part.length < config.cap
        on_top = is_short and whole.top - config.on_top < part.bottom
        if "cap" in rules and is_smaller and on_top and share_over_footprint(part, whole) > config.covered:
            return True
        is_thin = part.width < config.tab[0] and part.length < config.tab[1]
        if "tab" in rules and is_thin and part.count < config.tiny * whole.count and part.top < whole.top:
            return True
        is_narrow = part.width < config.handle[0] and part.length < config.handle[1]
        if "unsupported" not in rules or not (is_smaller and is_narrow and part.bottom > config.unsupported):
            return False
        return not any(
            abs(base.top - part.bottom) < config.carrier_distance
            and share_over_footprint(part, base, 0.002) > config.carried
            for label, base in self.parts.items()
            if label != small
        )


def merge_parts(labels: Labels, points: Array, rgb: Image, config: Segmentation = DEFAULT.segmentation) -> Labels:
    """(H, W) labels with the parts of each object merged; ``points`` are (H, W, 3) in the robot frame, ``rgb`` is the
    photo of that size."""
    return Merger(labels, points, rgb, config).merge_all_parts()
