"""Which points lie in what an asset's colliders fill."""

import numpy as np
import numpy.typing as npt

from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import ObjectModel, Shape, rotation_matrix
from grs_agents.perception.proxies.meshes import support

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


def holds(model: ObjectModel, library: Library, points: Floats, margin: float = 0.0) -> Bools:
    """Which of points (N, 3), m, in the asset's frame, lie in one of its colliders, or not ``margin`` m from it, (N,).

    A mesh is taken for about its hull.

    Raises:
        InputError: a mesh file is not readable.
    """
    found = np.zeros(len(points), np.bool_)
    for shape in model.colliders:
        found |= _off(shape, library, (points - shape.position) @ rotation_matrix(shape.quaternion)) < margin
    return found


def _off(shape: Shape, library: Library, local: Floats) -> Floats:
    """How far (N, 3) points in the shape's frame are beyond its sides, (N,) m; less than nothing in it."""
    if shape.kind == "box":
        return np.asarray((np.abs(local) - np.array(shape.size) / 2).max(axis=1), np.float64)
    if shape.kind == "sphere":
        return np.asarray(np.linalg.norm(local, axis=1) - shape.size[0], np.float64)
    if shape.kind == "cylinder":
        radius, length = shape.size
        return np.maximum(np.hypot(local[:, 0], local[:, 1]) - radius, np.abs(local[:, 2]) - length / 2)
    return support(read_vertices(library.mesh_path(shape.mesh or "")) * shape.size, local)
