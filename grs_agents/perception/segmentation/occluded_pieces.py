"""Join the pieces of one flat object that another one in front of it separates in the picture."""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT, OccludedPieces
from grs_agents.perception.image_geometry import (
    Labels,
    compute_percentiles,
    convex_footprint_hull,
    mask_outline_pixels,
    values_in_mask,
)
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
    if abs(one.top - other.top) > config.level or min(one.flat, other.flat) < config.flat:
        return False
    bright, dark = max(one.color.sum(), other.color.sum()), min(one.color.sum(), other.color.sum())
    hue = np.linalg.norm(one.color / one.color.sum() - other.color / other.color.sum()) if dark else np.inf
    both = np.concatenate([one.footprint, other.footprint])
    _, sides, _ = cv2.minAreaRect(both.astype(np.float32))
    return bool(hue < config.hue and bright < config.brightness * dark and max(sides) < config.longest)


def _are_separated_by_occluder(one: Piece, other: Piece, labels: Labels, depth: Depth, share: float) -> bool:
    """Whether the shortest way between two pieces leads over an object that is nearer than they are."""
    squares = ((one.outline[:, None] - other.outline[None]) ** 2).sum(axis=2)
    start, end = np.unravel_index(int(squares.argmin()), squares.shape)
    count = int(np.sqrt(squares.min()))
    if count < 4:
        return False
    steps = np.linspace(0, 1, count)
    way = np.rint(one.outline[start] + steps[:, None] * (other.outline[end] - one.outline[start])).astype(int)
    rows, columns = way[1:-1, 1], way[1:-1, 0]
    between = np.bincount(labels[rows, columns])
    between[0] = 0
    along = depth[way[:, 1], way[:, 0]].astype(np.float64)
    first, last = along[[0, -1]]
    nearer = along[1:-1] < first + steps[1:-1] * (last - first)
    return bool(between.max() >= share * len(rows) and nearer.mean() >= share)
