"""Appearance of an asset: coloured points on its surface, a tone histogram of each view; cached on disk."""

import hashlib
import io
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.geometry.transforms import rotation_about_axis
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import build_posed_triangles
from grs_agents.library.shapes import IDENTITY_PLACEMENT
from grs_agents.perception.asset_surfaces import (
    Symmetry,
    Tree,
    cube_rotation_matrices,
    find_asset_symmetry,
    sample_triangle_points,
)
from grs_agents.perception.matching.color_histogram import histograms_from_rgb, to_log_opponent_colors
from grs_agents.perception.types import Array

Floats = npt.NDArray[np.floating[Any]]
"""Single precision: as fine as a camera measures, and twice as fast."""
Indices = npt.NDArray[np.int64]
Arrays = dict[str, npt.NDArray[Any]]
SAMPLES = 1800  # number of points on a surface
VIEWS = 26  # number of views: of a cube's sides, edges and corners
_KEPT = 256  # number of appearances in memory
_AROUND = 9  # colours are averaged over a radius with about this number of points
_CELLS = 48_000  # number of cells of the grid of nearest points
_MARGIN = 0.02  # the grid of nearest points extends beyond the asset by this, m
_ANGLES = 24  # number of turns about an axis of rotational symmetry
_CACHE_VERSION = "3"  # of the cached arrays; another version computes them anew


@dataclass(frozen=True)
class Appearance:
    """The coloured surface of an asset."""

    points: Floats  # (N, 3) m, about the centre of the bounding box
    normals: Floats  # (N, 3) unit, outwards where the mesh is wound so
    log_colors: Floats  # (N, 3) log opponent colours, smoothed
    half: Floats  # (3,) half the extents, m
    views: Floats  # (V, B) tone histograms (`color_histogram`), for each of `unit_viewing_directions`
    symmetries: Floats  # (S, 3, 3) rotations that leave its shape as it is, the identity first
    rotations: Floats  # (T, 3, 3) quarter turns, without those that differ only by one of ``symmetries``
    nearest: npt.NDArray[np.int16]  # (X, Y, Z) index of the point nearest to the centre of each cell of a grid
    low: Floats  # (3,) m, lowest corner of the grid
    cell: float  # m, edge of a cell

    def nearest_point_indices(self, places: Floats) -> Indices:
        """Indices (...) of the surface points near places (..., 3), m, in the frame of `points`."""
        cells = ((places - self.low) * np.float32(1 / self.cell)).astype(np.int32)
        shape = self.nearest.shape
        np.maximum(cells, 0, out=cells)
        np.minimum(cells, np.array(shape, np.int32) - 1, out=cells)
        flat = (cells[..., 0] * shape[1] + cells[..., 1]) * shape[2] + cells[..., 2]
        return self.nearest.ravel()[flat].astype(np.int64)


def unit_viewing_directions() -> Array:
    """Unit vectors (V, 3) from the asset towards the viewer."""
    steps = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    steps = steps[np.abs(steps).sum(axis=1) > 0]
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


_appearances: dict[tuple[tuple[Path, int], ...], Appearance] = {}
"""The latest, by the files and times of change (ns) of their assets: a library lives as long as a run's proxies."""


def load_appearance(name: str, library: Library) -> Appearance:
    """The appearance of an asset, deterministic, from the user's cache if its files have not changed.

    Raises:
        UnknownNameError: the library has no such asset.
        InputError: its files are faulty.
    """
    files = [file for file in _list_asset_files(name, library) if file is not None]
    stamp = tuple((file, file.stat().st_mtime_ns) for file in files)
    appearance = _appearances.get(stamp)
    if appearance is None:
        key = hash_asset_files(name, library)
        arrays = load_cached_arrays(key)
        if arrays is None:
            arrays = _compute_appearance_arrays(name, library)
            save_cached_arrays(key, arrays)
        fields: dict[str, Any] = {**arrays, "cell": float(arrays["cell"])}
        if len(_appearances) >= _KEPT:
            _appearances.pop(next(iter(_appearances)), None)
        appearance = _appearances[stamp] = Appearance(**fields)
    return appearance


def _compute_appearance_arrays(name: str, library: Library) -> Arrays:
    """The arrays of `Appearance`."""
    triangles = build_posed_triangles([(name, IDENTITY_PLACEMENT)], library)
    corners = triangles.corners
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    half = (high - low) / 2
    drawn = sample_triangle_points(corners, SAMPLES, np.random.default_rng(0))
    points, normals, chosen = drawn.points - (low + high) / 2, drawn.normals, drawn.triangles

    colors = triangles.colors[chosen].copy()
    uvs = np.einsum("ni,nij->nj", drawn.weights, triangles.uvs[chosen])
    for number, image in enumerate(triangles.textures):
        textured = triangles.texture[chosen] == number
        height, width = image.shape[:2]
        across, down = uvs[textured, 0] % 1.0, 1 - uvs[textured, 1] % 1.0
        columns = np.minimum((across * width).astype(np.int64), width - 1)
        rows = np.minimum((down * height).astype(np.int64), height - 1)
        colors[textured] = image[rows, columns] / 255

    extent = 2 * (half + _MARGIN)
    cell = float(np.cbrt(extent.prod() / _CELLS))
    axes = [-half[axis] - _MARGIN + (np.arange(int(np.ceil(extent[axis] / cell))) + 0.5) * cell for axis in range(3)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    nearest, _ = Tree(points).find_nearest_points(middles.reshape(-1, 3))

    symmetries = _symmetry_rotations(find_asset_symmetry(name, library))
    rotations: list[Array] = []
    for turn in cube_rotation_matrices():
        if not any(np.abs(earlier @ symmetries - turn).max(axis=(1, 2)).min() < 0.1 for earlier in rotations):
            rotations.append(turn)

    facing = np.clip(unit_viewing_directions() @ normals.T, 0, None)
    return {
        "points": points.astype(np.float32),
        "normals": normals.astype(np.float32),
        "log_colors": to_log_opponent_colors(_smooth_colors(points, colors)).astype(np.float32),
        "half": half.astype(np.float32),
        "views": histograms_from_rgb(colors, facing),
        "symmetries": symmetries.astype(np.float32),
        "rotations": np.array(rotations).astype(np.float32),
        "nearest": nearest.reshape(middles.shape[:3]).astype(np.int16),
        "low": (-half - _MARGIN).astype(np.float32),
        "cell": np.array(cell),
    }


def _symmetry_rotations(symmetry: Symmetry) -> Array:
    """Rotations (S, 3, 3) that leave a shape as it is, the identity first: quarter turns, or turns about its axis."""
    if not len(symmetry.axes):
        return np.array(sorted(symmetry.turns, key=lambda turn: -float(np.trace(turn))))
    axis = symmetry.axes[-1]
    spun = np.array([rotation_about_axis(axis, angle) for angle in np.arange(_ANGLES) * 2 * np.pi / _ANGLES])
    flips = [turn for turn in symmetry.turns if axis @ turn @ axis < -0.5]
    return np.concatenate([spun, spun @ flips[0]]) if flips else spun


def _smooth_colors(points: Array, colors: Array) -> Array:
    """Colours (N, 3), each averaged with its neighbours as in a photo from some distance."""
    places = points.astype(np.float32)
    squares = (places**2).sum(axis=1)
    apart = squares[:, None] + squares - 2 * places @ places.T
    near = np.partition(apart[:: len(points) // 50], _AROUND, axis=1)[:, _AROUND]
    weights = np.exp(apart * np.float32(-1 / max(float(np.median(near)), 1e-9)))
    return np.asarray(weights @ colors.astype(np.float32) / weights.sum(axis=1, keepdims=True), np.float64)


@dataclass(frozen=True)
class ComparedAssets:
    """Assets with their appearances."""

    assets: tuple[Asset, ...]
    appearances: tuple[Appearance, ...]  # of each
    views: npt.NDArray[np.float32]  # (A, V, B) tone histograms of each view
    sizes: Array  # (A, 3) extents in m, the smallest first


def load_asset_appearances(assets: Sequence[Asset], library: Library) -> ComparedAssets:
    """Load the appearances of assets; raises InputError if the files of an asset are faulty."""
    appearances = tuple(load_appearance(asset.name, library) for asset in assets)
    return ComparedAssets(
        assets=tuple(assets),
        appearances=appearances,
        views=np.stack([look.views for look in appearances]),
        sizes=np.array([np.sort(2 * look.half) for look in appearances], np.float64),
    )


def hash_asset_files(name: str, library: Library) -> str:
    """Hash of the files that an asset is drawn from."""
    whole = hashlib.sha256(_CACHE_VERSION.encode())
    for file in _list_asset_files(name, library):
        whole.update(b"\0" if file is None else file.read_bytes())
    return whole.hexdigest()


def _list_asset_files(name: str, library: Library) -> list[Path | None]:
    """The description of an asset, then mesh and texture of each visual; None for one that it lacks."""
    names = [file for shape in library.load_object_model(name).visuals for file in (shape.mesh, shape.texture)]
    return [library.asset_path(name), *(None if file is None else library.mesh_or_texture_path(file) for file in names)]


def load_cached_arrays(key: str) -> Arrays | None:
    """The arrays under a key of the cache; ``None`` if they are missing or broken."""
    try:
        with np.load(cache_folder_path() / f"{key}.npz", allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, RuntimeError):  # RuntimeError: a user without a home
        return None


def save_cached_arrays(key: str, arrays: Arrays) -> None:
    """Save arrays under a key; without a writable cache they are computed again next time."""
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **arrays)
    with suppress(InputError, RuntimeError):
        write_bytes(cache_folder_path() / f"{key}.npz", data.getvalue())


def cache_folder_path() -> Path:
    """The user's cache, as in the XDG base directory specification."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "grs-agents" / "looks"
