"""Joining of pieces that are the same object: touching pieces of the same colours, steep sides, and pieces that an
occluder separates."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    mask_outline_pixels,
    pixels_by_label,
    values_in_mask,
)
from grs_agents.perception.segmentation.configuration import OccludedPieces, Segmentation
from grs_agents.perception.segmentation.patch_cutting import (
    Depth,
    find_depth_jumps,
    join_smooth_neighbors,
    measure_label_borders,
)
from grs_agents.perception.segmentation.piece_colors import (
    COLOR_BINS,
    PlainColorTest,
    color_bins,
    color_histogram,
    lab_colors,
)
from grs_agents.perception.types import Array, Mask, RGBDFrame


def join_plain_pieces(labels: Labels, frame: RGBDFrame, config: Segmentation) -> Labels:
    """(H, W) labels, 1..N, with the touching pieces of the same plain colour joined."""
    below, right = find_depth_jumps(frame.depth)
    length, jumps = measure_label_borders(labels, np.zeros(labels.shape), below, right, 1.0)
    touching = length - jumps >= np.maximum(config.touching.shortest, config.touching.open * length)
    test = PlainColorTest(labels, frame.rgb, config.plain)
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    for first, second in np.argwhere(np.triu(touching, 1)).tolist():
        if test.is_one_object(first, second):
            numbers[numbers == numbers[second]] = numbers[first]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


def join_alike_pieces(labels: Labels, frame: RGBDFrame, bend: Array, config: Segmentation) -> Labels:
    """(H, W) labels, 1..N, with the pieces of the same colours joined that only a shallow crease parts. ``bend`` (H, W)
    is the map of `compute_concavity_map`."""
    strength, jumps = np.minimum(bend, config.patches.jump), find_depth_jumps(frame.depth)
    length, total = measure_label_borders(labels, strength, *jumps, config.patches.jump)
    shallow = (length >= config.patches.shortest) & (total < config.alike.crease * length)
    if not shallow.any():
        return labels
    bins = color_bins(lab_colors(frame.rgb))
    looks = np.stack([np.zeros(COLOR_BINS), *(color_histogram(bins.take(own)) for own in pixels_by_label(labels))])
    alike = looks @ looks.T > config.alike.alike
    return join_smooth_neighbors(labels, length, total, alike, replace(config.patches, crease=config.alike.crease))


def join_steep_pieces(labels: Labels, frame: RGBDFrame, config: Segmentation) -> Labels:
    """(H, W) labels, 1..N, in which a piece at a grazing angle, a side, belongs to the nearer piece with the longest
    border; it stays alone without a nearer neighbour."""
    depth = frame.depth.astype(np.float64)
    down, across = (np.asarray(side, np.float64) for side in np.gradient(depth))
    slope = np.hypot(down, across) * frame.camera.fx / np.maximum(depth, 1e-6)
    pieces = pixels_by_label(labels)
    steep = [label for label, own in enumerate(pieces, 1) if np.median(slope.take(own)) > config.steep.steep]
    if not steep:
        return labels
    length, _ = measure_label_borders(labels, slope, *find_depth_jumps(frame.depth), config.patches.jump)
    distance = np.array([np.inf, *(np.median(depth.take(own)) for own in pieces)])
    numbers = np.arange(len(pieces) + 1, dtype=np.int32)
    for label in steep:
        nearer = np.where((distance < distance[label]) & (length[label] >= config.patches.shortest), length[label], 0)
        if nearer.any():
            numbers[numbers == label] = numbers[nearer.argmax()]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


@dataclass(frozen=True)
class Piece:
    """A segment that may continue behind an occluder."""

    top: float  # height, m
    color: Array  # (3,) mean
    outline: Array  # (M, 2) columns and rows
    footprint: Array  # (K, 2) corners, m
    histogram: Array  # square roots of the shares of its colours by bin

    @classmethod
    def measure(cls, mask: Mask, frame: RGBDFrame, bins: Index, points: Array, config: OccludedPieces) -> "Piece":
        """The piece of a mask (H, W); ``bins`` (H, W) are those of the photo's colours, ``points`` (H, W, 3) m."""
        cloud = values_in_mask(points, mask)
        cloud = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)[::5]
        top = float(compute_percentiles(cloud[:, 2], [90])[0])
        return cls(
            top,
            color=values_in_mask(frame.rgb, mask).mean(axis=0),
            outline=mask_outline_pixels(mask)[::3].astype(np.float64),
            footprint=convex_footprint_hull(cloud),
            histogram=color_histogram(bins.take(np.flatnonzero(mask))),
        )


@dataclass(frozen=True)
class GapLine:
    """A straight line in the picture across the gap between two pieces."""

    hidden: float  # share of it without depth, or with a nearer surface
    length: float  # metres
    step: float  # metres of depth between its ends

    @classmethod
    def measure(cls, start: Array, end: Array, labels: Labels, frame: RGBDFrame, config: OccludedPieces) -> "GapLine":
        """The line between two pixels (column, row)."""
        count = int(np.hypot(*(end - start)))
        steps = np.linspace(0, 1, max(count, 3))[:, None]
        columns, rows = np.rint(start + steps * (end - start)).astype(int).T
        depth, owner = frame.depth[rows, columns].astype(np.float64), labels[rows, columns]
        first, last = depth[[0, -1]]
        between = first + steps[1:-1, 0] * (last - first)
        occluder = ~np.isin(owner[1:-1], (0, owner[0], owner[-1]))
        hidden = (depth[1:-1] <= 0) | (occluder & (depth[1:-1] < between - config.nearer))
        pixel = max(first, last) / frame.camera.fx
        return cls(float(hidden.mean()), count * pixel, abs(float(last - first)))


def join_occluded_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, config: OccludedPieces = DEFAULT.segmentation.occluded
) -> Labels:
    """(H, W) labels, 1..N, with pieces joined that an occluder, or a gap in the depth, separates in the picture.
    ``points`` are (H, W, 3) in the robot frame."""
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    bins = color_bins(lab_colors(frame.rgb))
    pieces = [Piece.measure(labels == label, frame, bins, points, config) for label in range(1, len(numbers))]
    for number, first in enumerate(pieces, 1):
        for another, second in enumerate(pieces[number:], number + 1):
            if _form_rectangle_behind_occluder(first, second, labels, frame.depth, config) or (
                float(first.histogram @ second.histogram) > config.alike
                and _is_gap_hidden(first, second, labels, frame, config)
            ):
                numbers[numbers == numbers[another]] = numbers[number]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


def _form_rectangle_behind_occluder(
    first: Piece, second: Piece, labels: Labels, depth: Depth, config: OccludedPieces
) -> bool:
    """Whether two pieces have level tops and similar colours and form a rectangle, and the shortest way between them
    leads over nearer objects."""
    hull = convex_footprint_hull(np.concatenate([first.footprint, second.footprint])).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(hull)
    if abs(first.top - second.top) > config.same_level or max(sides) >= config.longest:
        return False
    if cv2.contourArea(hull) <= config.rectangle * sides[0] * sides[1]:
        return False
    bright, dark = max(first.color.sum(), second.color.sum()), min(first.color.sum(), second.color.sum())
    if not dark or bright >= config.brightness * dark:
        return False
    if np.linalg.norm(first.color / first.color.sum() - second.color / second.color.sum()) >= config.hue:
        return False
    squares = ((first.outline[:, None] - second.outline[None]) ** 2).sum(axis=2)
    start, end = np.unravel_index(int(squares.argmin()), squares.shape)
    count = int(np.sqrt(squares.min()))
    if count < 4:
        return False
    steps = np.linspace(0, 1, count)
    way = np.rint(first.outline[start] + steps[:, None] * (second.outline[end] - first.outline[start])).astype(int)
    passed = labels[way[:, 1], way[:, 0]]
    others = ~np.isin(passed[1:-1], (0, passed[0], passed[-1]))
    along = depth[way[:, 1], way[:, 0]].astype(np.float64)
    nearer = along[1:-1] < along[0] + steps[1:-1] * (along[-1] - along[0])
    return bool(others.mean() >= config.between and nearer.mean() >= config.between)


def _is_gap_hidden(first: Piece, second: Piece, labels: Labels, frame: RGBDFrame, config: OccludedPieces) -> bool:
    """Whether the gap between two pieces is hidden, narrow and without a jump, by the medians over the shortest lines
    from outline to outline."""
    squares = ((first.outline[:, None] - second.outline[None]) ** 2).sum(axis=2)
    starts = np.argsort(squares.min(axis=1))[: config.lines]
    ends = second.outline[squares[starts].argmin(axis=1)]
    lines: list[GapLine] = []
    for start, end in zip(first.outline[starts], ends, strict=True):
        if abs(end - start).max() < 3:  # they touch
            continue
        lines.append(GapLine.measure(start, end, labels, frame, config))
        if lines[0].length > config.widest:
            break  # the others are no shorter
    if not lines:
        return False
    hidden, length, step = np.median([(line.hidden, line.length, line.step) for line in lines], axis=0)
    return bool(hidden >= config.hidden and length <= config.widest and step <= config.steepest * length)
