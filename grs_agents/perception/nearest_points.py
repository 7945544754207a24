"""Nearest points and point-to-plane alignment, by small_gicp."""

from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.perception.frame import Array

_NEIGHBOURS = 12
"""A surface's normal is found from so many points."""


def _library() -> Any:
    """The bindings; they come without types."""
    return import_module("small_gicp")


class Cloud:
    """Points (N, 3), m, with their normals, prepared for alignment."""

    def __init__(self, points: Array) -> None:
        gicp = _library()
        self.cloud: Any = gicp.PointCloud(np.ascontiguousarray(points))
        self.tree: Any = gicp.KdTree(self.cloud)
        gicp.estimate_normals_covariances(self.cloud, self.tree, num_neighbors=_NEIGHBOURS, num_threads=1)

    @property
    def normals(self) -> Array:
        """(N, 3) unit, of either sign."""
        return np.asarray(self.cloud.normals(), np.float64)[:, :3]


class Tree:
    """Finds the nearest of points (N, 3), m."""

    def __init__(self, points: Array) -> None:
        self._tree: Any = _library().KdTree(np.ascontiguousarray(points))

    def nearest(self, points: Array) -> tuple[npt.NDArray[np.int64], Array]:
        """For each of (M, 3) points the index of the nearest one, and the square of its distance, m^2."""
        indices, squares = self._tree.batch_nearest_neighbor_search(np.ascontiguousarray(points), num_threads=1)
        return np.asarray(indices, np.int64), np.asarray(squares, np.float64)


def align(target: Cloud, source: Cloud, start: Array, reach: float) -> Array:
    """The transform (4, 4) that lays ``source`` on ``target``, from ``start``; partners are within ``reach`` m."""
    found = _library().align(
        target.cloud, source.cloud, target.tree, start, registration_type="GICP", max_correspondence_distance=reach,
        num_threads=1, max_iterations=20, rotation_epsilon=0.002, translation_epsilon=0.0002,
    )  # fmt: skip
    pose = np.asarray(found.T_target_source, np.float64)
    return pose if np.isfinite(pose).all() else start
