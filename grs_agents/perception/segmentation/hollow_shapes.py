"""Whether points are an object that is open at the top, or the top of a solid one."""

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    compute_percentiles,
    convex_footprint_hull,
    points_in_box_mask,
    points_in_hull_mask,
)
from grs_agents.perception.segmentation.configuration import HollowShape
from grs_agents.perception.types import Array

HOLLOW = DEFAULT.segmentation.hollow
LEAST_AREA = 5e-4  # of a footprint, m^2: a smaller one is too small to have an inside or a middle


def is_open_at_top(cloud: Array, table: Array, config: HollowShape = HOLLOW) -> bool:
    """Whether an object is hollow: its highest points (N, 3), m above the table, surround an inside that lies deeper.
    Some of the table's points (M, 3) may be seen through it or taken for its floor."""
    top = float(compute_percentiles(cloud[:, 2], [98])[0])
    if top < 2 * config.deep:
        return False
    hull = convex_footprint_hull(cloud)
    area = float(cv2.contourArea(hull.astype(np.float32)))
    rim = cloud.compress(cloud[:, 2] > top - config.rim, axis=0)
    if (
        area < LEAST_AREA
        or float(cv2.contourArea(convex_footprint_hull(rim).astype(np.float32))) < config.surrounded * area
    ):
        return False
    near = table.compress(points_in_box_mask(table[:, :2], hull.min(axis=0), hull.max(axis=0)), axis=0)
    points = np.concatenate([cloud, near])
    inner = points[points_in_hull_mask(points[:, :2], hull, -min(config.rim, 0.15 * area**0.5))]
    return float((inner[:, 2] > top - config.deep).sum()) < config.shallow * len(inner) or len(inner) < 10


def is_solid_object(cloud: Array, config: HollowShape = HOLLOW) -> bool:
    """Whether (N, 3) points are the top of an object of its own: all of its footprint is seen, highest in its middle.

    The inside of a hollow object is lowest there, a wall is too thin to have a middle, and a floor lies on the table.
    """
    hull = convex_footprint_hull(cloud)
    area = float(cv2.contourArea(hull.astype(np.float32)))
    if area < LEAST_AREA:
        return False
    cell, low = area**0.5 / config.cells, hull.min(axis=0)
    columns, rows = np.floor((cloud[:, :2] - low) / cell).astype(np.int64).T
    tops = np.full((int(columns.max()) + 1, int(rows.max()) + 1), -np.inf)
    np.maximum.at(tops, (columns, rows), cloud[:, 2])
    centers = (np.indices(tops.shape).reshape(2, -1).T + 0.5) * cell + low
    heights = tops.ravel()
    inside, middle = points_in_hull_mask(centers, hull, 0.0), points_in_hull_mask(centers, hull, -1.5 * cell)
    seen = np.isfinite(heights)
    if not (middle & seen).any() or seen[inside].mean() < config.filled or seen[middle].mean() < config.filled:
        return False
    inner = float(np.median(heights[middle & seen]))
    outer = float(compute_percentiles(heights[inside & seen & ~middle], [80])[0])  # a slope is higher on one side
    return inner > max(config.raised, outer - config.sag)
