"""Appearance of a mesh: colours, hollowness, category by name. Published object sets have known masses, sizes and
licences."""

import re
import unicodedata
from typing import Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.library.asset import Asset
from grs_agents.library.colors import main_color_names
from grs_agents.library.importing.types import AtlasMesh, Floats, Image, sample_texture_colors

HOPE_LICENSE: Final = "CC-BY-NC-SA-4.0"
OPEN_LICENSE: Final = "CC-BY-4.0"
"""Licence of the YCB set and of Google Scanned Objects."""
_YCB_MASSES: Final = """
    002:414 003:411 004:514 005:349 006:603 007:171 008:187 009:97 010:370 011:66 012:18 013:68 014:29 015:33 016:49
    017:47 018:25 019:178 021:1131 022:1022 024:147 025:118 026:6.2 029:279 035:895 036:729 037:82 040:15.8 048:665
    051:125 052:202 055:148 056:56 061:28 077:252
"""
_YCB_GRAMS: Final = {number: float(grams) for number, _, grams in (row.partition(":") for row in _YCB_MASSES.split())}
"""Mass by number, as the set's authors weighed it (Calli et al., 2015)."""
_NOUNS: Final = """
    bottle can box bowl mug cup plate jar carton tub canister cube pitcher spoon fork knife spatula hammer screwdriver
    wrench drill scissors marker clamp ball banana apple lemon peach pear orange plum strawberry sponge block pan basket
    tray shoe toy bag glass vase lid basin pot book
"""
_CATEGORIES: Final = frozenset(_NOUNS.split())
_SYNONYMS = {"mushroom": "can", "tin": "can", "skillet": "pan", "frypan": "pan", "ramekin": "bowl", "baseball": "ball"}


def split_name_into_words(name: str) -> list[str]:
    """The words of a file name or CamelCase name in any script, lower-case, without numbers that only count."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", unicodedata.normalize("NFC", name))
    letters = (letter if unicodedata.category(letter)[0] in "LMN" else " " for letter in spaced)
    return [word.lower() for word in "".join(letters).split() if not word.isdigit()]


def category_from_name(name: str) -> str:
    """The last plain noun in a name; ``object`` without such a noun."""
    words = [_SYNONYMS.get(word, word) for word in split_name_into_words(name)]
    return next((word for word in reversed(words) if word in _CATEGORIES), "object")


def look_up_ycb_mass_kg(name: str) -> float | None:
    """kg of a YCB object by its name (``006_mustard_bottle``), None if it is not known."""
    grams = _YCB_GRAMS.get(name[:3])
    return None if grams is None else grams / 1000


def find_shipped_hope_asset(slug: str, assets: tuple[Asset, ...]) -> Asset | None:
    """The shipped asset of the HOPE kind ``slug`` (``alphabet_soup``); its size is that of the real object."""
    kind = "".join(word.capitalize() for word in split_name_into_words(slug)).replace("BbqSauce", "BBQSauce")
    return next((asset for asset in assets if asset.name == f"HOPE/{kind}.urdf"), None)


_LIT = 1.35
"""Scans are dark: most that their brightest colours may be brightened, as a factor."""
_GRID = 64
_DEEP = 0.4
"""Share of the height that an opening must be deep."""


def surface_color_names(solid: AtlasMesh) -> list[str]:
    """Names of the colours of the surface, the largest share first, at most three."""
    texels, amounts = _sample_surface_colors(solid)
    lit = min(_LIT, 0.95 * 255 / max(1.0, float(np.percentile(texels.max(axis=1), 95))))
    return main_color_names(np.minimum(texels * max(1.0, lit), 255).astype(np.uint8), 12, amounts)


def surface_color_histogram(solid: AtlasMesh) -> tuple[float, ...]:
    """(27,) shares of the surface by colour: three levels each of red, green and blue."""
    texels, amounts = _sample_surface_colors(solid)
    red, green, blue = (np.minimum(texels[:, channel].astype(np.int64) * 3 // 256, 2) for channel in range(3))
    shares = np.bincount(9 * red + 3 * green + blue, amounts, 27)
    return tuple(round(float(share), 4) for share in shares / max(float(shares.sum()), 1e-12))


def _sample_surface_colors(solid: AtlasMesh) -> tuple[Image, Floats]:
    """Colours (S, 3) of points on the surface and the areas (S,) that they represent."""
    corners = solid.vertices[solid.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    spots = [(a, b, 1 - a - b) for a in (0.1, 0.3, 0.5, 0.7) for b in (0.1, 0.2, 0.4, 0.6, 0.8) if a + b < 1]
    texels = [sample_texture_colors(solid.image, np.einsum("j,ijk->ik", np.array(spot), solid.uvs)) for spot in spots]
    return np.concatenate(texels), np.tile(areas, len(spots))


def is_hollow(solid: AtlasMesh) -> bool:
    """True if a large part, seen from above, lies deep below a rim all around: a bowl, mug or basket."""
    vertices = solid.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    unit = (vertices - low) / np.maximum(high - low, 1e-9)
    corners = unit[solid.faces]
    buffer = rasterise_triangles(corners[:, :, :2] * (_GRID - 1), corners[:, :, 2], _GRID, _GRID)
    heights = np.where(buffer.triangle >= 0, buffer.nearness, 0.0)
    middle = slice(_GRID * 3 // 8, _GRID * 5 // 8)
    floor = float(np.median(heights[middle, middle]))
    if floor > 1 - _DEEP:
        return False
    center, angles = (_GRID - 1) / 2, np.linspace(-np.pi, np.pi, 24, endpoint=False)
    reach = np.linspace(0.1, 0.5, 30)[:, None] * (_GRID - 1)
    rows = np.clip(np.rint(center + reach * np.sin(angles)), 0, _GRID - 1).astype(np.int64)
    columns = np.clip(np.rint(center + reach * np.cos(angles)), 0, _GRID - 1).astype(np.int64)
    return bool((heights[rows, columns].max(axis=0) > floor + _DEEP * 0.75).mean() > 0.8)


def describe_color_and_size(name: str, names: list[str], size: Vec3) -> str:
    """A description without a model: colours, the name in words and the size."""
    x, y, z = (f"{100 * extent:.1f}" for extent in size)
    called = " ".join(word for word in split_name_into_words(name) if word not in names[:2]) or name
    paint = " and ".join(names[:2])
    article = "an" if paint[:1] in "aeiou" else "a"
    return f"{article} {paint} {called}, {x} x {y} x {z} cm"
