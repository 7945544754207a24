"""A small z-buffer: which triangle each pixel sees. No GL, no randomness."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
_SAMPLES: Final = 30_000
"""Pixels of a batch: few enough for a processor's cache."""
_FLAT: Final = 1e-6
"""An edge that rises by less (px) bounds no row."""


@dataclass(frozen=True)
class Buffer:
    """Visible triangles of a picture."""

    triangle: Ints  # (H, W) index of the nearest triangle, -1 in the background
    nearness: Floats  # (H, W) its nearness there, -inf in the background


def rasterise_triangles(corners: Floats, nearness: Floats, width: int, height: int) -> Buffer:
    """Draw triangles, ``corners`` (T, 3, 2) in pixels, into a z-buffer; pixel (0, 0) is sampled at (0, 0). ``nearness``
    (T, 3) is linear over the picture of a plane and grows towards the viewer: 1 / depth for a perspective camera,
    -depth for an orthographic camera."""
    buffer = Buffer(np.full((height, width), -1, dtype=np.int64), np.full((height, width), -np.inf))
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(axis=1)), (width - 1, height - 1)).astype(int)
    edges = np.roll(corners, -1, axis=1) - corners
    area = edges[:, 0, 0] * -edges[:, 2, 1] - edges[:, 0, 1] * -edges[:, 2, 0]
    drawn = np.flatnonzero((low <= high).all(axis=1) & (np.abs(area) >= 1e-12))
    rows = _Rows.of_triangles(drawn, corners[drawn], area[drawn], low[drawn], high[drawn])
    samples = np.cumsum(rows.width)
    for part in np.split(np.arange(len(samples)), np.flatnonzero(np.diff(samples // _SAMPLES)) + 1):
        _draw_rows(buffer, rows, part, nearness)
    return buffer


@dataclass(frozen=True)
class _Rows:
    """The rows (R,) of pixels that triangles cover."""

    triangle: Ints  # (R,) index of the triangle
    y: Ints  # (R,) row of the picture
    left: Ints  # (R,) the first column that may lie in the triangle
    width: Ints  # (R,) number of columns
    across: Floats  # (3, R) columns of the triangle's corners
    down: Floats  # (3, R) their rows, relative to ``y``
    area: Floats  # (R,)

    @classmethod
    def of_triangles(cls, index: Ints, corners: Floats, area: Floats, low: Ints, high: Ints) -> "_Rows":
        count: Ints = (high - low)[:, 1] + 1
        owner = np.repeat(np.arange(len(index)), count)
        y = _count_up_from(low[:, 1], count)
        places: Floats = np.ascontiguousarray(corners[owner].transpose(2, 1, 0))
        across, down = places[0], places[1] - y
        left: Floats = low[owner, 0].astype(np.float64)
        right: Floats = high[owner, 0].astype(np.float64)
        for start, end in ((0, 1), (1, 2), (2, 0)):
            rise = down[end] - down[start]
            turned = rise * np.sign(area[owner])
            slanted = np.abs(rise) > _FLAT
            crossing = across[start] - down[start] * (across[end] - across[start]) / np.where(slanted, rise, 1.0)
            left = np.where(slanted & (turned < 0), np.maximum(left, np.floor(crossing)), left)
            right = np.where(slanted & (turned > 0), np.minimum(right, np.ceil(crossing)), right)
        width: Ints = np.maximum(right - left + 1, 0).astype(np.int64)
        return cls(index[owner], y, left.astype(np.int64), width, across, down, area[owner])


def _count_up_from(first: Ints, count: Ints) -> Ints:
    """Concatenated ranges: ``count[0]`` integers from ``first[0]``, then ``count[1]`` from ``first[1]``, and so on."""
    ends: Ints = np.cumsum(count)
    return np.arange(int(count.sum()), dtype=np.int64) + np.repeat(first - ends + count, count)


def _draw_rows(buffer: Buffer, rows: _Rows, part: Ints, nearness: Floats) -> None:
    row = np.repeat(part, rows.width[part])
    x = _count_up_from(rows.left[part], rows.width[part])
    (ax, bx, cx), (ay, by, cy) = rows.across[:, row] - x, rows.down[:, row]
    area = rows.area[row]
    # Barycentric weights of the three corners.
    u, v = (bx * cy - by * cx) / area, (cx * ay - cy * ax) / area
    w = 1.0 - u - v
    inside = (u >= 0) & (v >= 0) & (w >= 0)
    u, v, w, x, row = u[inside], v[inside], w[inside], x[inside], row[inside]
    triangle = rows.triangle[row]
    near = nearness[triangle]
    value = u * near[:, 0] + v * near[:, 1] + w * near[:, 2]
    pixel = rows.y[row] * buffer.triangle.shape[1] + x
    # Keep the nearest; of equals the triangle that comes first (``triangle`` ascends).
    best, owner = buffer.nearness.reshape(-1), buffer.triangle.reshape(-1)
    nearer = value > best[pixel]
    pixel, triangle, value = pixel[nearer], triangle[nearer], value[nearer]
    np.maximum.at(best, pixel, value)
    nearest = np.flatnonzero(value == best[pixel])[::-1]  # the last that is written stays
    owner[pixel[nearest]] = triangle[nearest]


def barycentric_coordinates(points: Floats, triangles: Floats) -> Floats:
    """(N, 3) weights of the corners of ``triangles`` (N, 3, 3) at ``points`` (N, 3) in their planes."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((first, first), (first, second), (second, second)))
    d, e = np.einsum("ij,ij->i", offset, first), np.einsum("ij,ij->i", offset, second)
    scale = a * c - b * b
    v, w = (c * d - b * e) / scale, (a * e - b * d) / scale
    return np.stack([1 - v - w, v, w], axis=1)
