"""The rim of a bowl: a circle that says where it stands and how wide it is, whatever of its side is hidden."""

import numpy as np

from grs_agents.perception.image_geometry import percentiles, rectangle_of, turns
from grs_agents.perception.types import Array

FLAT = 0.6
"""What is higher than this share of its width is no bowl: a cup shows its side and its handle, which tell more."""
HIGH = 0.012
"""Points lower than this (m) below the top are not of the rim."""
FEWEST = 60
"""So few tell of no circle."""
ROUNDS = 5
NEAR = 0.004
"""Points nearer than this (m) to the circle always count."""
BETTER = 0.8
"""A round rim is off a circle by less than this share of what it is off a rectangle, on average."""
SECTORS, SEEN = 24, 0.6
"""The circle is cut into so many sectors; in this share of them points must lie."""
WIDE, LOW = 1.24, 0.5
"""What reaches beyond so many radii is a handle; strays, if it is lower than this share of its height."""
HANDLE = 0.02
"""What has a handle of more than this share of the points is not round."""


def rim_of(cloud: Array) -> tuple[tuple[float, float], float] | None:
    """Centre (x, y) and diameter (m) of the rim of (N, 3) points of an open thing; ``None`` if it is no round bowl."""
    bottom, top = (float(level) for level in percentiles(cloud[:, 2], [2, 98]))
    rim = cloud.compress(cloud[:, 2] > top - HIGH, axis=0)[:, :2]
    kept, center, radius = rim, np.zeros(2), 0.0
    for _ in range(ROUNDS):
        if len(kept) < FEWEST:
            return None
        center, radius = _circle(kept)
        off = np.abs(np.hypot(*(rim - center).T) - radius)
        kept = rim.compress(off < max(NEAR, 2 * float(np.median(off))), axis=0)
    away = kept - center
    reach = np.hypot(*away.T)
    sectors = np.floor(np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) * SECTORS).astype(np.int64)
    handle = (np.hypot(*(cloud[:, :2] - center).T) > WIDE * radius) & (cloud[:, 2] > bottom + LOW * (top - bottom))
    if top - bottom > FLAT * 2 * radius or len(np.unique(sectors)) < SEEN * SECTORS or handle.mean() > HANDLE:
        return None
    if np.abs(np.hypot(*(rim - center).T) - radius).mean() > BETTER * _off_rectangle(rim):
        return None
    return (float(center[0]), float(center[1])), 2 * float(percentiles(reach, [95])[0])


def _off_rectangle(points: Array) -> float:
    """How far (N, 2) points lie from the outline of the rectangle around them on average, m."""
    center, sides, yaw = rectangle_of(points)
    beyond = np.abs((points - center) @ turns(np.array([yaw]))[0].T) - np.array(sides) / 2
    return float(np.abs(beyond.max(axis=1)).mean())


def _circle(points: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle nearest to (N, 2) points, by algebraic least squares."""
    middle = points.mean(axis=0)
    local = points - middle
    columns = np.column_stack([2 * local, np.ones(len(local))])
    solution: Array = np.asarray(np.linalg.lstsq(columns, (local**2).sum(axis=1), rcond=None)[0], np.float64)
    return middle + solution[:2], float(np.sqrt(max(float(solution[2] + (solution[:2] ** 2).sum()), 0.0)))
