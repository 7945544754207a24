"""Meshes of proxies: gridded boxes, surfaces of revolution, hulls of points; and points inside an asset's colliders."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.geometry.spheres import icosphere
from grs_agents.library import mesh_files
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import ObjectModel, matrix_from_quaternion

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Faceted = tuple[Floats, Ints]  # vertices (V, 3) in m and faces (F, 3), counterclockwise from outside
_GRID, _AROUND = 6, 32  # cells along an edge of a box; vertices around a surface of revolution


def box_mesh(size: Vec3, center: Vec3 = (0.0, 0.0, 0.0), grid: int = _GRID) -> Faceted:
    """A box with gridded sides, which bend a texture little."""
    vertices, faces = _unit_box(grid)
    return vertices * size + center, faces


@cache
def _unit_box(grid: int) -> Faceted:
    steps = np.linspace(-0.5, 0.5, grid + 1)
    across, down = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
    parts: list[Faceted] = []
    for axis in range(3):
        for side in (0.5, -0.5):
            vertices = np.empty((len(across), 3))
            vertices[:, axis], vertices[:, (axis + 1) % 3], vertices[:, (axis + 2) % 3] = side, across, down
            faces = _triangulate_grid(grid + 1, grid + 1)
            parts.append((vertices, faces if side > 0 else faces[:, ::-1]))
    return join_meshes(parts)


def revolved_mesh(profile: Sequence[tuple[float, float]]) -> Faceted:
    """Surface of revolution about z of a profile of (radius, z), m, from the centre of the bottom outwards."""
    angles = np.arange(_AROUND + 1) * 2 * np.pi / _AROUND
    radii, heights = np.array(profile).T
    x, y = np.outer(np.cos(angles), radii), np.outer(np.sin(angles), radii)
    vertices = np.stack([x, y, np.broadcast_to(heights, x.shape)], axis=2)
    return vertices.reshape(-1, 3), _triangulate_grid(len(angles), len(radii))


def hull_mesh(points: Floats) -> Faceted:
    """Approximate convex hull of points (N, 3): the farthest point in each of many directions."""
    directions, faces = icosphere(3)
    kept, number = np.unique(np.argmax(directions @ points.T, axis=1), return_inverse=True)
    return points[kept], number[faces]


def signed_distance_from_hull(points: Floats, queries: Floats) -> Floats:
    """Signed distances (M,), m, negative inside, of queries (M, 3) from the approximate hull of points (N, 3)."""
    directions, _ = icosphere(3)
    reach = (directions @ points.T).max(axis=1)
    return np.asarray((queries @ directions.T - reach).max(axis=1), np.float64)


def join_meshes(parts: Sequence[Faceted]) -> Faceted:
    """Concatenate meshes."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])[:-1]
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def mesh_to_obj_text(mesh: Faceted, uvs: Floats | None = None) -> str:
    """Wavefront OBJ; ``uvs`` (V, 2) are texture coordinates of the vertices. Faces without area are left out."""
    vertices, faces = mesh
    corners = vertices[faces].round(6)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    kept = faces[np.linalg.norm(crosses, axis=1) > 1e-9]
    return mesh_files.format_obj_text(vertices, kept, uvs, kept)


def _triangulate_grid(rows: int, columns: int) -> Ints:
    """Two triangles for each cell of a row-major grid of vertices."""
    start = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    a, b, c, d = start, start + columns, start + columns + 1, start + 1
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def inside_colliders_mask(model: ObjectModel, library: Library, points: Floats, margin: float = 0.0) -> Bools:
    """Mask (N,) of points (N, 3), m, asset's frame, inside or ``margin`` m from a collider; meshes count as hulls."""
    inside = np.zeros(len(points), np.bool_)
    for shape in model.colliders:
        local = (points - shape.position) @ matrix_from_quaternion(shape.quaternion)
        if shape.kind == "box":
            distances = np.asarray((np.abs(local) - np.array(shape.size) / 2).max(axis=1), np.float64)
        elif shape.kind == "sphere":
            distances = np.asarray(np.linalg.norm(local, axis=1) - shape.size[0], np.float64)
        elif shape.kind == "cylinder":
            radius, length = shape.size
            distances = np.maximum(np.hypot(local[:, 0], local[:, 1]) - radius, np.abs(local[:, 2]) - length / 2)
        else:
            vertices = read_vertices(library.mesh_or_texture_path(shape.mesh or "")) * shape.size
            distances = signed_distance_from_hull(vertices, local)
        inside |= distances < margin
    return inside
