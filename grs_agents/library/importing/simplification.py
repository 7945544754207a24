"""Level of detail: fewer triangles, with the texture where it was."""

import importlib
from typing import Any

import numpy as np

from grs_agents.library.importing.bake import baked
from grs_agents.library.importing.types import Floats, Ints, Solid

_WORTH = 1.25
"""Times as many faces as there should be, from which on simplifying is worth a new texture."""


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


def with_fewer_faces(solid: Solid, most: int, edge: int) -> tuple[Solid, list[str]]:
    """The solid with about ``most`` faces and a texture of at most about ``edge`` px of its own, and notes."""
    count = len(solid.faces)
    if count <= _WORTH * most:
        return solid, []
    vertices, faces = simplified(solid.vertices, solid.faces, most)
    if len(faces) >= count:
        return solid, [f'{count} faces: fewer need pip install "grs-agents[assets]"']
    return baked(solid, vertices, faces, edge), [f"{count} faces became {len(faces)}"]
