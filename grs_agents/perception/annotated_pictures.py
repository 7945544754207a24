"""Annotated pictures for models: outlined and numbered segments, sheets of crops, names of objects."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from grs_agents.base.foreign.pictures import read_picture
from grs_agents.perception.picture_files import COLORS, load_mask, write_png
from grs_agents.perception.types import Array, CandidateRecord, Mask, RGBDFrame

Record = TypeVar("Record", bound=CandidateRecord)
MARK, OTHERS = (255, 0, 255), (255, 255, 255)
"""Colours of the outlines of the queried segments, and of the others."""
SHOWN_SIDE = 1024
NAMED = "scene/named.png"
"""The photo with the names of its objects, in the run folder."""
_TILE = 256
"""Side to which the crops of a sheet are enlarged, pixels."""
_LEGIBLE, _FEWEST_COLUMNS = 150, 3
"""Least side of a crop on a sheet, pixels; columns of the sheets of large crops, which are reduced."""
_ASIDE = np.array(
    [(0, 0)] + [(x * far / 2, y * far) for far in range(1, 12) for x, y in ((0, -1), (0, 1), (-1, -1), (1, 1))]
)
"""Candidate offsets of a label from its place, in half its width and height."""
MARKS = "scene/marks.png"
"""The photo with its segments numbered and a ruler, in the run folder."""
_HIDDEN = 4
"""Times the area of its number, below which a segment is numbered beside it."""
_TICKS = 50
"""Pixels between the marks of a ruler; every second is labelled."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def outlined_segment_file_name(number: int) -> str:
    """The file, in the run folder, of the photo with segment ``number`` outlined."""
    return f"scene/marked_{number:02d}.png"


def write_outlines(
    frame: RGBDFrame, asked: Sequence[CandidateRecord], records: Sequence[CandidateRecord], run: Path
) -> float:
    """Write a photo for each segment ``asked`` about, with its outline, and outlines and numbers of all ``records``.

    Returns:
        Its pixels per pixel of the photo, which its ruler shows.
    """
    picture, outlines, scale = _draw_numbered_outlines(frame, records, run)
    for record in asked:
        marked = picture.copy()
        for color, width in (((0, 0, 0), 4), (MARK, 2)):
            cv2.drawContours(marked, outlines[record.id], -1, color, width)
        write_png(run / outlined_segment_file_name(record.id), marked)
    return scale


def group_segments_for_sheets(asked: Sequence[Record], run: Path) -> list[list[Record]]:
    """Divide segments into groups whose crops are legible on a sheet of `SHOWN_SIDE`: the larger, the fewer."""
    if not asked:
        return []
    sides = [max(read_picture(run / record.crop, cv2.IMREAD_COLOR).shape[:2]) for record in asked]
    columns = int(np.clip(SHOWN_SIDE // np.median(sides), _FEWEST_COLUMNS, SHOWN_SIDE // _LEGIBLE))
    groups = -(-len(asked) // columns**2)
    return [list(asked[group * len(asked) // groups : (group + 1) * len(asked) // groups]) for group in range(groups)]


def write_segment_sheet(asked: Sequence[CandidateRecord], run: Path, name: str = "sheet") -> str:
    """Write a sheet of the numbered crops of segments; returns its file, ``scene/<name>_<first number>.png``."""
    columns = int(np.ceil(len(asked) ** 0.5))
    crops = [read_picture(run / record.crop, cv2.IMREAD_COLOR) for record in asked]
    side = min(SHOWN_SIDE // columns, max(_TILE, *(max(crop.shape[:2]) for crop in crops)))
    sheet = np.zeros((-(-len(asked) // columns) * side, columns * side, 3), np.uint8)
    places: dict[str, Array] = {}
    for index, (record, crop) in enumerate(zip(asked, crops, strict=True)):
        scale = side / max(crop.shape[:2])
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        tile = cv2.resize(crop, None, fx=scale, fy=scale, interpolation=way)[:side, :side]
        row, column = index // columns * side, index % columns * side
        sheet[row : row + tile.shape[0], column : column + tile.shape[1]] = tile
        places[str(record.id)] = np.array([column + 20.0, row + 16.0])
    _draw_labels(sheet, places, 0.7)
    file = f"scene/{name}_{asked[0].id:02d}.png"
    write_png(run / file, sheet)
    return file


def write_numbered_photo(frame: RGBDFrame, records: Sequence[CandidateRecord], run: Path, name: str) -> float:
    """Write the photo with outlines and numbers of ``records`` into the file ``name`` of the run folder.

    Returns:
        Its pixels per pixel of the photo, which its ruler shows.
    """
    picture, _, scale = _draw_numbered_outlines(frame, records, run)
    write_png(run / name, picture)
    return scale


def write_marks(frame: RGBDFrame, records: Sequence[CandidateRecord], run: Path) -> float:
    """Write `MARKS`, with a ruler in pixels along its upper and left edge.

    Returns:
        Its pixels per pixel of the photo.
    """
    picture, scale = _resize_for_model(frame, enlarge=True)
    masks = {record.id: load_mask(run / record.mask) for record in records}
    for number, mask in masks.items():
        color = COLORS[number % len(COLORS)][::-1]
        for tint, width in (((0, 0, 0), 4), (color, 2)):
            cv2.drawContours(picture, _find_outlines(mask, scale), -1, tint, width)
    _number_segments(picture, masks, scale, 0.6)
    _draw_ruler(picture)
    write_png(run / MARKS, picture)
    return scale


def _draw_ruler(picture: Any) -> None:
    """Draw a ruler in pixels along the upper and the left edge."""
    height, width = picture.shape[:2]
    for axis, length in ((0, width), (1, height)):
        for at in range(_TICKS, length, _TICKS):
            long = 12 if at % (2 * _TICKS) == 0 else 6
            end, text = ((at, long), (at - 12, long + 14)) if axis == 0 else ((long, at), (long + 2, at + 5))
            cv2.line(picture, (at, 0) if axis == 0 else (0, at), end, OTHERS, 2)
            if long == 12:
                for tint, wide in (((0, 0, 0), 3), (OTHERS, 1)):
                    cv2.putText(picture, str(at), text, _FONT, 0.45, tint, wide, cv2.LINE_AA)


def _draw_numbered_outlines(
    frame: RGBDFrame, records: Sequence[CandidateRecord], run: Path
) -> tuple[Any, dict[int, Any], float]:
    """The photo with outlines and numbers of all segments and a ruler, the outlines by number, and its scale."""
    picture, scale = _resize_for_model(frame, enlarge=False)
    masks = {record.id: load_mask(run / record.mask) for record in records}
    outlines = {number: _find_outlines(mask, scale) for number, mask in masks.items()}
    cv2.drawContours(picture, [line for lines in outlines.values() for line in lines], -1, OTHERS, 1)
    _number_segments(picture, masks, scale, 0.5)
    _draw_ruler(picture)
    return picture, outlines, scale


def _number_segments(picture: Any, masks: Mapping[int, Mask], scale: float, size: float) -> None:
    """Draw the number of each segment: on it, or beside a segment of which it would hide much."""
    places = {str(number): _find_label_place(mask) * scale for number, mask in masks.items()}
    reach: dict[str, Array] = {}
    for number, mask in masks.items():
        if np.count_nonzero(mask) * scale**2 < _HIDDEN * np.prod(2 * _measure_label(str(number), size)):
            rows, columns = (np.ptp(np.nonzero(mask)[axis]) for axis in (0, 1))
            reach[str(number)] = scale * np.array([columns, rows]) / 2
    _draw_labels(picture, places, size, reach)


def draw_object_names(frame: RGBDFrame, masks: Mapping[str, Mask], run: Path) -> str:
    """Write ``scene/named.png``, the photo with the name of each object at its place; returns the file's name."""
    picture, scale = _resize_for_model(frame, enlarge=True)
    _draw_labels(picture, {name: _find_label_place(mask) * scale for name, mask in masks.items() if mask.any()}, 0.45)
    write_png(run / NAMED, picture)
    return NAMED


def draw_numbered_regions(frame: RGBDFrame, owned: Mask, regions: Sequence[Mask], file: Path) -> None:
    """Write the photo with the ``owned`` pixels (H, W) outlined and each of the ``regions`` filled and numbered."""
    picture, scale = _resize_for_model(frame, enlarge=True)
    cv2.drawContours(picture, _find_outlines(owned, scale), -1, OTHERS, 1)
    filled = picture.copy()
    for region in regions:
        cv2.drawContours(filled, _find_outlines(region, scale), -1, MARK, -1)
    cv2.addWeighted(filled, 0.6, picture, 0.4, 0, picture)
    places = {str(number): _find_label_place(region) * scale for number, region in enumerate(regions, 1)}
    _draw_labels(picture, places, 0.6)
    write_png(file, picture)


def _resize_for_model(frame: RGBDFrame, enlarge: bool) -> tuple[Any, float]:
    """The photo (BGR) at the size for models, enlarged if allowed, and its scale."""
    scale = SHOWN_SIDE / max(frame.rgb.shape[:2])
    scale = scale if enlarge else min(1.0, scale)
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    picture = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    return cv2.resize(picture, None, fx=scale, fy=scale, interpolation=interpolation), scale


def _find_outlines(mask: Mask, scale: float) -> list[Any]:
    lines = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
    return [np.rint(line * scale).astype(np.int32) for line in lines]


def _find_label_place(mask: Mask) -> Array:
    """(x, y) of the pixel of a mask farthest from its edge."""
    inner = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(inner.argmax()), mask.shape)
    return np.array([float(column), float(row)])


def _measure_label(text: str, size: float) -> Array:
    """Half the width and height of a label, pixels."""
    return np.array(cv2.getTextSize(text, _FONT, size, 1)[0]) / 2 + (3, 4)


def _draw_labels(
    picture: Any, places: Mapping[str, Array], size: float, reach: Mapping[str, Array] | None = None
) -> None:
    """Draw texts at places (x, y); texts that overlap, or must clear the ``reach`` of a place, get a leader line."""
    bounds = np.array(picture.shape[1::-1], np.float64)
    taken: list[tuple[Array, Array]] = []
    for text, place in places.items():
        half = _measure_label(text, size)
        spots = np.clip(place + _ASIDE * half, half, bounds - half)
        if reach and text in reach:
            clear = (np.abs(spots - place) >= half + reach[text]).any(axis=1)
            spots = spots[clear] if clear.any() else spots
        free = [at for at in spots if all((np.abs(at - spot) >= half + size).any() for spot, size in taken)]
        spot = free[0] if free else spots[0]
        taken.append((spot, half))
        ends = np.rint([place, spot, spot - half, spot + half, spot + half * (-1, 1) + (3, -4)]).astype(int).tolist()
        cv2.line(picture, ends[0], ends[1], OTHERS, 1, cv2.LINE_AA)
        cv2.rectangle(picture, ends[2], ends[3], (0, 0, 0), -1)
        cv2.putText(picture, text, ends[4], _FONT, size, OTHERS, 1, cv2.LINE_AA)
