"""Join the pieces of one object that something in front of it, or a gap in the depth, separates in the picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

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
from grs_agents.perception.types import Array, Mask, RGBDFrame

Colors = npt.NDArray[np.float32]


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
class Way:
    """A straight way in the picture from a pixel of one piece to one of another."""

    hidden: float  # the share of it that is not measured, or is nearer than both ends
    length: float  # metres, as far away as it is
    rise: float  # metres that one end is deeper than the other
    receding: float  # how steeply both surfaces go away from the camera towards it; NaN where a piece is too narrow
    foreign: float  # the share of it that is not measured, and has the colour of neither end


def join_occluded_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, config: OccludedPieces = DEFAULT.segmentation.occluded
) -> Labels:
    """(H, W) labels, 1..N, with the occluded pieces joined; ``points`` are (H, W, 3) in the robot frame."""
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    lab = np.asarray(cv2.cvtColor(frame.rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float32)
    bins = _color_bins(lab)
    pieces = {label: _measure_piece(labels == label, frame, bins, points, config) for label in range(1, len(numbers))}
    for one, first in pieces.items():
        for other, second in pieces.items():
            if one >= other:
                continue
            flat = _are_similar_pieces(first, second, config) and _are_separated_by_occluder(
                first, second, labels, frame.depth, config.between
            )
            alike = float(first.histogram @ second.histogram) > config.alike
            if flat or (alike and _is_gap_hidden(_shortest_ways(first, second, labels, frame, lab, config), config)):
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
        _color_histogram(bins.take(np.flatnonzero(mask))),
    )


def _color_bins(lab: Colors) -> Index:
    """(H, W) the bin of each colour in CIE L*a*b*: five of lightness, twelve each of a* and b* from -60 to 60."""
    light, red, yellow = np.moveaxis(lab, -1, 0)
    return (
        np.clip(light // 20, 0, 4) * 144 + np.clip(red // 10 + 6, 0, 11) * 12 + np.clip(yellow // 10 + 6, 0, 11)
    ).astype(np.intp)


def _color_histogram(bins: Index) -> Array:
    """(720,) square roots of the shares of colours by bin: the products of two add up to 1 if they agree
    (Bhattacharyya)."""
    counts = np.bincount(bins, minlength=720).reshape(5, 12, 12).astype(np.float64)
    spread = cv2.GaussianBlur(np.moveaxis(counts, 0, -1), (5, 5), 0.6).reshape(144, 5)
    spread = cv2.GaussianBlur(spread, (5, 1), 0.8).ravel()  # noise at the limit of two bins falls into both
    return np.sqrt(spread / max(float(spread.sum()), 1.0))


def _is_gap_hidden(ways: Sequence[Way], config: OccludedPieces) -> bool:
    """Whether what is between two pieces is not seen, and the surface of one can go on to the other."""
    if not ways:
        return False
    hidden, length, rise, foreign = np.median([(way.hidden, way.length, way.rise, way.foreign) for way in ways], axis=0)
    if hidden < config.hidden or length > config.widest or rise > config.steepest * length:
        return False
    if length < config.slit and foreign > config.foreign:
        return False
    receding = [way.receding for way in ways if np.isfinite(way.receding)]
    return not receding or float(np.median(receding)) < config.receding


def _shortest_ways(
    one: Piece, other: Piece, labels: Labels, frame: RGBDFrame, lab: Colors, config: OccludedPieces
) -> list[Way]:
    """The shortest ways from pixels of the outline of one piece to the other; none where they touch."""
    squares = ((one.outline[:, None] - other.outline[None]) ** 2).sum(axis=2)
    starts = np.argsort(squares.min(axis=1))[: config.ways]
    ends = other.outline[squares[starts].argmin(axis=1)]
    pairs = [pair for pair in zip(one.outline[starts], ends, strict=True) if abs(pair[1] - pair[0]).max() >= 3]
    ways: list[Way] = []
    for start, end in pairs:
        ways.append(_measure_way(start, end, labels, frame, lab, config))
        if ways[0].length > config.widest:
            break  # the others are no shorter
    return ways


def _measure_way(
    start: Array, end: Array, labels: Labels, frame: RGBDFrame, lab: Colors, config: OccludedPieces
) -> Way:
    count = int(np.hypot(*(end - start)))
    steps = np.linspace(0, 1, max(count, 3))[:, None]
    columns, rows = np.rint(start + steps * (end - start)).astype(int).T
    depth, owner = frame.depth[rows, columns].astype(np.float64), labels[rows, columns]
    first, last = depth[[0, -1]]
    line = first + steps[1:-1, 0] * (last - first)
    other = ~np.isin(owner[1:-1], (0, owner[0], owner[-1]))
    hidden = (depth[1:-1] <= 0) | (other & (depth[1:-1] < line - config.nearer))
    colors = lab[rows, columns]
    off = np.linalg.norm(colors[1:-1, None] - colors[[0, -1]], axis=2).min(axis=1)
    foreign = (depth[1:-1] <= 0) & (off > config.off_color)
    pixel = max(first, last) / frame.camera.fx
    step = config.inner * (end - start) / max(count, 1)
    inside = [
        _depth_of_piece(place, label, labels, frame.depth)
        for place, label in ((start - step, owner[0]), (end + step, owner[-1]))
    ]
    receding = (first - inside[0] + last - inside[1]) / (2 * config.inner * max(pixel, 1e-6))
    return Way(float(hidden.mean()), count * pixel, abs(float(last - first)), receding, float(foreign.mean()))


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
