"""Segment what stands on the table by depth: foreground above the plane, cut at depth jumps and concave creases, with
the parts of one object merged again."""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.scene.frame import Array, Mask, RGBDFrame
from grs_agents.scene.merging import Labels, inside_hull, merge_parts
from grs_agents.scene.table import robot_points, tolerance
from grs_agents.scene.types import TableFrame

TALLEST = 0.6
"""What rises higher above the table (m) is not an object on it."""
LOWEST = 0.006
CREASE = 0.075
"""Sagitta over chord of a concave crease; 0.075 is a bend of about 17 degrees."""
REACH = 0.008
"""Creases are looked for across this distance on the surface, metres."""
SMALLEST = 0.0004
"""The least share of the picture that an object covers."""


def segment(frame: RGBDFrame, table: TableFrame) -> Labels:
    """(H, W) labels: 0 for table and background, 1..N for the segments."""
    smooth = _smooth(frame)
    points = robot_points(smooth, table)
    foreground = _foreground(points, smooth.depth)
    creases = _creases(smooth, foreground)
    cores = cv2.erode((foreground & ~creases).astype(np.uint8), np.ones((3, 3), np.uint8))
    labels = _components(cores, int(SMALLEST / 3 * foreground.size))
    labels = _grown(labels, foreground, smooth.depth)
    labels = merge_parts(labels, points)
    smallest = int(SMALLEST * foreground.size)
    kept = [label for label in range(1, int(labels.max()) + 1) if (labels == label).sum() >= smallest]
    result = np.zeros_like(labels)
    for number, label in enumerate(kept, 1):
        result[labels == label] = number
    return result


def _smooth(frame: RGBDFrame) -> RGBDFrame:
    """Small holes filled and noise smoothed without crossing edges."""
    depth = frame.depth.copy()
    closed = cv2.morphologyEx(depth, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    depth[depth == 0] = closed[depth == 0]
    depth = cv2.medianBlur(depth, 5)
    soft = cv2.bilateralFilter(depth, 9, 0.012, 4).astype(np.float32)
    soft[depth == 0] = 0
    return RGBDFrame(frame.rgb, soft, frame.camera, frame.source)


def _foreground(points: Array, depth: npt.NDArray[np.float32]) -> Mask:
    """Pixels above the table and over its visible extent."""
    height = points[..., 2]
    bound = tolerance(depth.astype(np.float64))
    flat = np.abs(np.nan_to_num(height, nan=9.0)) < bound
    labels = _components(cv2.erode(flat.astype(np.uint8), np.ones((3, 3), np.uint8)), 50)
    if labels.max() == 0:
        return np.zeros(depth.shape, np.bool_)
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    biggest = int(areas.argmax())
    hull = _hull(points[labels == biggest])
    for label in np.argsort(-areas)[1:12]:
        if areas[label] < 0.01 * areas[biggest]:
            break
        piece = points[labels == label]
        if inside_hull(piece[:, :2], hull, margin=0.3).mean() > 0.5:  # objects cut the table into pieces
            hull = _hull(np.concatenate([np.pad(hull, ((0, 0), (0, 1))), piece]))
    above = np.nan_to_num(height, nan=-9.0) > np.maximum(bound, LOWEST)
    above &= np.nan_to_num(height, nan=9.0) < TALLEST
    inside = np.zeros(depth.shape, np.bool_)
    rows, columns = np.nonzero(above)
    inside[rows, columns] = inside_hull(points[rows, columns, :2], hull, margin=0.02)
    opened = cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return opened.astype(np.bool_)


def _hull(points: Array) -> Array:
    """(M, 2) corners of the footprint of (N, 3) points."""
    return cv2.convexHull(points[:, :2].astype(np.float32)).reshape(-1, 2).astype(np.float64)


def _creases(frame: RGBDFrame, foreground: Mask) -> Mask:
    """Pixels at depth jumps and at concave bends of the surface."""
    depth = frame.depth.astype(np.float64)
    points = frame.points()
    known = frame.depth > 0
    found = np.zeros(depth.shape, np.bool_)
    steps = np.clip(np.rint(REACH * frame.camera.fx / max(float(np.median(depth[known])), 0.1)), 3, 24)
    step = int(steps)
    for axis in (0, 1):
        jump = np.abs(np.roll(depth, -1, axis) - depth) > 0.008 + 0.008 * depth
        found |= jump | np.roll(jump, 1, axis)
        before, after = np.roll(points, step, axis), np.roll(points, -step, axis)
        chord = np.linalg.norm(after - before, axis=-1)
        sag = ((before + after) / 2 - points)[..., 2]  # negative: the middle of the chord is nearer than the surface
        bent = (sag < -CREASE * np.maximum(chord, 1e-6)) & (chord < 6 * REACH)
        bent &= np.roll(known, step, axis) & np.roll(known, -step, axis)
        found |= bent
    return found & foreground


def _components(mask: npt.NDArray[np.uint8], smallest: int) -> Labels:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    keep = np.zeros(count, np.int32)
    big = [label for label in range(1, count) if stats[label, cv2.CC_STAT_AREA] >= max(smallest, 1)]
    keep[big] = np.arange(1, len(big) + 1)
    return keep[labels]


def _grown(labels: Labels, foreground: Mask, depth: npt.NDArray[np.float32]) -> Labels:
    """Give the foreground's other pixels to the segment they touch, step by step and never across a depth jump."""
    grown = labels.copy()
    for _ in range(12):
        empty = foreground & (grown == 0)
        if not empty.any():
            break
        update = grown.copy()
        for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
            neighbour = np.roll(grown, shift, axis)
            near = np.abs(np.roll(depth, shift, axis) - depth) < 0.008 + 0.008 * depth
            take = empty & (update == 0) & (neighbour > 0) & near
            update[take] = neighbour[take]
        grown = update
    return grown
