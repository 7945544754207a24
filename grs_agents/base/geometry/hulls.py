"""The convex hull of points in space, as half-spaces: small, without a geometry library."""

from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray

_DIRECTIONS: Final = 200
"""Number of directions whose extreme vertices replace a mesh with more vertices."""


def extreme_points(vertices: FloatArray) -> FloatArray:
    """The distinct points (M, 3) of points (N, 3); of many, the extreme along even directions and the axes."""
    points = np.unique(np.round(vertices, 9), axis=0)
    if len(points) <= _DIRECTIONS:
        return points
    spread = np.arange(_DIRECTIONS) + 0.5
    polar, around = np.arccos(1 - 2 * spread / _DIRECTIONS), np.pi * (1 + 5**0.5) * spread
    sphere = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    directions = np.hstack([sphere, np.eye(3), -np.eye(3)])
    return np.asarray(points[np.unique((points @ directions).argmax(axis=0))])


def hull_half_spaces(vertices: FloatArray) -> FloatArray:
    """Planes (K, 4) of the hull of points (N, 3), inside: ``plane[:3] @ p <= plane[3]``; a box for coplanar points."""
    points = extreme_points(vertices)
    start = _find_tetrahedron(points)
    if start is None:
        low, high = points.min(axis=0), points.max(axis=0)
        return np.vstack([np.column_stack([np.eye(3), high]), np.column_stack([-np.eye(3), -low])])
    center = points[start].mean(axis=0)
    faces = np.array([tuple(np.delete(start, index).tolist()) for index in range(4)])
    planes = _triangle_planes(points, faces, center)
    scale = float(np.ptp(points, axis=0).max())
    for index in range(len(points)):
        seen = planes[:, :3] @ points[index] > planes[:, 3] + 1e-7 * scale
        if not seen.any():
            continue
        edges = np.sort(np.vstack([faces[seen][:, pair] for pair in ([0, 1], [1, 2], [0, 2])]), axis=1)
        unique, counts = np.unique(edges[:, 0] * len(points) + edges[:, 1], return_counts=True)
        horizon = np.column_stack(np.divmod(unique[counts == 1], len(points)))
        fresh = np.column_stack([horizon, np.full(len(horizon), index)])
        faces = np.vstack([faces[~seen], fresh])
        planes = np.vstack([planes[~seen], _triangle_planes(points, fresh, center)])
    return planes


def _find_tetrahedron(points: FloatArray) -> npt.NDArray[np.int64] | None:
    """Four of the points that span a volume, or None."""
    scale = float(np.ptp(points, axis=0).max())
    first = int(points[:, 0].argmin())
    second = int(np.linalg.norm(points - points[first], axis=1).argmax())
    axis = points[second] - points[first]
    third = int(np.linalg.norm(np.cross(points - points[first], axis), axis=1).argmax())
    normal = np.cross(axis, points[third] - points[first])
    fourth = int(np.abs((points - points[first]) @ normal).argmax())
    if abs(float((points[fourth] - points[first]) @ normal)) < 1e-9 * scale**3:
        return None
    return np.array([first, second, third, fourth])


def _triangle_planes(points: FloatArray, faces: npt.NDArray[np.int64], center: FloatArray) -> FloatArray:
    """The plane of each triangle, its normal away from ``center``."""
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    inward = ((center - a) * normals).sum(axis=1) > 0
    normals[inward] *= -1
    return np.column_stack([normals, (normals * a).sum(axis=1)])
