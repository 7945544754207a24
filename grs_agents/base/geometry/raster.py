"""A small z-buffer: which triangle each pixel sees. No GL, no randomness."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
_SAMPLES: Final = 30_000
"""Pixels of a batch: few enough for a processor's cache."""
_EDGE: Final = 1e-9
"""Pixels by which a row is widened at both ends: rounding leaves no gap between triangles that share an edge."""


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
    least, most = (end(end(corners[:, 0], corners[:, 1]), corners[:, 2]) for end in (np.minimum, np.maximum))
    low = np.maximum(np.ceil(least), 0).astype(int)
    high = np.minimum(np.floor(most), (width - 1, height - 1)).astype(int)
    edges = np.roll(corners, -1, axis=1) - corners
    area = edges[:, 0, 0] * -edges[:, 2, 1] - edges[:, 0, 1] * -edges[:, 2, 0]
    drawn = np.flatnonzero((low <= high).all(axis=1) & (np.abs(area) >= 1e-12))
    rows = _Rows.of_triangles(drawn, corners[drawn], nearness[drawn], low[drawn], high[drawn])
    samples = np.cumsum(rows.width)
    for part in np.split(np.arange(len(samples)), np.flatnonzero(np.diff(samples // _SAMPLES)) + 1):
        _draw_rows(buffer, rows, part)
    return buffer


@dataclass(frozen=True)
class _Rows:
    """The rows (R,) of pixels that triangles cover."""

    triangle: Ints  # (R,) index of the triangle
    y: Ints  # (R,) row of the picture
    left: Ints  # (R,) first column in the triangle
    width: Ints  # (R,) number of columns
    nearness: Floats  # (R,) at column 0 of the triangle's plane
    slope: Floats  # (R,) of the nearness, per column

    @classmethod
    def of_triangles(cls, index: Ints, corners: Floats, nearness: Floats, low: Ints, high: Ints) -> "_Rows":
        count: Ints = (high - low)[:, 1] + 1
        owner = np.repeat(np.arange(len(index)), count)
        y = _count_up_from(low[:, 1], count)
        places: Floats = np.ascontiguousarray(np.dstack([corners, nearness])[owner].transpose(2, 1, 0))
        across, down, near = places[0], places[1] - y, places[2]
        left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
        near_left, near_right = np.zeros(len(y)), np.zeros(len(y))
        for start, end in ((0, 1), (1, 2), (2, 0)):  # the row ends where it crosses two of the edges
            rise = down[end] - down[start]
            crosses = (down[start] * down[end] <= 0) & (rise != 0)
            share = -down[start] / np.where(crosses, rise, 1.0)
            column = across[start] + share * (across[end] - across[start])
            value = near[start] + share * (near[end] - near[start])
            first, last = crosses & (column < left), crosses & (column > right)
            left, near_left = np.where(first, column, left), np.where(first, value, near_left)
            right, near_right = np.where(last, column, right), np.where(last, value, near_right)
        begin = np.maximum(np.ceil(left - _EDGE), low[owner, 0])
        width = np.minimum(np.floor(right + _EDGE), high[owner, 0]) - begin + 1
        kept = np.flatnonzero(width > 0)
        slope = (near_right - near_left)[kept] / np.maximum(right - left, _EDGE)[kept]
        return cls(
            index[owner[kept]],
            y[kept],
            begin[kept].astype(np.int64),
            width[kept].astype(np.int64),
            near_left[kept] - slope * left[kept],
            slope,
        )


def _count_up_from(first: Ints, count: Ints) -> Ints:
    """Concatenated ranges: ``count[0]`` integers from ``first[0]``, then ``count[1]`` from ``first[1]``, and so on."""
    ends: Ints = np.cumsum(count)
    return np.arange(int(count.sum()), dtype=np.int64) + np.repeat(first - ends + count, count)


def _draw_rows(buffer: Buffer, rows: _Rows, part: Ints) -> None:
    row = np.repeat(part, rows.width[part])
    x = _count_up_from(rows.left[part], rows.width[part])
    value = rows.nearness[row] + rows.slope[row] * x
    triangle = rows.triangle[row]
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
