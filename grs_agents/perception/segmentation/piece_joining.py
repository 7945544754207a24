"""Joining of pieces that are the same object: touching pieces at a crease, and pieces that an occluder separates.

Touching pieces are joined if both have the same plain colour, or if the upper piece is the neck or cap of the lower: it
is centred on shoulders that slope away, where nothing can stand.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    mask_bounding_slices,
    mask_outline_pixels,
    values_in_mask,
)
from grs_agents.perception.segmentation.configuration import BottleNeck, OccludedPieces, Segmentation
from grs_agents.perception.segmentation.patch_cutting import Depth, find_depth_jumps, measure_label_borders
from grs_agents.perception.segmentation.piece_colors import (
    Colors,
    PlainColorTest,
    color_bins,
    color_histogram,
    lab_colors,
)
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame


def join_touching_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, table: TableFrame, config: Segmentation
) -> Labels:
    """(H, W) labels, 1..N, with the touching pieces of each object joined; ``points`` are (H, W, 3) in the robot frame.
    The rules are "plain_color" and "neck"."""
    below, right = find_depth_jumps(frame.depth)
    length, jumps = measure_label_borders(labels, np.zeros(labels.shape), below, right, 1.0)
    touching = length - jumps >= np.maximum(config.touching.shortest, config.touching.open * length)
    tests = {
        "plain_color": PlainColorTest(labels, frame.rgb, config.plain),
        "neck": NeckTest(labels, points, np.asarray(table.T_robot_cam)[:3, 3], config.neck),
    }
    active = [test for rule, test in tests.items() if rule in config.rules]
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    for first, second in np.argwhere(np.triu(touching, 1)).tolist():
        if any(test.is_one_object(first, second) for test in active):
            numbers[numbers == numbers[second]] = numbers[first]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


class NeckTest:
    """Tests whether the upper of two pieces is the neck of the lower."""

    def __init__(self, labels: Labels, points: Array, eye: Array, config: BottleNeck) -> None:
        self.labels, self.points, self.eye, self.config = labels, points, eye, config
        self.clouds: dict[int, Array] = {}

    def is_one_object(self, first: int, second: int) -> bool:
        """Whether of two touching labels the higher is the neck of the lower."""
        for label in (first, second):
            if label not in self.clouds:
                known = self.points[self.labels == label]
                self.clouds[label] = known[np.isfinite(known[:, 2])]
        neck, body = self.clouds[first], self.clouds[second]
        if min(len(neck), len(body)) < self.config.fewest:
            return False
        if np.median(neck[:, 2]) < np.median(body[:, 2]):
            first, second, neck, body = second, first, body, neck
        (foot, top), (bottom, shoulder) = (compute_percentiles(cloud[:, 2], (3, 97)) for cloud in (neck, body))
        if abs(foot - shoulder) > self.config.apart or top - foot > self.config.tallest * (shoulder - bottom):
            return False
        # Centred: the middles of neck and body agree, left and right in the camera's view.
        away_x, away_y = (neck.mean(axis=0) - self.eye)[:2]
        across = np.array([-away_y, away_x]) / np.hypot(away_x, away_y)
        middles = [compute_percentiles(cloud[:, :2] @ across, (3, 97)).mean() for cloud in (neck, body)]
        if abs(middles[0] - middles[1]) >= self.config.off:
            return False
        # Sloping away: the body's surface around the neck is lower than their border.
        window = mask_bounding_slices((self.labels == first) | (self.labels == second))
        labels, heights = self.labels[window], self.points[window][..., 2]
        upper, lower = labels == first, labels == second
        border = (upper & _grown(lower, 1)) | (lower & _grown(upper, 1))
        around = heights[lower & _grown(border, self.config.around)]
        around, seam = around[np.isfinite(around)], heights[border]
        if len(around) < self.config.fewest or not np.isfinite(seam).any():
            return False
        middle, highest = compute_percentiles(around, (50, 80))
        level = float(np.nanmedian(seam))
        return bool(level - middle > self.config.slope[0] and level - highest > self.config.slope[1])


def _grown(mask: Mask, by: int) -> Mask:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)) > 0


@dataclass(frozen=True)
class Piece:
    """A segment that may continue behind an occluder."""

    top: float  # height, m
    flat: float  # share of its points near the top
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
            flat=float((np.abs(cloud[:, 2] - top) < config.level).mean()),
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
    receding: float  # slope by which both surfaces turn away from the camera towards the gap; NaN for a narrow piece
    foreign: float  # share of it without depth, and of neither end's colour

    @classmethod
    def measure(
        cls, start: Array, end: Array, labels: Labels, frame: RGBDFrame, colors: Colors, config: OccludedPieces
    ) -> "GapLine":
        """The line between two pixels (column, row)."""
        count = int(np.hypot(*(end - start)))
        steps = np.linspace(0, 1, max(count, 3))[:, None]
        columns, rows = np.rint(start + steps * (end - start)).astype(int).T
        depth, owner = frame.depth[rows, columns].astype(np.float64), labels[rows, columns]
        first, last = depth[[0, -1]]
        between = first + steps[1:-1, 0] * (last - first)
        occluder = ~np.isin(owner[1:-1], (0, owner[0], owner[-1]))
        hidden = (depth[1:-1] <= 0) | (occluder & (depth[1:-1] < between - config.nearer))
        line = colors[rows, columns]
        off = np.linalg.norm(line[1:-1, None] - line[[0, -1]], axis=2).min(axis=1)
        foreign = (depth[1:-1] <= 0) & (off > config.off_color)
        pixel = max(first, last) / frame.camera.fx
        inward = config.inner * (end - start) / max(count, 1)
        inside: list[float] = []  # depth within each piece, NaN if it is too narrow or not measured there
        for place, label in ((start - inward, owner[0]), (end + inward, owner[-1])):
            column, row = np.clip(np.rint(place).astype(int), 0, np.array(labels.shape[::-1]) - 1)
            known = labels[row, column] == label and frame.depth[row, column] > 0
            inside.append(float(frame.depth[row, column]) if known else float("nan"))
        receding = (first - inside[0] + last - inside[1]) / (2 * config.inner * max(pixel, 1e-6))
        return cls(float(hidden.mean()), count * pixel, abs(float(last - first)), receding, float(foreign.mean()))


def join_occluded_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, config: OccludedPieces = DEFAULT.segmentation.occluded
) -> Labels:
    """(H, W) labels, 1..N, with pieces joined that an occluder, or a gap in the depth, separates in the picture.
    ``points`` are (H, W, 3) in the robot frame."""
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    colors = lab_colors(frame.rgb)
    bins = color_bins(colors)
    pieces = [Piece.measure(labels == label, frame, bins, points, config) for label in range(1, len(numbers))]
    for number, first in enumerate(pieces, 1):
        for another, second in enumerate(pieces[number:], number + 1):
            if _are_flat_and_occluded(first, second, labels, frame.depth, config) or (
                float(first.histogram @ second.histogram) > config.alike
                and _is_gap_hidden(first, second, labels, frame, colors, config)
            ):
                numbers[numbers == numbers[another]] = numbers[number]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


def _are_flat_and_occluded(first: Piece, second: Piece, labels: Labels, depth: Depth, config: OccludedPieces) -> bool:
    """Whether two pieces have level tops and similar colours, form a rectangle or are flat, and the shortest way
    between them leads over nearer objects."""
    hull = convex_footprint_hull(np.concatenate([first.footprint, second.footprint])).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(hull)
    if abs(first.top - second.top) > config.same_level or max(sides) >= config.longest:
        return False
    if cv2.contourArea(hull) > config.rectangle * sides[0] * sides[1]:
        hue, brightness = config.printed
    elif min(first.flat, second.flat) >= config.flat:
        hue, brightness = config.hue, config.brightness
    else:
        return False
    bright, dark = max(first.color.sum(), second.color.sum()), min(first.color.sum(), second.color.sum())
    if not dark or bright >= brightness * dark:
        return False
    if np.linalg.norm(first.color / first.color.sum() - second.color / second.color.sum()) >= hue:
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


def _is_gap_hidden(
    first: Piece, second: Piece, labels: Labels, frame: RGBDFrame, colors: Colors, config: OccludedPieces
) -> bool:
    """Whether the gap between two pieces is hidden, and their surfaces may continue into each other, by the medians
    over the shortest lines from outline to outline."""
    squares = ((first.outline[:, None] - second.outline[None]) ** 2).sum(axis=2)
    starts = np.argsort(squares.min(axis=1))[: config.lines]
    ends = second.outline[squares[starts].argmin(axis=1)]
    lines: list[GapLine] = []
    for start, end in zip(first.outline[starts], ends, strict=True):
        if abs(end - start).max() < 3:  # they touch
            continue
        lines.append(GapLine.measure(start, end, labels, frame, colors, config))
        if lines[0].length > config.widest:
            break  # the others are no shorter
    if not lines:
        return False
    hidden, length, step, foreign = np.median(
        [(line.hidden, line.length, line.step, line.foreign) for line in lines], axis=0
    )
    if hidden < config.hidden or length > config.widest or step > config.steepest * length:
        return False
    if length < config.slit and foreign > config.foreign:
        return False
    receding = [line.receding for line in lines if np.isfinite(line.receding)]
    return not receding or float(np.median(receding)) < config.receding
