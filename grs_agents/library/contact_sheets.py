"""A contact sheet: assets in rows of pictures with their names and numbers, for a person to look at."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.library.asset import Asset
from grs_agents.library.asset_rendering import AssetView, render_asset_views, ring_view_directions
from grs_agents.library.library import Library

Image = npt.NDArray[np.uint8]
_SIDE: Final = 176
_TEXT: Final = 52
_PAPER, _INK, _FAINT = (255, 255, 255), (20, 20, 20), (110, 110, 110)
_COLUMNS: Final = 3
MAX_ASSETS: Final = 240
_LONGEST: Final = 400
"""Characters of a caption that are measured; a cell has room for some 80."""


def draw_contact_sheet(library: Library, assets: Sequence[Asset], views: int = 3) -> tuple[Image, dict[str, str]]:
    """Draw a cell of ``views`` pictures for each asset. Returns: picture (H, W, 3), errors of failed assets by name.
    Raises InputError: there are no assets, or more than 240."""
    if not 0 < len(assets) <= MAX_ASSETS:
        raise InputError(f"a sheet of {len(assets)} assets", f"name 1 to {MAX_ASSETS} of them")
    from PIL import Image as Pictures
    from PIL import ImageDraw, ImageFont

    columns = min(_COLUMNS, len(assets))
    rows, width = -(-len(assets) // columns), _SIDE * views
    sheet: Any = Pictures.new("RGB", (columns * width, rows * (_SIDE + _TEXT)), _PAPER)
    pen: Any = ImageDraw.Draw(sheet)
    font, broken = ImageFont.load_default(13), dict[str, str]()
    for number, asset in enumerate(assets):
        left, top = number % columns * width, number // columns * (_SIDE + _TEXT)
        try:
            pictures = render_asset_views(library, asset.name, ring_view_directions(views), size=_SIDE)
        except InputError as error:
            broken[asset.name] = str(error)
            pen.text((left + 8, top + _SIDE // 2), "cannot be drawn", (200, 0, 0), font)
        else:
            for place, view in enumerate(pictures):
                sheet.paste(Pictures.fromarray(composite_over_white(view)), (left + place * _SIDE, top))
        captions = ((asset.name, _INK), (format_asset_facts(asset), _FAINT), (asset.description, _FAINT))
        for line, (caption, ink) in enumerate(captions):
            text = caption[:_LONGEST]
            while len(text) > 4 and font.getlength(text) > width - 16:
                text = f"{text[:-4]}..."
            pen.text((left + 8, top + _SIDE + 2 + 16 * line), text, ink, font)
    return np.asarray(sheet, np.uint8), broken


def format_asset_facts(asset: Asset) -> str:
    """Size, mass with its provenance, and licence of an asset on a single line."""
    x, y, z = (f"{100 * extent:.1f}" for extent in asset.size)
    mass = asset.physics_or_defaults().mass
    license_ = f", {asset.origin.license}" if asset.origin is not None else ""
    hollow = ", hollow" if asset.hollow else ""
    return f"{x} x {y} x {z} cm, {1000 * mass.value:.0f} g ({mass.provenance}){license_}{hollow}"


def composite_over_white(view: AssetView) -> Image:
    """(H, W, 3) uint8 of a view over white."""
    cover = view.rgba[:, :, 3:].astype(np.float64) / 255
    return np.rint(view.rgba[:, :, :3] * cover + 255 * (1 - cover)).astype(np.uint8)
