"""Pictures and colours of strangers' models: read within limits; a fault of a look is noted and costs the look."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from grs_agents.library.importing.types import Floats, Image, Ints, MeshPart, RefusedError

GREY: Final = (180, 180, 180)
"""Colour of surfaces without a colour of their own."""


def read_texture_image(source: Any, pixels: int) -> Image:
    """A picture as (H, W, 3) uint8 RGB, transparency over white.

    Args:
        source: a path, an opened file or an opened Pillow image.
        pixels: the most it may have.
    """
    from PIL import Image as Pictures

    name = source.name if isinstance(source, Path) else "the texture"
    try:
        opened: Any = source if isinstance(source, Pictures.Image) else Pictures.open(source)
        width, height = opened.size
        if width * height > pixels or min(width, height) < 1:
            raise RefusedError(f"{name} has {width} x {height} px, {pixels} are the most", "make it smaller")
        if opened.mode in ("RGBA", "LA", "PA") or "transparency" in opened.info:
            white: Any = Pictures.new("RGBA", opened.size, (255, 255, 255, 255))
            white.alpha_composite(opened.convert("RGBA"))
            opened = white
        elif opened.mode in ("I", "I;16", "I;16B"):  # Pillow would clamp values above 255
            return np.repeat((np.asarray(opened, np.int64) >> 8).clip(0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
        return np.asarray(opened.convert("RGB"), np.uint8)
    except (OSError, ValueError, SyntaxError, Pictures.DecompressionBombError) as error:
        raise RefusedError(f"{name} is no picture: {str(error)[:120].rstrip('.')}", "convert it to PNG") from error


def read_picture_or_note(source: Any, pixels: int, notes: list[str]) -> Image | None:
    """`read_texture_image`; None and a note if it cannot be read."""
    try:
        return read_texture_image(source, pixels)
    except RefusedError as error:
        notes.append(f"{error.message}: the picture is not shown")
        return None


def color_to_uint8(rgb: Any) -> Image:
    """A colour as (3,) uint8: numbers up to 1 are shares, larger numbers are of 255."""
    values = np.nan_to_num(np.asarray(rgb, np.float64))
    scale = 255.0 if np.issubdtype(np.asarray(rgb).dtype, np.floating) and values.max(initial=0) <= 1 else 1.0
    return np.clip(np.rint(values * scale), 0, 255).astype(np.uint8)


def build_mesh_part(
    vertices: Floats,
    faces: Ints,
    uvs: Floats | None,
    image: Image | None,
    colors: Image | None,
    name: str,
    notes: list[str],
) -> MeshPart:
    """A part of the mesh ``name``, grey without picture and colours; without texture coordinates a picture is replaced
    by its mean colour, with a note."""
    if image is not None and uvs is None:
        mean = image.reshape(-1, 3).mean(axis=0).round().astype(np.uint8)
        colors, image = np.tile(mean, (len(faces), 1)), None
        notes.append(f"{name} has no texture coordinates: it is shown in the mean colour of its picture")
    if colors is None:
        colors = np.tile(np.array(GREY, np.uint8), (len(faces), 1))
    return MeshPart(vertices, faces, uvs, image, colors)
