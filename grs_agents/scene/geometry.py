"""Small geometry on masks and footprints."""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.scene.frame import Array, Mask

Labels = npt.NDArray[np.int32]


def components(mask: npt.NDArray[np.uint8], smallest: int) -> Labels:
    """Number the 4-connected components of at least ``smallest`` pixels from 1; the rest is 0."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    keep = np.zeros(count, np.int32)
    big = [label for label in range(1, count) if stats[label, cv2.CC_STAT_AREA] >= max(smallest, 1)]
    keep[big] = np.arange(1, len(big) + 1)
    return keep[labels]


def hull_of(points: Array) -> Array:
    """(M, 2) corners of the convex footprint of (N, 2 or 3) points."""
    return cv2.convexHull(points[:, :2].astype(np.float32)).reshape(-1, 2).astype(np.float64)


def inside_hull(points: Array, hull: Array, margin: float) -> Mask:
    """Which of the (N, 2) ``points`` lie in the convex ``hull`` (M, 2) grown by ``margin`` metres."""
    if len(hull) < 3:
        return np.zeros(len(points), np.bool_)
    edges = np.roll(hull, -1, axis=0) - hull
    lengths = np.maximum(np.linalg.norm(edges, axis=1), 1e-9)
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths[:, None]
    normals *= np.where(((hull - hull.mean(axis=0)) * normals).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    offsets = (hull * normals).sum(axis=1)
    return np.asarray((points @ normals.T - offsets <= margin).all(axis=1), np.bool_)
