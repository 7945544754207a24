"""What colour a textured object has where a ray meets it: the texture's, in small cubes of the object's own frame."""

from collections.abc import Mapping
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from grs_agents.library.asset_rendering import PaintedTriangles, build_textured_triangles, sample_triangle_colors
from grs_agents.library.library import Library
from grs_agents.library.shapes import Shape

Floats = npt.NDArray[np.float32]
_CELLS: Final = 48
"""Cubes along a shape's longest side."""
_SAMPLES: Final = 2.0
"""Of the surface, along the side of a cube."""
_MOST_SAMPLES: Final = 400_000
_remembered: WeakKeyDictionary[Library, dict[Shape, "ColorGrid"]] = WeakKeyDictionary()


class ColorGrid:
    """The mean colours of a surface in cubes.

    Attributes:
        low: (3,) the lowest corner of the first cube, m.
        cell: the side of a cube, m.
        colors: (X, Y, Z, 3) red, green, blue, 0..255.
    """

    def __init__(self, painted: PaintedTriangles) -> None:
        corners = painted.corners
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.cell = max(float((high - low).max()) / _CELLS, 1e-6)
        self.low = low - self.cell / 2  # or the lowest faces would lie between two layers of cubes
        count: npt.NDArray[np.int64] = np.floor((high - self.low) / self.cell).astype(np.int64) + 1
        triangle, weights = _sample_surface(corners, self.cell / _SAMPLES)
        found = sample_triangle_colors(painted, triangle, weights) * 255
        cells = ((np.einsum("ij,ijk->ik", weights, corners[triangle]) - self.low) / self.cell).astype(np.int64)
        flat = np.ravel_multi_index(tuple(np.clip(cells, 0, count - 1).T), tuple(count))
        hits = np.bincount(flat, minlength=int(count.prod()))
        sums = [np.bincount(flat, found[:, channel], int(count.prod())) for channel in range(3)]
        colors = np.stack(sums, axis=-1) / np.maximum(hits, 1)[:, None]
        colors[hits == 0] = found.mean(axis=0)
        self.colors: Floats = colors.astype(np.float32).reshape(*count, 3)


def _sample_surface(
    corners: npt.NDArray[np.float64], spacing: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Triangles (S,) and weights (S, 3) of their corners, about ``spacing`` m from one another, the corners too."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.ceil(sides / spacing).astype(np.int64) + 1
    if (total := float((steps.astype(np.float64) ** 2).sum())) > _MOST_SAMPLES:
        steps = np.maximum((steps * np.sqrt(_MOST_SAMPLES / total)).astype(np.int64), 1)
    triangles: list[npt.NDArray[np.int64]] = []
    weights: list[npt.NDArray[np.float64]] = []
    for count in np.unique(steps):
        first, second = np.indices((count + 1, count + 1)).reshape(2, -1)
        inside = first + second <= count
        grid = np.stack([first, second, count - first - second], axis=1)[inside] / count
        mine = np.flatnonzero(steps == count)
        triangles.append(np.repeat(mine, len(grid)))
        weights.append(np.tile(grid, (len(mine), 1)))
    return np.concatenate(triangles), np.concatenate(weights)


class SurfaceColors:
    """The colours of textured shapes, by the ids of their geoms."""

    def __init__(self, textured: Mapping[int, Shape], library: Library, geoms: int) -> None:
        known = _remembered.setdefault(library, {})
        self.shown = np.zeros(geoms, bool)
        self._start, self._count = np.zeros(geoms, np.int64), np.ones((geoms, 3), np.int64)
        self._low, self._scale = np.zeros((geoms, 3)), np.ones((geoms, 1))
        cells, total = [np.zeros((1, 3), np.float32)], 1
        for geom, shape in textured.items():
            if shape not in known:
                plain = shape.model_copy(update={"color": None})  # as OpenGL draws it
                known[shape] = ColorGrid(build_textured_triangles(library, [plain]))
            grid = known[shape]
            self.shown[geom], self._start[geom], self._count[geom] = True, total, grid.colors.shape[:3]
            self._low[geom], self._scale[geom] = grid.low, 1 / grid.cell
            cells.append(grid.colors.reshape(-1, 3))
            total += len(cells[-1])
        self._cells: Floats = np.concatenate(cells)

    def sample_colors_at_points(self, geoms: npt.NDArray[np.int32], points: npt.NDArray[np.float64]) -> Floats:
        """(N, 3) red, green, blue, 0..255, at points (N, 3) in the frames of the geoms' bodies, m."""
        count = self._count[geoms]
        x, y, z = np.clip(((points - self._low[geoms]) * self._scale[geoms]).astype(np.int64), 0, count - 1).T
        return self._cells[self._start[geoms] + (x * count[:, 1] + y) * count[:, 2] + z]
