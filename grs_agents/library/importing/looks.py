"""Colours and pictures of what trimesh has read."""

from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.library.importing.types import Floats, Image, Ints, RefusedError

_PLAIN = (180, 180, 180)


def picture(source: Any, pixels: int) -> Image:
    """A picture as (H, W, 3) uint8 RGB, what is transparent over white.

    Args:
        source: a path or an opened Pillow image.
        pixels: the most it may have.

    Raises:
        RefusedError: it is no picture or too large.
    """
    from PIL import Image as Pictures

    name = source.name if isinstance(source, Path) else "the texture"
    try:
        opened: Any = Pictures.open(source) if isinstance(source, Path) else source
        if opened.width * opened.height > pixels or min(opened.size) < 1:
            raise RefusedError(f"{name} has {opened.width} x {opened.height} px, {pixels} are the most", "shrink it")
        if opened.mode in ("RGBA", "LA", "PA") or "transparency" in opened.info:
            white: Any = Pictures.new("RGBA", opened.size, (255, 255, 255, 255))
            white.alpha_composite(opened.convert("RGBA"))
            opened = white
        return np.asarray(opened.convert("RGB"), np.uint8)
    except (OSError, ValueError, SyntaxError, Pictures.DecompressionBombError) as error:
        raise RefusedError(f"{name} is no picture: {str(error)[:120]}", "convert it to PNG") from error


def uvs_of(mesh: Any, faces: Ints) -> Floats | None:
    """(F, 3, 2) texture coordinates of the corners, or None."""
    found = getattr(mesh.visual, "uv", None)
    if found is None:
        return None
    uvs = np.asarray(found, np.float64)
    if uvs.ndim != 2 or len(uvs) != len(mesh.vertices) or not np.isfinite(uvs).all():
        return None
    return uvs[:, :2][faces]


def colors_of(mesh: Any, count: int) -> Image:
    """(F, 3) uint8 colour of each face, from its material, its own colour or its vertices' colours."""
    visual, plain = mesh.visual, np.tile(np.array(_PLAIN, np.uint8), (count, 1))
    material = getattr(visual, "material", None)
    if material is not None:
        main = getattr(material, "baseColorFactor", None)
        main = getattr(material, "main_color", None) if main is None else main
        rgb = np.asarray(_PLAIN if main is None else main).ravel()[:3]
        return np.tile(_bytes(rgb), (count, 1)) if len(rgb) == 3 else plain
    if getattr(visual, "kind", None) not in ("face", "vertex"):
        return plain
    colors = np.asarray(visual.face_colors)
    return colors[:, :3].astype(np.uint8) if len(colors) == count else plain


def _bytes(rgb: Any) -> Image:
    values = np.nan_to_num(np.asarray(rgb, np.float64))
    scale = 255.0 if np.issubdtype(np.asarray(rgb).dtype, np.floating) and values.max(initial=0) <= 1 else 1.0
    return np.clip(np.rint(values * scale), 0, 255).astype(np.uint8)
