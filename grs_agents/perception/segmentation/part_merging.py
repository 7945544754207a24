"""Merge the patches that are parts of one object: the walls of hollow objects, what lies inside them, handles and other
parts in the air, and fragments."""

from dataclasses import dataclass
from functools import cached_property
from operator import sub

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    pixels_by_label,
    points_in_box_mask,
    points_in_hull_mask,
)
from grs_agents.perception.segmentation.configuration import Segmentation
from grs_agents.perception.segmentation.hollow_shapes import is_open_at_top, is_solid_object
from grs_agents.perception.segmentation.occlusion_edges import OcclusionEdges
from grs_agents.perception.segmentation.piece_colors import color_bins, color_histogram, lab_colors
from grs_agents.perception.types import Array, Image

# A cap, or the wall of a bowl in its own shadow, often has a colour of its own. Most tabs and handles have that of the
# whole.
_OF_ONE_COLOR = frozenset({"tab", "unsupported"})


@dataclass(frozen=True)
class Part:
    """A patch in the robot frame."""

    cloud: Array  # (N, 3) points, metres; a sample of at most 800
    hull: Array  # (M, 2) corners of its footprint
    width: float  # width, length: of its footprint, metres
    length: float
    bottom: float  # bottom, top: metres above the table
    top: float
    count: int  # how many pixels it has
    config: Segmentation  # what counts as solid

    @cached_property
    def bounding_box_corners(self) -> tuple[list[float], list[float]]:
        """Lowest and highest corner of the points, m."""
        return self.cloud.min(axis=0).tolist(), self.cloud.max(axis=0).tolist()

    @cached_property
    def squared_distance_factors(self) -> tuple[Array, Array]:
        """(N, 5) and (5, N) of every other point: one part's first times another's second are squares of distances."""
        points = self.cloud[::2]
        squares = (points**2).sum(axis=1, keepdims=True)
        ones = np.ones_like(squares)
        return np.hstack([points, squares, ones]), np.hstack([-2 * points, ones, squares]).T

    @cached_property
    def is_solid_part(self) -> bool:
        """Whether it is an object of its own, and neither a wall nor the inside of a hollow one."""
        thick = self.width > self.config.merging.thickest_wall
        return "solid" in self.config.rules and thick and is_solid_object(self.cloud, self.config.hollow)


def measure_part(points: Array, config: Segmentation = DEFAULT.segmentation) -> Part | None:
    """Measure a patch's (N, 3) points; ``None`` where too few are known."""
    known = points.compress(np.isfinite(points[:, 2]), axis=0)
    if len(known) < 20:
        return None
    low, high = compute_percentiles(known, (2, 98))
    inner = known.compress(points_in_box_mask(known, low, high), axis=0)
    inner = inner if len(inner) >= 20 else known
    hull = convex_footprint_hull(inner)
    _, sides, _ = cv2.minAreaRect(hull.astype(np.float32))
    sample = inner[:: len(inner) // 800 + 1]
    return Part(sample, hull, min(sides), max(sides), float(low[2]), float(high[2]), len(known), config)


def gap_between_parts(one: Part, other: Part) -> float:
    """The smallest distance between two parts' points, metres; at least 0.05 where they are far from each other."""
    (low, high), (least, most) = one.bounding_box_corners, other.bounding_box_corners
    apart = max(*map(sub, low, most), *map(sub, least, high))
    if apart > 0.05:
        return apart
    squares = one.squared_distance_factors[0] @ other.squared_distance_factors[1]
    return float(np.sqrt(max(float(squares.min()), 0.0)))


def share_over_footprint(one: Part, other: Part, margin: float = 0.006) -> float:
    """The share of ``one``'s points over the footprint of ``other``."""
    return float(points_in_hull_mask(one.cloud[:, :2], other.hull, margin).mean())


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
        # For each part those that it was not yet compared with since either of the two last grew.
        self.uncompared = {label: set(self.parts) - {label} for label in self.parts}
        table = np.flatnonzero((labels == 0) & (np.abs(points[..., 2]) < config.filter.floor))
        self.table = self.points.take(table[::5], axis=0)
        self.edges = OcclusionEdges(labels, points, config)
        self.attachments = {
            "interior": self._is_interior_part,
            "cap": self._is_short_part_on_top,
            "tab": self._is_thin_lower_part,
            "unsupported": self._is_unsupported_handle,
        }

    def _count_image_columns(self, label: int) -> int:
        """How many columns of the picture a part is seen in."""
        return int(np.count_nonzero(np.bincount(self.pixels[label] % self.labels.shape[1])))

    def merge_all_parts(self) -> Labels:
        """The (H, W) merged labels."""
        while (pair := self._find_next_pair()) is not None:
            self._merge_pair(*pair)
        return self.owners[self.labels]

    def _merge_pair(self, small: int, big: int) -> None:
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

    def _find_next_pair(self) -> tuple[int, int] | None:
        """The smallest part that belongs to another, and the nearest that it belongs to."""
        for small in sorted(self.parts, key=lambda label: self.parts[label].count):
            wholes: list[tuple[float, int]] = []
            for big in self.uncompared[small]:
                if self.parts[big].count < self.parts[small].count:
                    continue
                distance = gap_between_parts(self.parts[small], self.parts[big])
                if self._belongs_to_larger_part(small, big, distance):
                    wholes.append((distance, big))
            self.uncompared[small].clear()
            if wholes:
                return small, min(wholes)[1]
        return None

    def _belongs_to_larger_part(self, small: int, big: int, distance: float) -> bool:
        """Whether the smaller part is a piece of the larger one, from which it is ``distance`` (m) away."""
        alike = float(self.histograms[small] @ self.histograms[big]) >= self.config.merging.alike
        rules = self.config.rules if alike else self.config.rules - _OF_ONE_COLOR
        if "common_rim" in rules and self._have_common_rim(small, big, distance):
            return True
        touching = distance <= self.config.merging.touching
        return touching and any(belongs(small, big) for rule, belongs in self.attachments.items() if rule in rules)

    def _have_common_rim(self, small: int, big: int, distance: float) -> bool:
        """Whether two parts whose tops are level are walls, or a wall and the inside, of one hollow object."""
        one, other, config = self.parts[small], self.parts[big], self.config.merging
        if abs(one.top - other.top) >= config.rim_level or one.is_solid_part or other.is_solid_part:
            return False
        walls = [
            (near, far)
            for near, far in ((small, big), (big, small))
            if self.edges.is_far_label_seen_over_edge(near, far, min(self.columns[small], self.columns[big]))
            and share_over_footprint(self.parts[near], self.parts[far]) < config.overlap
        ]
        if any(self.edges.reaches_rim_at_ends(near, far, min(one.top, other.top)) for near, far in walls):
            return True
        return (
            distance < config.rim_gap
            and self._are_adjacent(small, big, distance, bool(walls))
            and self._form_open_hollow_object(one, other)
        )

    def _are_adjacent(self, small: int, big: int, distance: float, is_wall: bool) -> bool:
        """Whether one part is a wall before another, beside it, over it, or goes over into it."""
        config = self.config.merging
        if is_wall or distance < config.beside:
            return True
        return share_over_footprint(
            self.parts[small], self.parts[big], config.touching
        ) > config.overlap or self._have_continuous_border(small, big)

    def _form_open_hollow_object(self, one: Part, other: Part) -> bool:
        """Whether two parts together are a hollow object, open at the top."""
        return is_open_at_top(np.concatenate([one.cloud, other.cloud]), self.table, self.config.hollow)

    def _have_continuous_border(self, small: int, big: int) -> bool:
        """Whether one part goes over into another: of large parts the samples are too coarse to tell."""
        owners, pixels = self.labels.ravel(), self.pixels[small]
        count = 0
        for step in (1, -1, self.labels.shape[1], -self.labels.shape[1]):
            beside = pixels[(pixels + step >= 0) & (pixels + step < owners.size)]
            beside = beside[self.owners[owners[beside + step]] == big]
            apart = np.linalg.norm(self.points.take(beside, axis=0) - self.points.take(beside + step, axis=0), axis=1)
            count += int((apart < self.config.merging.touching).sum())
        return count >= self.config.merging.shortest

    def _is_interior_part(self, small: int, big: int) -> bool:
        """Whether a part is the floor or inner wall of a hollow object whose walls are the other."""
        one, other, config = self.parts[small], self.parts[big], self.config.merging
        lower = one.top < other.top + config.below_rim and not one.is_solid_part
        return (
            lower
            and share_over_footprint(one, other) > config.interior_overlap
            and self._form_open_hollow_object(one, other)
        )

    def _is_short_part_on_top(self, small: int, big: int) -> bool:
        """Whether a part is short, and on top of the other."""
        one, other, config = self.parts[small], self.parts[big], self.config.merging
        if one.count >= config.smaller * other.count or one.top >= other.top + config.cap:
            return False
        on_top = one.length < config.cap and other.top - config.on_top < one.bottom
        return on_top and share_over_footprint(one, other) > config.covered

    def _is_thin_lower_part(self, small: int, big: int) -> bool:
        """Whether a part is a tab, lip or fin of a higher one."""
        one, other, config = self.parts[small], self.parts[big], self.config.merging
        thin = one.width < config.tab[0] and one.length < config.tab[1]
        return thin and one.count < config.tiny * other.count and one.top < other.top

    def _is_unsupported_handle(self, small: int, big: int) -> bool:
        """Whether a part in the air is as narrow as a handle, and nothing carries it."""
        one, config = self.parts[small], self.config.merging
        if one.count >= config.smaller * self.parts[big].count or one.bottom <= config.unsupported:
            return False
        if one.width >= config.handle[0] or one.length >= config.handle[1]:
            return False
        return not any(
            abs(other.top - one.bottom) < config.carrier_distance
            and share_over_footprint(one, other, 0.002) > config.carried
            for label, other in self.parts.items()
            if label != small
        )


def merge_parts(labels: Labels, points: Array, rgb: Image, config: Segmentation = DEFAULT.segmentation) -> Labels:
    """(H, W) labels with the parts of each object merged; ``points`` are (H, W, 3) in the robot frame, ``rgb`` is the
    photo of that size."""
    return Merger(labels, points, rgb, config).merge_all_parts()
