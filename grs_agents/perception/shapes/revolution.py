"""Whether an object is round about an upright axis, and where that stands."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.types import Array

CONFIG = DEFAULT.revolution
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Axis:
    """An upright axis, and how well the seen surface turns about it."""

    x: float  # where it stands, object frame, m
    y: float
    share: float  # of the seen points that lie on the turned surface, and look away from the axis or towards it
    azimuth: float  # how much of the full turn they cover, rad


def fit_revolution_axis(seen: Observation) -> Axis | None:
    """The upright axis about which the seen surface turns best; ``None`` where too little of it is steep."""
    flat = np.linalg.norm(seen.normals[:, :2], axis=1)
    steep = flat > CONFIG.steep
    if np.count_nonzero(steep) < CONFIG.fewest:
        return None
    points, heights = seen.points[steep, :2], seen.points[steep, 2]
    normals = seen.normals[steep, :2] / flat[steep, None]
    slices = np.minimum(
        (heights - heights.min()) / max(float(np.ptp(heights)), 1e-3) * CONFIG.slices, CONFIG.slices - 1
    )
    center = _refine_center(points, normals, slices.astype(np.int64), _point_nearest_to_normals(points, normals))
    return _measure_axis_support(points, normals, slices.astype(np.int64), center, seen.noise)


def _point_nearest_to_normals(points: Array, normals: Array) -> Array:
    """(2,) the point that is nearest to the lines (N, 2) along the normals, those far off counting little."""
    across = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
    offsets, weights = (across * points).sum(axis=1), np.ones(len(points))
    center = points.mean(axis=0)
    for _ in range(CONFIG.rounds):
        weighted = across * (weights**2)[:, None]
        center = np.asarray(np.linalg.solve(weighted.T @ across + 1e-9 * np.eye(2), weighted.T @ offsets), np.float64)
        off = across @ center - offsets
        scale = max(CONFIG.line_distance, 1.5 * float(np.median(np.abs(off))))
        weights = 1 / (1 + (off / scale) ** 2)
    return center


def _slice_radii(points: Array, normals: Array, slices: Ints, center: Array) -> tuple[Array, Array, Ints]:
    """Each point's radius, the median of those in its slice and on its side of the wall, and the number of these."""
    off = points - center
    radii = np.linalg.norm(off, axis=1) + 1e-9
    group = 2 * slices + ((off * normals).sum(axis=1) < 0)
    order = np.lexsort((radii, group))
    first = np.searchsorted(group[order], np.arange(2 * CONFIG.slices + 1))
    middle = np.minimum((first[:-1] + first[1:]) // 2, len(radii) - 1)
    return radii, radii[order][middle][group], group


def _refine_center(points: Array, normals: Array, slices: Ints, center: Array) -> Array:
    """Gauss-Newton: in each slice all points of one side of the wall have one radius."""
    for _ in range(CONFIG.rounds):
        radii, expected, group = _slice_radii(points, normals, slices, center)
        error = radii - expected
        weight = 1 / (1 + (error / CONFIG.radius_error) ** 2)
        outward = (points - center) / radii[:, None]
        total = np.bincount(group, weights=weight, minlength=2 * CONFIG.slices) + 1e-12
        columns: list[Array] = []
        for values in (outward[:, 0], outward[:, 1], error):  # a slice's radius is free
            mean = np.bincount(group, weights=weight * values, minlength=2 * CONFIG.slices) / total
            columns.append(values - mean[group])
        slope, left = np.stack(columns[:2], axis=1), columns[2]
        step = np.asarray(
            np.linalg.solve(slope.T @ (slope * weight[:, None]) + 1e-6 * np.eye(2), slope.T @ (weight * left)),
            np.float64,
        )
        center = center + np.clip(step, -0.01, 0.01)
    return center


def _measure_axis_support(points: Array, normals: Array, slices: Ints, center: Array, noise: float) -> Axis:
    radii, expected, _ = _slice_radii(points, normals, slices, center)
    off = points - center
    radial = np.abs((off * normals).sum(axis=1)) / radii > CONFIG.radial
    on = radial & (np.abs(radii - expected) < np.maximum(2 * noise, CONFIG.out_of_round * expected))
    sectors = np.floor(np.arctan2(off[on, 1], off[on, 0]) / (2 * np.pi) * CONFIG.sectors)
    covered = len(np.unique(sectors)) / CONFIG.sectors * 2 * np.pi
    return Axis(float(center[0]), float(center[1]), float(on.mean()), covered)
