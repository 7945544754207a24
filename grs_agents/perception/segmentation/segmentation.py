"""Segment what stands on the table: the foreground's smooth patches, with the parts of one object merged.

What comes in from above, or from beyond the picture high over the table (arms, hands, lamps), is no object.
"""

import cv2
import numpy as np

from grs_agents.perception.image_geometry import (
    Labels,
    hull_of,
    inside_hull,
    is_open,
    outline_of,
    pixels_of,
    values_at,
    window_of,
)
from grs_agents.perception.segmentation.merging import merge_parts
from grs_agents.perception.segmentation.occluded_pieces import join_hidden
from grs_agents.perception.segmentation.patches import TALLEST, Depth, foreground, patches, smoothed
from grs_agents.perception.table import robot_points
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import reduced, restored

BORDER = 3
"""What comes within so many pixels of the picture's border is cut by it."""
FEWEST = 10
"""Fewer measured pixels at the border say nothing."""
CLEAR = 0.05
"""At the border an arm is higher than this (m) above the table."""
ROUND = 0.02
"""The heights of the flat top of a thing that the border cuts differ by less than this (m)."""
LONG = 0.15
"""An arm reaches in by more than this (m) along the table."""


def enters_from_outside(mask: Mask, points: Array) -> bool:
    """Whether a segment, (H, W), comes in from above or from beyond the picture.

    Args:
        mask: (H, W) its pixels.
        points: (H, W, 3) in the robot frame, NaN where unknown.
    """
    whole = _known(points[mask][::5])
    if len(whole) < FEWEST:
        return False
    lowest, highest = np.percentile(whole[:, 2], (2, 99))
    if highest > TALLEST - ROUND:
        return True
    sides = np.ones_like(mask)
    sides[BORDER:, BORDER:-BORDER] = False
    if lowest > CLEAR and len(_known(points[mask & sides])) >= FEWEST:
        return True  # only below the picture could it have a foot
    sides[-BORDER:] = True
    cut = _known(points[mask & sides])
    if len(cut) < FEWEST:
        return False
    low, high = np.percentile(cut[:, 2], (5, 95))
    reach = np.linalg.norm(whole[:, :2] - np.median(cut[:, :2], axis=0), axis=1)
    return bool(low > CLEAR and high - low > ROUND and np.percentile(reach, 98) > LONG)


def _known(points: Array) -> Array:
    return points[np.isfinite(points[:, 2])]


SMALLEST = 0.0004
"""The least share of the picture that an object covers."""
FLOOR = 0.015
"""The floor of a hollow thing lies within this height (m) of the table."""
VEIL = 2.0
"""A veil between two surfaces is this many times as deep as the side of a square of its pixels."""
FLATTEST = (0.007, 0.012)
"""What is lower than this (m), from a good sensor and from a bad one, is no object."""
DEVIATIONS = 5.0
"""It is so many standard deviations of the table's points."""


def segment(frame: RGBDFrame, table: TableFrame) -> Labels:
    """(H, W) labels: 0 for table and background, 1..N for the segments."""
    small, factor = reduced(frame)
    labels = _segmented(small, table)
    return labels if factor == 1 else restored(labels, small, frame, factor)


def _segmented(frame: RGBDFrame, table: TableFrame) -> Labels:
    smooth = smoothed(frame)
    points = robot_points(smooth, table)
    above = foreground(points, smooth.depth, np.asarray(table.T_robot_cam)[:3, 3])
    return objects_of(merge_parts(patches(smooth, above), points), smooth, points, table)


def objects_of(labels: Labels, smooth: RGBDFrame, points: Array, table: TableFrame) -> Labels:
    """(H, W) labels without what is no object, numbered anew; hidden parts are joined, floors of hollow things added.

    Args:
        labels: (H, W) merged segments, 0 for table and background.
        smooth: the frame that they were found in.
        points: (H, W, 3) in the robot frame, NaN where unknown.
        table: the table in it.
    """
    smallest = int(SMALLEST * labels.size)
    flattest = float(np.clip(DEVIATIONS * table.residual, *FLATTEST))
    pixels = pixels_of(labels)
    kept = [
        label
        for label, own in enumerate(pixels, 1)
        if len(own) >= smallest
        and not _is_sensor_noise(points.reshape(-1, 3).take(own, axis=0), 4 * smallest, flattest)
        and not _is_depth_edge(smooth.depth.take(own), smooth.camera.fx, 4 * smallest)
        and not enters_from_outside(labels == label, points)
    ]
    numbers = np.zeros(len(pixels) + 1, np.int32)
    numbers[kept] = np.arange(1, len(kept) + 1)
    return _filled(join_hidden(numbers[labels], smooth, points), points)


def _is_sensor_noise(cloud: Array, small: int, flattest: float) -> bool:
    """Whether a segment is a bump of the sensor's noise on the table."""
    top = float(np.nanpercentile(cloud[:, 2], 95))
    return top < flattest or (top < 2 * flattest and len(cloud) < small)


def _is_depth_edge(depth: Depth, focal: float, small: int) -> bool:
    """Whether a small segment is a streak of pixels mixed of two surfaces: much deeper than it looks large."""
    if len(depth) > small:
        return False
    low, middle, high = np.percentile(depth[depth > 0], (5, 50, 95))
    return bool(high - low > VEIL * np.sqrt(len(depth)) * middle / focal)


def _filled(labels: Labels, points: Array) -> Labels:
    """Give the table seen inside a hollow thing to it: that is its floor."""
    result = labels.copy()
    low = (labels == 0) & (np.abs(points[..., 2]) < FLOOR)
    for label in range(1, int(labels.max()) + 1):
        window = window_of(labels == label)
        mask: Mask = labels[window] == label
        near, found = points[window], result[window]
        whole = cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), cv2.convexHull(outline_of(mask)), 1)
        lies = low[window] & (whole > 0)
        floor, cloud = values_at(near, lies), values_at(near, mask)[::3]
        cloud = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)
        if len(cloud) >= 3 and is_open(cloud, floor[::3]):
            found[lies] = np.where(inside_hull(floor[:, :2], hull_of(cloud), -0.005), label, found[lies])
    return result
