"""A small z-buffer: which triangle each pixel sees. No GL, no randomness."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Buffer:
    """What a picture of triangles shows.

    Attributes:
        triangle: (H, W) index of the nearest triangle, -1 where there is none.
        nearness: (H, W) its nearness there, -inf where there is none.
    """

    triangle: Ints
    nearness: Floats


def rasterise(corners: Floats, nearness: Floats, width: int, height: int) -> Buffer:
    """Draw triangles into a z-buffer.

    Args:
        corners: (T, 3, 2) pixel coordinates of the corners; pixel (0, 0) is sampled at (0, 0).
        nearness: (T, 3) a quantity that is linear over the picture of a plane and grows towards the viewer: one
            over depth for a perspective camera, minus depth for a parallel one.
        width, height: of the picture, px.
    """
    triangle = np.full((height, width), -1, dtype=np.int64)
    best = np.full((height, width), -np.inf)
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(axis=1)), (width - 1, height - 1)).astype(int)
    for index in np.flatnonzero((low <= high).all(axis=1)):
        (left, top), (right, bottom) = low[index], high[index]
        window = (slice(top, bottom + 1), slice(left, right + 1))
        x = np.arange(left, right + 1, dtype=np.float64)
        y = np.arange(top, bottom + 1, dtype=np.float64)[:, None]
        (ax, ay), (bx, by), (cx, cy) = corners[index]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
        v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
        w = 1.0 - u - v
        depth = u * nearness[index, 0] + v * nearness[index, 1] + w * nearness[index, 2]
        seen = (u >= 0) & (v >= 0) & (w >= 0) & (depth > best[window])
        best[window][seen] = depth[seen]
        triangle[window][seen] = index
    return Buffer(triangle, best)


def barycentric(points: Floats, triangles: Floats) -> Floats:
    """(N, 3) weights of the corners of ``triangles`` (N, 3, 3) at ``points`` (N, 3) in their planes."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((first, first), (first, second), (second, second)))
    d, e = np.einsum("ij,ij->i", offset, first), np.einsum("ij,ij->i", offset, second)
    scale = a * c - b * b
    v, w = (c * d - b * e) / scale, (a * e - b * d) / scale
    return np.stack([1 - v - w, v, w], axis=1)
