"""The unit sphere as an even mesh, without a geometry library: trimesh takes a second to import."""

from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray

_GOLDEN: Final = (1 + 5**0.5) / 2


@cache
def icosphere(subdivisions: int) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Unit vertices (V, 3) and faces (F, 3), counter-clockwise from outside, of an icosahedron each of whose triangles
    is divided into four ``subdivisions`` times. The arrays are read-only."""
    vertices, faces = _icosahedron()
    for _ in range(subdivisions):
        sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, middle = np.unique(sides, axis=0, return_inverse=True)
        ab, bc, ca = (len(vertices) + middle.reshape(-1, 3)).T
        a, b, c = faces.T
        corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.column_stack(triple) for triple in corners])
        middles = vertices[edges].sum(axis=1)
        vertices = np.concatenate([vertices, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return vertices, faces


def _icosahedron() -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Twelve unit vertices on three golden rectangles, and the twenty triangles of nearest neighbours."""
    rectangle = np.array([[0.0, y, z * _GOLDEN] for y in (1, -1) for z in (1, -1)])
    vertices = np.concatenate([np.roll(rectangle, turn, axis=1) for turn in range(3)])
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 2.1  # edges are 2 long, the next distance is 3.2
    np.fill_diagonal(near, False)
    triples = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    outwards = [
        triple if np.linalg.det(vertices[list(triple)]) > 0 else (triple[0], triple[2], triple[1]) for triple in triples
    ]
    return vertices / np.linalg.norm(vertices[0]), np.array(outwards, dtype=np.int64)
