"""What an asset looks like, as coloured points on its surface, and what each view of it shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import rotation_about_axis
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import Triangles, build_posed_triangles
from grs_agents.library.shapes import IDENTITY_PLACEMENT
from grs_agents.perception.asset_surfaces import (
    Symmetry,
    Tree,
    cube_rotation_matrices,
    find_asset_symmetry,
    sample_triangle_points,
)
from grs_agents.perception.matching.color_histogram import histograms_from_rgb, to_log_opponent_colors
from grs_agents.perception.matching.feature_cache import (
    Arrays,
    hash_asset_files,
    load_cached_arrays,
    save_cached_arrays,
)
from grs_agents.perception.types import Array

Floats = npt.NDArray[np.floating[Any]]
"""In single precision, which is as fine as what a camera measures and half as slow."""
Indices = npt.NDArray[np.int64]
SAMPLES = 1800  # so many points stand for a surface
VIEWS = 26  # an asset is looked at from so many sides: those of a cube, its edges and its corners
_KEPT = 256
_AROUND = 9
_CELLS = 48_000
_MARGIN = 0.02  # the grid of nearest points reaches so far beyond the asset, m
_ANGLES = 24  # what is round is turned so often


@dataclass(frozen=True)
class Appearance:
    """The coloured surface of an asset."""

    points: Floats  # (N, 3) m, about the centre of the bounding box
    normals: Floats  # (N, 3) unit, outwards where the mesh is wound so
    log_colors: Floats  # (N, 3) of its colours without light and without the finest detail
    half: Floats  # (3,) half the extents, m
    views: Floats  # (V, B) histograms of tone (`color_histogram`), one for each of `unit_viewing_directions`
    symmetries: Floats  # (S, 3, 3) turns that leave its shape as it is, the identity first
    rotations: Floats  # (T, 3, 3) the quarter turns, without those that only differ by one of ``symmetries``
    nearest: npt.NDArray[np.int16]  # (X, Y, Z) the point nearest to the middle of each cell of a grid
    low: Floats  # (3,) m, where the grid begins
    cell: float  # m, the edge of a cell

    def nearest_point_indices(self, places: Floats) -> Indices:
        """The number of the surface point near each place (..., 3), m, in the frame of `points`."""
        cells = ((places - self.low) * np.float32(1 / self.cell)).astype(np.int32)
        shape = self.nearest.shape
        np.maximum(cells, 0, out=cells)
        np.minimum(cells, np.array(shape, np.int32) - 1, out=cells)
        flat = (cells[..., 0] * shape[1] + cells[..., 1]) * shape[2] + cells[..., 2]
        return self.nearest.ravel()[flat].astype(np.int64)


def unit_viewing_directions() -> Array:
    """(V, 3) unit vectors from the asset towards who looks at it."""
    steps = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    steps = steps[np.abs(steps).sum(axis=1) > 0]
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


def load_appearance(name: str, library: Library) -> Appearance:
    """The surface of an asset; the same points each time. What was worked out once is kept for later processes.

    Raises:
        UnknownNameError: the library has no such asset.
        InputError: its files are faulty.
    """
    path = library.asset_path(name)
    return _load_or_compute_appearance(name, library, path.stat().st_mtime_ns)


@lru_cache(maxsize=_KEPT)
def _load_or_compute_appearance(name: str, library: Library, _modified: int) -> Appearance:
    key = hash_asset_files(name, library)
    arrays = load_cached_arrays(key)
    if arrays is None:
        arrays = _compute_appearance_arrays(name, library)
        save_cached_arrays(key, arrays)
    fields: dict[str, Any] = {**arrays, "cell": float(arrays["cell"])}
    return Appearance(**fields)


def _compute_appearance_arrays(name: str, library: Library) -> Arrays:
    """The arrays of `Appearance`."""
    triangles = build_posed_triangles([(name, IDENTITY_PLACEMENT)], library)
    corners = triangles.corners
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    drawn = sample_triangle_points(corners, SAMPLES, np.random.default_rng(0))
    points, normals = drawn.points - (low + high) / 2, drawn.normals
    colors = _sample_surface_colors(triangles, drawn.triangles, drawn.weights)
    half = (high - low) / 2
    facing = np.clip(unit_viewing_directions() @ normals.T, 0, None)
    nearest, cell = _build_nearest_point_grid(points, half)
    symmetries = _symmetry_rotations(find_asset_symmetry(name, library))
    return {
        "points": points.astype(np.float32),
        "normals": normals.astype(np.float32),
        "log_colors": to_log_opponent_colors(_smooth_colors(points, colors)).astype(np.float32),
        "half": half.astype(np.float32),
        "views": histograms_from_rgb(colors, facing),
        "symmetries": symmetries.astype(np.float32),
        "rotations": _distinct_quarter_turns(symmetries).astype(np.float32),
        "nearest": nearest,
        "low": (-half - _MARGIN).astype(np.float32),
        "cell": np.array(cell),
    }


def _build_nearest_point_grid(points: Array, half: Array) -> tuple[npt.NDArray[np.int16], float]:
    """The number of the nearest point in each cell, and the edge of a cell, m."""
    extent = 2 * (half + _MARGIN)
    cell = float(np.cbrt(extent.prod() / _CELLS))
    axes = [-half[axis] - _MARGIN + (np.arange(int(np.ceil(extent[axis] / cell))) + 0.5) * cell for axis in range(3)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    nearest, _ = Tree(points).find_nearest_points(middles.reshape(-1, 3))
    return nearest.reshape(middles.shape[:3]).astype(np.int16), cell


def _sample_surface_colors(triangles: Triangles, chosen: npt.NDArray[np.int64], weights: Array) -> Array:
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


def _symmetry_rotations(symmetry: Symmetry) -> Array:
    """(S, 3, 3) turns that leave a shape as it is, the identity first: quarter turns, and any about a round axis."""
    if not len(symmetry.axes):
        return np.array(sorted(symmetry.turns, key=lambda turn: -float(np.trace(turn))))
    axis = symmetry.axes[-1]
    spun = np.array([rotation_about_axis(axis, angle) for angle in np.arange(_ANGLES) * 2 * np.pi / _ANGLES])
    flips = [turn for turn in symmetry.turns if axis @ turn @ axis < -0.5]
    return np.concatenate([spun, spun @ flips[0]]) if flips else spun


def _distinct_quarter_turns(symmetries: Array) -> Array:
    """(T, 3, 3) the quarter turns, of those that only differ by one of ``symmetries`` the first."""
    found: list[Array] = []
    for turn in cube_rotation_matrices():
        if not any(np.abs(other @ symmetries - turn).max(axis=(1, 2)).min() < 0.1 for other in found):
            found.append(turn)
    return np.array(found)


def _smooth_colors(points: Array, colors: Array) -> Array:
    """(N, 3) each colour as the mean of those around it, as a camera some way off sees it."""
    places = points.astype(np.float32)
    squares = (places**2).sum(axis=1)
    apart = squares[:, None] + squares - 2 * places @ places.T
    near = np.partition(apart[:: len(points) // 50], _AROUND, axis=1)[:, _AROUND]
    weights = np.exp(apart * np.float32(-1 / max(float(np.median(near)), 1e-9)))
    return np.asarray(weights @ colors.astype(np.float32) / weights.sum(axis=1, keepdims=True), np.float64)


@dataclass(frozen=True)
class ComparedAssets:
    """Assets with their looks."""

    assets: tuple[Asset, ...]  # what may be matched
    appearances: tuple[Appearance, ...]  # one for each
    views: npt.NDArray[np.float32]  # (A, V, B) histograms of each view
    sizes: Array  # (A, 3) extents in m, the smallest first


def load_asset_appearances(assets: Sequence[Asset], library: Library) -> ComparedAssets:
    """The assets with their looks; raises InputError if the files of one are faulty."""
    appearances = tuple(load_appearance(asset.name, library) for asset in assets)
    return ComparedAssets(
        assets=tuple(assets),
        appearances=appearances,
        views=np.stack([look.views for look in appearances]),
        sizes=np.array([np.sort(2 * look.half) for look in appearances], np.float64),
    )
