"""What can be said of a mesh by looking at it: its colours, whether things go into it, what it is called."""

import numpy as np

from grs_agents.base import Vec3
from grs_agents.geometry.raster import rasterise
from grs_agents.library.colors import color_name
from grs_agents.library.importing.published_sets import words_of
from grs_agents.library.importing.types import Floats, Solid

_SHARE = 0.08
"""Share of the surface from which a further colour is told."""
_LIT = 1.35
"""Scans are dark: so much brighter may the brightest of their colours be made."""
_GRID = 64
_DEEP = 0.4
"""Share of the height that an opening must be deep."""


def colors(solid: Solid) -> list[str]:
    """Names of the colours of the surface, the largest share first, at most three."""
    shares: dict[str, float] = {}
    texels, amounts = _samples(solid)
    lit = min(_LIT, 0.95 * 255 / max(1.0, float(np.percentile(texels.max(axis=1), 95))))
    bright = np.minimum(texels * max(1.0, lit), 255).astype(np.uint8)
    levels, number = np.unique(bright // 12, axis=0, return_inverse=True)
    for level, amount in zip(levels, np.bincount(number.ravel(), amounts, len(levels)), strict=True):
        red, green, blue = ((float(one) * 12 + 6) / 255 for one in level)
        name = color_name((min(red, 1.0), min(green, 1.0), min(blue, 1.0)))
        shares[name] = shares.get(name, 0.0) + float(amount)
    total = sum(shares.values()) or 1.0
    ranked = sorted(shares, key=lambda name: (-shares[name], name))
    return ranked[:1] + [name for name in ranked[1:3] if shares[name] >= _SHARE * total]


def look(solid: Solid) -> tuple[float, ...]:
    """(27,) shares of the surface by colour: three levels each of red, green and blue."""
    texels, amounts = _samples(solid)
    red, green, blue = (np.minimum(texels[:, channel].astype(np.int64) * 3 // 256, 2) for channel in range(3))
    shares = np.bincount(9 * red + 3 * green + blue, amounts, 27)
    return tuple(round(float(share), 4) for share in shares / max(float(shares.sum()), 1e-12))


def _samples(solid: Solid) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.uint8]], Floats]:
    """Colours (S, 3) of points on the surface and the area that each stands for."""
    corners = solid.vertices[solid.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    places = [(a, b, 1 - a - b) for a in (0.1, 0.3, 0.5, 0.7) for b in (0.1, 0.2, 0.4, 0.6, 0.8) if a + b < 1]
    found = [_texels(solid, np.einsum("j,ijk->ik", np.array(place), solid.uvs)) for place in places]
    return np.concatenate(found), np.tile(areas, len(places))


def _texels(solid: Solid, uvs: Floats) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    height, width = solid.image.shape[:2]
    columns = np.clip((uvs[:, 0] * width).astype(np.int64), 0, width - 1)
    rows = np.clip(((1 - uvs[:, 1]) * height).astype(np.int64), 0, height - 1)
    return solid.image[rows, columns]


def is_hollow(solid: Solid) -> bool:
    """Whether a rather large part of it, seen from above, lies deep below a rim all around: a bowl, mug or basket."""
    vertices = solid.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    unit = (vertices - low) / extent
    corners = unit[solid.faces]
    buffer = rasterise(corners[:, :, :2] * (_GRID - 1), corners[:, :, 2], _GRID, _GRID)
    heights = np.where(buffer.triangle >= 0, buffer.nearness, 0.0)
    middle = slice(_GRID * 3 // 8, _GRID * 5 // 8)
    floor = float(np.median(heights[middle, middle]))
    if floor > 1 - _DEEP:
        return False
    center, angles = (_GRID - 1) / 2, np.linspace(-np.pi, np.pi, 24, endpoint=False)
    reach = np.linspace(0.1, 0.5, 30)[:, None] * (_GRID - 1)
    rows = np.clip(np.rint(center + reach * np.sin(angles)), 0, _GRID - 1).astype(np.int64)
    columns = np.clip(np.rint(center + reach * np.cos(angles)), 0, _GRID - 1).astype(np.int64)
    rim = heights[rows, columns].max(axis=0)
    return bool((rim > floor + _DEEP * 0.75).mean() > 0.8)


def sentence(name: str, names: list[str], size: Vec3) -> str:
    """What can be told without a model: colours, the name in words and the size."""
    x, y, z = (f"{100 * extent:.1f}" for extent in size)
    called = " ".join(word for word in words_of(name) if word not in names[:2]) or name
    paint = " and ".join(names[:2])
    article = "an" if paint[:1] in "aeiou" else "a"
    return f"{article} {paint} {called}, {x} x {y} x {z} cm"
