"""Surfaces of MuJoCo geoms as triangles with normals."""

from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco

_SLICES: Final = 24
_GEOM: Final = mujoco.mjtGeom


def geom_triangles_and_normals(model: Any, geom: int) -> tuple[FloatArray, FloatArray] | None:
    """Corners (3 M, 3) of a geom's triangles in its own frame, m, and their normals; None for infinite planes."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        vertices = np.asarray(model.mesh_vert[first : first + count], np.float64)
        return _flat_shaded_triangles(vertices[model.mesh_face[start : start + faces]])
    if kind == _GEOM.mjGEOM_BOX:
        faces = list[FloatArray]()
        for axis in range(3):
            for side in (-1.0, 1.0):
                square = np.zeros((4, 3))
                square[:, axis] = side
                square[:, [(axis + 1) % 3, (axis + 2) % 3]] = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
                faces += [square[[0, 1, 2]], square[[0, 2, 3]]] if side > 0 else [square[[0, 2, 1]], square[[0, 3, 2]]]
        return _flat_shaded_triangles(np.array(faces) * size)
    if kind == _GEOM.mjGEOM_CYLINDER:
        radius, half = float(size[0]), float(size[1])
        profiles = (
            [(0, -half, 0, -1), (radius, -half, 0, -1)],
            [(radius, -half, 1, 0), (radius, half, 1, 0)],
            [(radius, half, 0, 1), (0, half, 0, 1)],
        )
        sides = [_revolve_about_z(np.array(profile, np.float64)) for profile in profiles]
        return np.concatenate([side[0] for side in sides]), np.concatenate([side[1] for side in sides])
    if kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_SPHERE):
        half = float(size[1]) if kind == _GEOM.mjGEOM_CAPSULE else 0.0
        return _revolve_about_z(_capsule_profile(float(size[0]), half))
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        corners, normals = _revolve_about_z(_capsule_profile(1.0, 0.0))
        normals = normals / size
        return corners * size, normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return None


def _flat_shaded_triangles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners and normals of triangles (M, 3, 3), flat shaded."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return corners.reshape(-1, 3), np.repeat(across, 3, axis=0)


def _capsule_profile(radius: float, half: float) -> FloatArray:
    """Profile (K, 4) of a capsule from bottom to top: radius and height, m, and the normal in that plane."""

    angles = np.linspace(0.0, np.pi / 2, _SLICES // 4 + 1)
    sin, cos = np.sin(angles), np.cos(angles)
    top = np.column_stack([radius * cos, half + radius * sin, cos, sin])
    bottom = top[::-1] * (1, -1, 1, -1)
    return np.concatenate([bottom, top])


def _revolve_about_z(profile: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Triangles of the solid of revolution of a profile (K, 4) about z."""
    angles = np.linspace(0.0, 2 * np.pi, _SLICES + 1)
    cos, sin = np.cos(angles), np.sin(angles)
    points = np.stack(
        [np.outer(profile[:, 0], cos), np.outer(profile[:, 0], sin), np.repeat(profile[:, 1:2], len(angles), 1)], -1
    )
    normals = np.stack(
        [np.outer(profile[:, 2], cos), np.outer(profile[:, 2], sin), np.repeat(profile[:, 3:4], len(angles), 1)], -1
    )
    corners = [(0, 0), (0, 1), (1, 1), (0, 0), (1, 1), (1, 0)]
    last, around = len(profile) - 1, _SLICES

    def triangle_corners_from_grid(grid: FloatArray) -> FloatArray:
        return np.stack([grid[i : i + last, j : j + around] for i, j in corners], axis=2).reshape(-1, 3)

    return triangle_corners_from_grid(points), triangle_corners_from_grid(normals)
