"""Textures whose unused texels take the colour of the nearest used ones, so that edges stay clean when it shrinks."""

import numpy as np

from grs_agents.geometry.raster import rasterise
from grs_agents.library.importing.types import Floats, Image

_LARGEST = 2048
_SMALLEST = 4


def padded(image: Image, uvs: Floats, edge: int) -> Image:
    """The texture with its longer side at most ``edge`` px; what no triangle uses continues what is beside it.

    Args:
        image: (H, W, 3) uint8.
        uvs: (F, 3, 2) coordinates in 0..1 of all triangles that use it, origin at the lower left.
        edge: px.
    """
    image = shrunk(image, _LARGEST)
    height, width = image.shape[:2]
    if min(height, width) < 2 * _SMALLEST:
        return image
    corners = np.stack([uvs[:, :, 0] * width - 0.5, (1 - uvs[:, :, 1]) * height - 0.5], axis=2)
    used = rasterise(corners, np.zeros(corners.shape[:2]), width, height).triangle >= 0
    if used.all() or not used.any():
        return shrunk(image, edge)
    color, weight = image * used[:, :, None].astype(np.float64), used.astype(np.float64)
    while max(color.shape[:2]) > edge:
        color, weight = _halved(color), _halved(weight[:, :, None])[:, :, 0]
    return np.rint(_continued(color, weight)).clip(0, 255).astype(np.uint8)


def shrunk(image: Image, edge: int) -> Image:
    """The picture with its longer side at most ``edge`` px."""
    from PIL import Image as Pictures

    height, width = image.shape[:2]
    if max(height, width) <= edge:
        return image
    scale = edge / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(Pictures.fromarray(image).resize(size, Pictures.Resampling.LANCZOS), np.uint8)


def _halved(values: Floats) -> Floats:
    """Means over 2 x 2 texels; an odd last row or column counts twice."""
    high, wide = values.shape[:2]
    even = np.pad(values, ((0, high % 2), (0, wide % 2), (0, 0)), mode="edge")
    return even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2, -1).mean(axis=(1, 3))


def _continued(color: Floats, weight: Floats) -> Floats:
    """Colours over their weights; where there is no weight, those of the same picture at half its size."""
    own = color / np.maximum(weight, 1e-9)[:, :, None]
    if (weight > 0).all() or min(weight.shape) < _SMALLEST:
        return own
    coarse = _continued(_halved(color), _halved(weight[:, :, None])[:, :, 0])
    larger = coarse.repeat(2, axis=0).repeat(2, axis=1)[: weight.shape[0], : weight.shape[1]]
    return np.where((weight > 0)[:, :, None], own, larger)
