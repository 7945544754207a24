"""Level of detail: fewer triangles, with the texture where it was."""

import importlib
from typing import Any

import numpy as np

from grs_agents.library.importing.types import Floats, Ints, Solid

_REACH = 3
"""How far beyond an old face its texture is continued, in sizes of the face."""
_WORTH = 1.25


def simplified(vertices: Floats, faces: Ints, most: int) -> tuple[Floats, Ints]:
    """The mesh with about ``most`` faces; as it is where it has no more or ``fast-simplification`` is not installed."""
    if len(faces) <= most:
        return vertices, faces
    try:
        tool: Any = importlib.import_module("fast_simplification")
    except ImportError:
        return vertices, faces
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    unit = ((vertices - low) / extent).astype(np.float32)
    points, triangles = tool.simplify(unit, faces.astype(np.int32), target_count=most)
    if len(triangles) < 4:
        return vertices, faces
    return np.asarray(points, np.float64) * extent + low, np.asarray(triangles, np.int64)


def with_fewer_faces(solid: Solid, most: int) -> tuple[Solid, list[str]]:
    """The solid with about ``most`` faces, each painted like the old face nearest to it, and notes."""
    count = len(solid.faces)
    if count <= _WORTH * most:
        return solid, []
    vertices, faces = simplified(solid.vertices, solid.faces, most)
    if len(faces) >= count:
        return solid, [f'{count} faces: fewer need pip install "grs-agents[assets]"']
    old = solid.vertices[solid.faces]
    new = vertices[faces]
    nearest = _nearest(old.mean(axis=1), new.mean(axis=1))
    uvs = _painted(old[nearest], solid.uvs[nearest], new)
    return Solid(vertices, faces, uvs, solid.image), [f"{count} faces became {len(faces)}"]


def _nearest(old: Floats, new: Floats) -> Ints:
    tool: Any = importlib.import_module("small_gicp")
    tree = tool.KdTree(old)
    return np.array([int(tree.nearest_neighbor_search(point)[1]) for point in new], dtype=np.int64)


def _painted(old: Floats, uvs: Floats, new: Floats) -> Floats:
    """(F, 3, 2) coordinates of new faces as the planes of old ones continue, kept near the old face's own."""
    first, second = old[:, 1] - old[:, 0], old[:, 2] - old[:, 0]
    a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((first, first), (first, second), (second, second)))
    scale = np.maximum(a * c - b * b, 1e-30)
    offset = new - old[:, None, 0]
    d, e = np.einsum("ikj,ij->ik", offset, first), np.einsum("ikj,ij->ik", offset, second)
    v = (c[:, None] * d - b[:, None] * e) / scale[:, None]
    w = (a[:, None] * e - b[:, None] * d) / scale[:, None]
    weights = np.stack([1 - v - w, v, w], axis=2)
    found = np.einsum("ikl,ilj->ikj", np.clip(weights, -_REACH, _REACH), uvs)
    return np.clip(found, 0, 1)
