"""Join the pieces of one flat object that another one in front of it separates in the picture."""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    mask_outline_pixels,
    values_in_mask,
)
from grs_agents.perception.segmentation.configuration import OccludedPieces
from grs_agents.perception.segmentation.patch_cutting import Depth
from grs_agents.perception.types import Array, Mask, RGBDFrame


@dataclass(frozen=True)
class Piece:
    """A segment: its top (m), how much of it is flat, mean colour (3,), outline (M, 2 columns and rows), footprint."""

    top: float
    flat: float
    color: Array
    outline: Array
    footprint: Array


def join_occluded_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, config: OccludedPieces = DEFAULT.segmentation.occluded
) -> Labels:
    """(H, W) labels, 1..N, with the occluded pieces joined; ``points`` are (H, W, 3) in the robot frame."""
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    pieces = {label: _measure_piece(labels == label, frame, points, config) for label in range(1, len(numbers))}
    for one, first in pieces.items():
        for other, second in pieces.items():
            if one >= other or not _are_similar_pieces(first, second, config):
                continue
            if _are_separated_by_occluder(first, second, labels, frame.depth, config.between):
                numbers[numbers == numbers[other]] = numbers[one]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]


def _measure_piece(mask: Mask, frame: RGBDFrame, points: Array, config: OccludedPieces) -> Piece:
    cloud = values_in_mask(points, mask)
    cloud = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)[::5]
    top = float(compute_percentiles(cloud[:, 2], [90])[0])
    flat = float((np.abs(cloud[:, 2] - top) < config.level).mean())
    outline = mask_outline_pixels(mask)[::3].astype(np.float64)
    return Piece(top, flat, values_in_mask(frame.rgb, mask).mean(axis=0), outline, convex_footprint_hull(cloud))


def _are_similar_pieces(one: Piece, other: Piece, config: OccludedPieces) -> bool:
    both = convex_footprint_hull(np.concatenate([one.footprint, other.footprint])).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(both)
    apart = abs(one.top - other.top)
    if apart > config.level or max(sides) >= config.longest:
        return False
    if apart < config.same_level and cv2.contourArea(both) > config.rectangle * sides[0] * sides[1]:
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
