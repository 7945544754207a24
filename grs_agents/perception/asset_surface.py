"""The surface of an asset as points with normals, in the frame at the centre of its bounding box."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from grs_agents.library import Library
from grs_agents.library.posed_meshes import visible_corners
from grs_agents.perception.frame import Array

SAMPLES = 2000


@dataclass(frozen=True)
class Surface:
    """Points spread evenly over a surface.

    Attributes:
        points: (N, 3) m, about the centre of the bounding box.
        normals: (N, 3) unit, outwards where the mesh is wound so.
        half: (3,) half the extents, m.
        spacing: about how far neighbours are apart, m.
    """

    points: Array
    normals: Array
    half: Array
    spacing: float


def surface_of(name: str, library: Library) -> Surface:
    """The visible surface of an asset; the same points each time.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    corners = corners_of(name, library)
    return _surface(corners.tobytes(), len(corners))


@lru_cache(maxsize=128)
def corners_of(name: str, library: Library) -> Array:
    """(T, 3, 3) corners of the triangles that are seen of an asset, m, its own frame; to be read only.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    corners = visible_corners(name, library).round(5)
    corners.setflags(write=False)
    return corners


@lru_cache(maxsize=128)
def _surface(data: bytes, count: int) -> Surface:
    corners = np.frombuffer(data).reshape(count, 3, 3)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    rng = np.random.default_rng(0)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(crosses, axis=1)
    chosen = rng.choice(len(corners), size=SAMPLES, p=doubled / doubled.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), size=SAMPLES)
    points = np.einsum("ni,nij->nj", weights, corners[chosen]) - (low + high) / 2
    normals = crosses[chosen] / doubled[chosen, None]
    return Surface(points, normals, (high - low) / 2, float(np.sqrt(doubled.sum() / 2 / SAMPLES)))
