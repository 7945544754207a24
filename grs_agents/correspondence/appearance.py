"""What an asset looks like, as coloured points on its surface, and what each view of it shows."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from grs_agents.correspondence.tone import histograms, tone
from grs_agents.library import Library
from grs_agents.library.generate.scene_mesh import Triangles, gather_posed
from grs_agents.library.shapes import HERE
from grs_agents.scene.frame import Array

SAMPLES = 1800
"""So many points stand for a surface."""
VIEWS = 26
"""An asset is looked at from so many sides: those of a cube, its edges and its corners."""
_KEPT = 256
_AROUND = 9


@dataclass(frozen=True)
class Appearance:
    """The coloured surface of an asset.

    Attributes:
        points: (N, 3) m, about the centre of the bounding box.
        normals: (N, 3) unit, outwards where the mesh is wound so.
        tones: (N, 3) of its colours without light and without the finest detail.
        half: (3,) half the extents, m.
        views: (V, B) histograms of tone (`grs_agents.correspondence.tone`), one for each of `directions`.
        round: the axis (0, 1, 2) about which its shape may be turned, or -1.
    """

    points: Array
    normals: Array
    tones: Array
    half: Array
    views: npt.NDArray[np.float32]
    round: int


def directions() -> Array:
    """(V, 3) unit vectors from the asset towards who looks at it."""
    steps = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    steps = steps[np.abs(steps).sum(axis=1) > 0]
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


def appearance_of(name: str, library: Library) -> Appearance:
    """The surface of an asset; the same points each time.

    Raises:
        UnknownNameError: the library has no such asset.
        InputError: its files are faulty.
    """
    path = library.path(name)
    return _appearance(name, library.roots, path, path.stat().st_mtime_ns)


@lru_cache(maxsize=_KEPT)
def _appearance(name: str, roots: tuple[object, ...], path: object, modified: int) -> Appearance:
    from pathlib import Path

    library = Library(*(Path(str(root)) for root in roots))
    triangles = gather_posed([(name, HERE)], library)
    corners = triangles.corners
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    rng = np.random.default_rng(0)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(crosses, axis=1)
    chosen = rng.choice(len(corners), size=SAMPLES, p=doubled / doubled.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), size=SAMPLES)
    points = np.einsum("ni,nij->nj", weights, corners[chosen]) - (low + high) / 2
    normals = crosses[chosen] / doubled[chosen, None]
    colors = _colors(triangles, chosen, weights)
    half = (high - low) / 2
    facing = np.clip(directions() @ normals.T, 0, None)
    return Appearance(
        points, normals, tone(_smoothed(points, colors)), half, histograms(colors, facing), _axis(points, half)
    )


def _colors(triangles: Triangles, chosen: npt.NDArray[np.int64], weights: Array) -> Array:
    """(N, 3) colours at points of triangles."""
    colors = triangles.colors[chosen].copy()
    uvs = np.einsum("ni,nij->nj", weights, triangles.uvs[chosen])
    for number, image in enumerate(triangles.textures):
        mine = triangles.texture[chosen] == number
        height, width = image.shape[:2]
        across, down = uvs[mine, 0] % 1.0, 1 - uvs[mine, 1] % 1.0
        columns = np.minimum((across * width).astype(np.int64), width - 1)
        rows = np.minimum((down * height).astype(np.int64), height - 1)
        colors[mine] = image[rows, columns] / 255
    return colors


def _axis(points: Array, half: Array) -> int:
    """The axis about which a shape is round: its points lie on circles, and reach no farther in the diagonal."""
    for axis in (2, 0, 1):
        one, two = (other for other in range(3) if other != axis)
        if abs(half[one] - half[two]) > 0.12 * max(half[one], half[two]):
            continue
        reach = np.hypot(points[:, one] / half[one], points[:, two] / half[two])
        if np.percentile(reach, 99.5) < 1.12:
            return axis
    return -1


def _smoothed(points: Array, colors: Array) -> Array:
    """(N, 3) each colour as the mean of those around it, as a camera some way off sees it."""
    places = points.astype(np.float32)
    squares = (places**2).sum(axis=1)
    apart = squares[:, None] + squares - 2 * places @ places.T
    near = np.partition(apart[:: len(points) // 50], _AROUND, axis=1)[:, _AROUND]
    weights = np.exp(apart * np.float32(-1 / max(float(np.median(near)), 1e-9)))
    return np.asarray(weights @ colors.astype(np.float32) / weights.sum(axis=1, keepdims=True), np.float64)
