"""Planes in the points of a photo, of any orientation or level, by sequential RANSAC and least squares."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import Array

CONFIG = DEFAULT.table

Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Plane:
    """``normal @ point + offset = 0`` in the camera frame."""

    normal: Array  # (3,) unit normal towards the camera
    offset: float  # distance of the camera from the plane, m
    center: Array  # (3,) median of the points that lie on it, m
    residual: float  # root mean square distance of those points, m
    share: float  # of the sampled pixels that lie on it

    def heights_of_points(self, points: Array) -> Array:
        """Heights (...,) of (..., 3) points over the plane, m."""
        return points @ self.normal + self.offset

    def height_in_frame(self, pose: Array) -> float:
        """The z of the plane at the middle of its points, transformed by the 4x4 ``pose``, m."""
        center = self.center - self.normal * float(self.normal @ self.center + self.offset)
        return float(pose[2, :3] @ center + pose[2, 3])

    def is_level(self, up: Array) -> bool:
        """Whether the normal is the direction ``up`` (3,), up to the tolerance of a level plane."""
        return bool(self.normal @ up > np.cos(CONFIG.level))


def depth_tolerance(distance: Array) -> Array:
    """Tolerance of a depth pixel against its plane, m; noise grows with the square of the distance."""
    return 0.005 + 0.003 * distance**2


def find_level_planes(points: Array, up: Array, rng: np.random.Generator, known: Sequence[Plane] = ()) -> list[Plane]:
    """The level planes with enough of (N, 3) points (camera frame, m), well above each other, from the lowest up.

    ``up`` (3,) is the direction of the vertical in the camera frame; ``known`` are level planes found before."""
    planes: list[Plane] = []
    rest = points
    while len(rest) >= max(3, CONFIG.listed_share * len(points)):
        triples = np.stack([rng.choice(len(rest), size=3, replace=False) for _ in range(CONFIG.rounds)])
        fitted = _fit_largest_plane(rest, triples, up, len(points))
        plane = max(known if fitted is None else (fitted, *known), key=lambda plane: plane.share, default=None)
        if plane is None or plane.share < CONFIG.listed_share:
            break
        rest = rest.compress(np.abs(plane.heights_of_points(rest)) > CONFIG.plane_distance, axis=0)
        known = [level for level in known if abs(plane.heights_of_points(level.center)) > CONFIG.plane_distance]
        if plane.is_level(up):  # least squares may have tilted it
            planes.append(plane)
    return sorted(planes, key=lambda plane: -plane.offset)


def find_planes(points: Array, rng: np.random.Generator) -> list[Plane]:
    """The planes of any orientation with enough of (N, 3) points (camera frame, m), in the order of their search."""
    planes: list[Plane] = []
    rest = points
    while len(rest) >= max(CONFIG.neighbors, CONFIG.listed_share * len(points)):
        # Near points lie on the same plane more often than any three.
        drawn = rng.integers(0, len(rest), (CONFIG.rounds, CONFIG.neighbors))
        rays = rest[:, :2] / rest[:, 2:]
        apart = ((rays[drawn] - rays[drawn[:, :1]]) ** 2).sum(axis=-1)
        triples = np.take_along_axis(drawn, np.argsort(apart, axis=1, kind="stable")[:, :3], axis=1)
        plane = _fit_largest_plane(rest, triples, None, len(points))
        if plane is None or plane.share < CONFIG.listed_share:
            break
        planes.append(plane)
        near = 2 * depth_tolerance(rest[:, 2])  # with the plane's own flying pixels and waves
        rest = rest.compress(np.abs(plane.heights_of_points(rest)) > near, axis=0)
    return planes


def _fit_largest_plane(points: Array, triples: Index, up: Array | None, total: int) -> Plane | None:
    """RANSAC plane with most of (N, 3) points, refined by least squares; its share is of ``total`` points.

    The hypotheses are planes through (R, 3) ``triples`` of points; with ``up`` (3,) they are level. Points a little
    below a plane, which a table would occlude, count against it."""
    bound = depth_tolerance(points[:, 2])
    best, normal, offset = 0, np.zeros(3), 0.0
    a, b, c = points[triples.T]
    crosses = np.cross(b - a, c - a)
    lengths = np.linalg.norm(crosses, axis=1)
    toward = np.where((crosses * a).sum(axis=1) > 0, -1.0, 1.0)
    units = crosses / np.maximum(lengths, 1e-12)[:, None] * toward[:, None]
    kept = lengths >= 1e-5
    if up is not None:
        kept &= units @ up > np.cos(CONFIG.level)
    for unit, through in zip(units[kept], (units * a).sum(axis=1)[kept], strict=True):
        distance = points @ unit - through
        count = np.count_nonzero(np.abs(distance) < bound / 2)
        if count > best:
            count -= np.count_nonzero((distance < -bound) & (distance > -CONFIG.occluded_depth))
        if count > best:
            best, normal, offset = count, unit, float(-through)
    if best <= 0:
        return None
    for _ in range(5):
        near = points.compress(np.abs(points @ normal + offset) < bound, axis=0)
        center = near.mean(axis=0)
        unit = np.linalg.svd(near - center, full_matrices=False)[2][2]
        normal = unit * (-1.0 if unit @ center > 0 else 1.0)
        offset = float(-normal @ center)
    distance = points @ normal + offset
    within = np.abs(distance) < bound
    center = np.median(points.compress(within, axis=0), axis=0)
    residual = float(np.sqrt(np.mean(distance[within] ** 2)))
    share = float(np.count_nonzero(within) / total)
    return Plane(normal=normal, offset=offset, center=center, residual=residual, share=share)
