"""A small z-buffer: which triangle each pixel sees. No GL, no randomness."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
_WINDOWS: Final = (2, 4, 8, 16)
"""Triangles up to these extents (px) are drawn many at once."""
_SAMPLES: Final = 400_000


@dataclass(frozen=True)
class Buffer:
    """What a picture of triangles shows."""

    triangle: Ints  # (H, W) index of the nearest triangle, -1 where there is none
    nearness: Floats  # (H, W) its nearness there, -inf where there is none


def rasterise_triangles(corners: Floats, nearness: Floats, width: int, height: int) -> Buffer:
    """Draw triangles, ``corners`` (T, 3, 2) in pixels, into a z-buffer; pixel (0, 0) is sampled at (0, 0).
    ``nearness`` (T, 3) is linear over the picture of a plane and grows towards the viewer: one over depth for a
    perspective camera, minus depth for a parallel one."""
    buffer = Buffer(np.full((height, width), -1, dtype=np.int64), np.full((height, width), -np.inf))
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(axis=1)), (width - 1, height - 1)).astype(int)
    edges = np.roll(corners, -1, axis=1) - corners
    area = edges[:, 0, 0] * -edges[:, 2, 1] - edges[:, 0, 1] * -edges[:, 2, 0]
    drawn = np.flatnonzero((low <= high).all(axis=1) & (np.abs(area) >= 1e-12))
    extent = (high - low + 1)[drawn].max(axis=1) if len(drawn) else np.zeros(0)
    for smallest, largest in pairwise((0, *_WINDOWS)):
        for part in _split_into_batches(drawn[(extent > smallest) & (extent <= largest)], largest):
            _draw_small_triangles(buffer, part, corners, nearness, area, low, high, largest)
    for index in drawn[extent > _WINDOWS[-1]]:
        _draw_triangle(buffer, index, corners[index], nearness[index], float(area[index]), low[index], high[index])
    return buffer


def _split_into_batches(index: Ints, window: int) -> Iterator[Ints]:
    """Parts whose samples fit in little memory."""
    step = max(1, _SAMPLES // window**2)
    return (index[begin : begin + step] for begin in range(0, len(index), step))


def _draw_small_triangles(
    buffer: Buffer, index: Ints, corners: Floats, nearness: Floats, area: Floats, low: Ints, high: Ints, window: int
) -> None:
    """Draw many triangles at once, each into a window of ``window`` x ``window`` pixels."""
    span = np.arange(window)
    x: Ints = np.add.outer(low[index, 0], span)
    y: Ints = np.add.outer(low[index, 1], span)
    inside = (x <= high[index, 0, None])[:, None, :] & (y <= high[index, 1, None])[:, :, None]
    u, v, w = _barycentrics(corners[index][:, :, :, None, None], x[:, None, :], y[:, :, None], area[index, None, None])
    near = nearness[index][:, :, None, None]
    depth = u * near[:, 0] + v * near[:, 1] + w * near[:, 2]
    one, row, column = np.nonzero(inside & (u >= 0) & (v >= 0) & (w >= 0))
    pixel = (y[one, row] * buffer.triangle.shape[1] + x[one, column]).astype(np.int64)
    triangle = index[one]
    value = depth[one, row, column]
    order = np.lexsort((triangle, -value, pixel))
    first = order[np.r_[True, np.diff(pixel[order]) > 0]] if len(order) else order
    _update_z_buffer(buffer, pixel[first], triangle[first], value[first])


def _draw_triangle(
    buffer: Buffer, index: int, corners: Floats, nearness: Floats, area: float, low: Ints, high: Ints
) -> None:
    x = np.arange(int(low[0]), int(high[0]) + 1)
    y = np.arange(int(low[1]), int(high[1]) + 1)[:, None]
    u, v, w = _barycentrics(corners[None], x, y, area)
    depth = u * nearness[0] + v * nearness[1] + w * nearness[2]
    rows, columns = np.nonzero((u >= 0) & (v >= 0) & (w >= 0))
    pixel = (rows + low[1]) * buffer.triangle.shape[1] + columns + low[0]
    _update_z_buffer(buffer, pixel, np.full(len(pixel), index), depth[rows, columns])


def _barycentrics(
    corners: Floats, x: Floats | Ints, y: Floats | Ints, area: Floats | float
) -> tuple[Floats, Floats, Floats]:
    """Barycentric weights of pixels (x, y) in triangles (N, 3, 2, ...)."""
    (ax, ay), (bx, by), (cx, cy) = ((corners[:, corner, 0], corners[:, corner, 1]) for corner in range(3))
    u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
    v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
    return u, v, 1.0 - u - v


def _update_z_buffer(buffer: Buffer, pixel: Ints, triangle: Ints, nearness: Floats) -> None:
    """Take what is nearer than what was seen, and of equals the triangle that comes first; each pixel once."""
    best, owner = buffer.nearness.ravel(), buffer.triangle.ravel()
    nearer = (nearness > best[pixel]) | ((nearness == best[pixel]) & (triangle < owner[pixel]))
    best[pixel[nearer]], owner[pixel[nearer]] = nearness[nearer], triangle[nearer]


def barycentric_coordinates(points: Floats, triangles: Floats) -> Floats:
    """(N, 3) weights of the corners of ``triangles`` (N, 3, 3) at ``points`` (N, 3) in their planes."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((first, first), (first, second), (second, second)))
    d, e = np.einsum("ij,ij->i", offset, first), np.einsum("ij,ij->i", offset, second)
    scale = a * c - b * b
    v, w = (c * d - b * e) / scale, (a * e - b * d) / scale
    return np.stack([1 - v - w, v, w], axis=1)
