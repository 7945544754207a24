"""The rim of a bowl: a circle that says where it stands and how wide it is, whatever of its side is hidden."""

import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import axes_from_yaws, compute_percentiles, fit_smallest_rectangle
from grs_agents.perception.types import Array

CONFIG = DEFAULT.measuring.rim


def fit_bowl_rim(cloud: Array) -> tuple[tuple[float, float], float] | None:
    """Centre (x, y) and diameter (m) of the rim of (N, 3) points of an open object; ``None`` if it is no round bowl."""
    bottom, top = (float(level) for level in compute_percentiles(cloud[:, 2], [2, 98]))
    rim = cloud.compress(cloud[:, 2] > top - CONFIG.high, axis=0)[:, :2]
    kept, center, radius = rim, np.zeros(2), 0.0
    for _ in range(CONFIG.rounds):
        if len(kept) < CONFIG.fewest:
            return None
        center, radius = _fit_circle(kept)
        off = np.abs(np.hypot(*(rim - center).T) - radius)
        kept = rim.compress(off < max(CONFIG.near, 2 * float(np.median(off))), axis=0)
    away = kept - center
    reach = np.hypot(*away.T)
    sectors = np.floor(np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) * CONFIG.sectors).astype(np.int64)
    height = top - bottom
    if height > CONFIG.flat * 2 * radius or len(np.unique(sectors)) < CONFIG.seen * CONFIG.sectors:
        return None
    beyond = np.hypot(*(cloud[:, :2] - center).T) > CONFIG.wide * radius
    if (beyond & (cloud[:, 2] > bottom + CONFIG.low * height)).mean() > CONFIG.handle:
        return None
    if np.abs(np.hypot(*(rim - center).T) - radius).mean() > CONFIG.better * _mean_rectangle_distance(rim):
        return None
    return (float(center[0]), float(center[1])), 2 * float(compute_percentiles(reach, [95])[0])


def _mean_rectangle_distance(points: Array) -> float:
    """How far (N, 2) points lie from the outline of the rectangle around them on average, m."""
    center, sides, yaw = fit_smallest_rectangle(points)
    beyond = np.abs((points - center) @ axes_from_yaws(np.array([yaw]))[0].T) - np.array(sides) / 2
    return float(np.abs(beyond.max(axis=1)).mean())


def _fit_circle(points: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle nearest to (N, 2) points, by algebraic least squares."""
    middle = points.mean(axis=0)
    local = points - middle
    columns = np.column_stack([2 * local, np.ones(len(local))])
    solution: Array = np.asarray(np.linalg.lstsq(columns, (local**2).sum(axis=1), rcond=None)[0], np.float64)
    return middle + solution[:2], float(np.sqrt(max(float(solution[2] + (solution[:2] ** 2).sum()), 0.0)))
