"""Join the pieces of one object that something in front of it, or a gap in the depth, separates in the picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    mask_outline_pixels,
    values_in_mask,
)
from grs_agents.perception.segmentation.configuration import OccludedPieces
from grs_agents.perception.segmentation.patch_cutting import Depth
from grs_agents.perception.segmentation.piece_colors import Colors, color_bins, color_histogram, lab_colors
from grs_agents.perception.types import Array, Mask, RGBDFrame


@dataclass(frozen=True)
class Piece:
    """A segment: its top (m), how much of it is flat, mean colour (3,), outline (M, 2 columns and rows), footprint."""

    top: float
    flat: float
    color: Array
    outline: Array
    footprint: Array
    histogram: Array  # (K,) square roots of the shares of its colours


@dataclass(frozen=True)
class GapLine:
    """A straight line in the picture across the gap between two pieces."""

    hidden: float  # share of it that has no depth, or shows something nearer
    length: float  # metres
    step: float  # metres of depth between its ends
    receding: float  # slope by which both surfaces turn away from the camera towards the gap; NaN for a narrow piece
    foreign: float  # share of it that has no depth, and the colour of neither end


def join_occluded_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, config: OccludedPieces = DEFAULT.segmentation.occluded
) -> Labels:
    """(H, W) labels, 1..N, with the occluded pieces joined; ``points`` are (H, W, 3) in the robot frame."""
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    colors = lab_colors(frame.rgb)
    bins = color_bins(colors)
    pieces = {label: _measure_piece(labels == label, frame, bins, points, config) for label in range(1, len(numbers))}
    for one, first in pieces.items():
        for other, second in pieces.items():
            if one >= other:
                continue
            flat = _are_similar_pieces(first, second, config) and _are_separated_by_occluder(
                first, second, labels, frame.depth, config.between
            )
            alike = float(first.histogram @ second.histogram) > config.alike
            if flat or (
                alike and _is_gap_hidden(_lines_across_gap(first, second, labels, frame, colors, config), config)
            ):
                numbers[numbers == numbers[other]] = numbers[one]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


def _measure_piece(mask: Mask, frame: RGBDFrame, bins: Index, points: Array, config: OccludedPieces) -> Piece:
    cloud = values_in_mask(points, mask)
    cloud = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)[::5]
    top = float(compute_percentiles(cloud[:, 2], [90])[0])
    flat = float((np.abs(cloud[:, 2] - top) < config.level).mean())
    outline = mask_outline_pixels(mask)[::3].astype(np.float64)
    return Piece(
        top,
        flat,
        values_in_mask(frame.rgb, mask).mean(axis=0),
        outline,
        convex_footprint_hull(cloud),
        color_histogram(bins.take(np.flatnonzero(mask))),
    )


def _is_gap_hidden(lines: Sequence[GapLine], config: OccludedPieces) -> bool:
    """Whether what is between two pieces is not seen, and the surface of one can go on to the other."""
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


def _lines_across_gap(
    one: Piece, other: Piece, labels: Labels, frame: RGBDFrame, colors: Colors, config: OccludedPieces
) -> list[GapLine]:
    """The shortest lines from the outline of one piece to that of the other; none where they touch."""
    squares = ((one.outline[:, None] - other.outline[None]) ** 2).sum(axis=2)
    starts = np.argsort(squares.min(axis=1))[: config.lines]
    ends = other.outline[squares[starts].argmin(axis=1)]
    pairs = [pair for pair in zip(one.outline[starts], ends, strict=True) if abs(pair[1] - pair[0]).max() >= 3]
    lines: list[GapLine] = []
    for start, end in pairs:
        lines.append(_measure_line(start, end, labels, frame, colors, config))
        if lines[0].length > config.widest:
            break  # the others are no shorter
    return lines


def _measure_line(
    start: Array, end: Array, labels: Labels, frame: RGBDFrame, colors: Colors, config: OccludedPieces
) -> GapLine:
    count = int(np.hypot(*(end - start)))
    steps = np.linspace(0, 1, max(count, 3))[:, None]
    columns, rows = np.rint(start + steps * (end - start)).astype(int).T
    depth, owner = frame.depth[rows, columns].astype(np.float64), labels[rows, columns]
    first, last = depth[[0, -1]]
    between = first + steps[1:-1, 0] * (last - first)
    other = ~np.isin(owner[1:-1], (0, owner[0], owner[-1]))
    hidden = (depth[1:-1] <= 0) | (other & (depth[1:-1] < between - config.nearer))
    own = colors[rows, columns]
    off = np.linalg.norm(own[1:-1, None] - own[[0, -1]], axis=2).min(axis=1)
    foreign = (depth[1:-1] <= 0) & (off > config.off_color)
    pixel = max(first, last) / frame.camera.fx
    inward = config.inner * (end - start) / max(count, 1)
    inside = [
        _depth_of_piece(place, label, labels, frame.depth)
        for place, label in ((start - inward, owner[0]), (end + inward, owner[-1]))
    ]
    receding = (first - inside[0] + last - inside[1]) / (2 * config.inner * max(pixel, 1e-6))
    return GapLine(float(hidden.mean()), count * pixel, abs(float(last - first)), receding, float(foreign.mean()))


def _depth_of_piece(place: Array, label: int, labels: Labels, depth: Depth) -> float:
    """Depth at a pixel (column, row) of a piece; NaN where the pixel is not its own, or not measured."""
    column, row = np.clip(np.rint(place).astype(int), 0, np.array(labels.shape[::-1]) - 1)
    return float(depth[row, column]) if labels[row, column] == label and depth[row, column] > 0 else float("nan")


def _are_similar_pieces(one: Piece, other: Piece, config: OccludedPieces) -> bool:
    both = convex_footprint_hull(np.concatenate([one.footprint, other.footprint])).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(both)
    if abs(one.top - other.top) > config.same_level or max(sides) >= config.longest:
        return False
    if cv2.contourArea(both) > config.rectangle * sides[0] * sides[1]:
        return _are_alike_in_color(one.color, other.color, *config.printed)
    flat = min(one.flat, other.flat) >= config.flat
    return flat and _are_alike_in_color(one.color, other.color, config.hue, config.brightness)


def _are_alike_in_color(one: Array, other: Array, hue: float, brightness: float) -> bool:
    bright, dark = max(one.sum(), other.sum()), min(one.sum(), other.sum())
    off = np.linalg.norm(one / one.sum() - other / other.sum()) if dark else np.inf
    return bool(off < hue and bright < brightness * dark)


def _are_separated_by_occluder(one: Piece, other: Piece, labels: Labels, depth: Depth, share: float) -> bool:
    """Whether the shortest way between two pieces leads over other objects that are nearer than they are."""
    squares = ((one.outline[:, None] - other.outline[None]) ** 2).sum(axis=2)
    start, end = np.unravel_index(int(squares.argmin()), squares.shape)
    count = int(np.sqrt(squares.min()))
    if count < 4:
        return False
    steps = np.linspace(0, 1, count)
    way = np.rint(one.outline[start] + steps[:, None] * (other.outline[end] - one.outline[start])).astype(int)
    passed = labels[way[:, 1], way[:, 0]]
    others = ~np.isin(passed[1:-1], (0, passed[0], passed[-1]))
    along = depth[way[:, 1], way[:, 0]].astype(np.float64)
    first, last = along[[0, -1]]
    nearer = along[1:-1] < first + steps[1:-1] * (last - first)
    return bool(others.mean() >= share and nearer.mean() >= share)
