"""Masks of annotation tools: COCO (polygons, run lengths) and LabelMe (polygons, rectangles, circles, bitmaps)."""

import base64
import binascii
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import read_json
from grs_agents.base.foreign.pictures import MOST_PIXELS, open_picture_bytes
from grs_agents.perception.reading.picture import SUFFIXES

MOST_OBJECTS = 255
_NAMES = ("masks.json", "labels.json", "annotations.json", "result.json")
_PARTS = ("coco", "annotation", "instances")
_REMEDY = "export it again as COCO or LabelMe"
_MOST_CROSSINGS = 4_000_000  # of edges and rows; a polygon of 1,000 corners in a 4K photo has at most 2 million
_FARTHEST = 1e6  # pixels; corners are clipped
LONGEST_NAME = 60  # letters that are kept of a label
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class NamedMask:
    """A mask with the name of its label."""

    name: str
    mask: Mask  # (H, W) of the annotated picture


def find_annotation_names(names: Sequence[str]) -> list[str]:
    """The names, of those in a folder, that annotation tools give their files: of data sets, or a photo's own."""
    photos = {Path(name).stem.lower() for name in names if Path(name).suffix.lower() in SUFFIXES}
    found: list[str] = []
    for name in names:
        path = Path(name.lower())
        usual = path.name in _NAMES or any(part in path.stem for part in _PARTS) or path.stem in photos
        if path.suffix == ".json" and path.name != "camera.json" and usual:
            found.append(name)
    return found


def read_annotations(file: Path, photos: Sequence[str]) -> list[NamedMask]:
    """Read the masks of a photo.

    Args:
        file: its path.
        photos: names of the pictures beside it; a data set's entry of one of them is taken.

    Raises:
        InputError: it is neither COCO nor LabelMe, says nothing of these photos or of more than one, or is torn.
    """
    values = read_json(file, _REMEDY)
    if isinstance(values.get("annotations"), list) and isinstance(values.get("images"), list):
        found = list(_read_coco(values, file, photos))
    elif isinstance(values.get("shapes"), list):
        found = _read_labelme(values, file)
    else:
        raise InputError(f"{file} is neither COCO (images, annotations) nor LabelMe (shapes)", _REMEDY)
    if not found:
        raise InputError(f"{file} has no polygon and no mask of the photo", "outline the objects in it")
    return found


def _read_coco(values: Mapping[str, Any], file: Path, photos: Sequence[str]) -> Iterator[NamedMask]:
    images = [image for image in _objects_of(values, "images") if isinstance(image.get("file_name"), str)]
    chosen = [image for image in images if Path(image["file_name"]).name in photos] or images
    if len(chosen) != 1:
        names = ", ".join(str(image["file_name"])[:LONGEST_NAME] for image in chosen[:6]) or "none"
        remedy = "name the photo itself as the scene, or give the annotations of that photo alone"
        raise InputError(f"{file} annotates {len(chosen)} pictures ({names}), one must be the photo", remedy)
    image = chosen[0]
    shape = _shape_of(image.get("height"), image.get("width"), f"{file}, {image['file_name'][:LONGEST_NAME]}")
    labels = {item.get("id"): item.get("name") for item in _objects_of(values, "categories")}
    items = [item for item in _objects_of(values, "annotations") if item.get("image_id") == image.get("id")]
    for number, item in enumerate(_limit(items, file), start=1):
        outline, where = item.get("segmentation"), f"{file}, annotation {number} of the photo"
        if item.get("iscrowd") and not isinstance(outline, list):
            continue  # many objects in one mask
        if isinstance(outline, dict):
            mask = _decode_run_lengths(cast(dict[str, Any], outline), shape, where)
        elif isinstance(outline, list) and outline:
            parts = [_corners_of(part, where) for part in cast(list[object], outline)]
            mask = _fill_polygons(parts, shape)
        else:
            continue  # a box alone
        yield NamedMask(_clean_name(labels.get(item.get("category_id"))), mask)


def _read_labelme(values: Mapping[str, Any], file: Path) -> list[NamedMask]:
    shape = _shape_of(values.get("imageHeight"), values.get("imageWidth"), str(file))
    masks: dict[object, NamedMask] = {}
    for number, item in enumerate(_limit(_objects_of(values, "shapes"), file), start=1):
        where, kind = f"{file}, shape {number}", item.get("shape_type") or "polygon"
        if kind not in ("polygon", "rectangle", "circle", "mask"):
            continue  # points and lines
        corners = _corners_of(item.get("points"), where)
        if kind == "polygon":
            mask = _fill_polygons([corners], shape)
        elif len(corners) < 2:
            raise InputError(f"{where} is a {kind} of {len(corners)} points", _REMEDY)
        elif kind == "rectangle":
            low, high = corners.min(axis=0), corners.max(axis=0)
            mask = _fill_polygons([np.array([low, [high[0], low[1]], high, [low[0], high[1]]])], shape)
        elif kind == "circle":
            center, radius = corners[0], float(np.linalg.norm(corners[1] - corners[0]))
            turns = np.linspace(0, 2 * np.pi, 128, endpoint=False)
            mask = _fill_polygons([center + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)], shape)
        else:
            mask = _decode_bitmap(item.get("mask"), corners[0], shape, where)
        name, group = _clean_name(item.get("label")), item.get("group_id")
        key = number if group is None else (str(group), name)
        if key in masks:  # parts of one object that another hides
            mask = mask | masks[key].mask
        masks[key] = NamedMask(name, mask)
    return list(masks.values())


def _objects_of(values: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """The objects in a list of JSON."""
    items = values.get(key)
    return [item for item in cast(list[Any], items) if isinstance(item, dict)] if isinstance(items, list) else []


def _limit(items: list[dict[str, Any]], file: Path) -> list[dict[str, Any]]:
    if len(items) > MOST_OBJECTS:
        raise InputError(f"{file} outlines {len(items)} things in the photo", f"give 1 to {MOST_OBJECTS}")
    return items


def _shape_of(rows: object, columns: object, where: str) -> tuple[int, int]:
    if type(rows) is not int or type(columns) is not int or rows < 1 or not 0 < rows * columns <= MOST_PIXELS:
        found = f"{where}: the picture is {str(columns)[:20]}x{str(rows)[:20]}"
        raise InputError(found, f"give its width and height, with at most {MOST_PIXELS} pixels")
    return rows, columns


def _clean_name(value: object) -> str:
    return escape_control_chars(" ".join(str(value).split()))[:LONGEST_NAME] if isinstance(value, str) else ""


def _corners_of(value: object, where: str) -> npt.NDArray[np.float64]:
    """(N, 2) corners: pairs of numbers, or x and y in turn."""
    try:
        corners = np.array(value, np.float64).reshape(-1, 2)
    except (ValueError, TypeError) as error:
        raise InputError(f"{where} has corners that are no pairs of numbers", _REMEDY) from error
    if not np.isfinite(corners).all():
        raise InputError(f"{where} has corners that are not finite", _REMEDY)
    return np.clip(corners, -_FARTHEST, _FARTHEST)


def _fill_polygons(parts: Sequence[npt.NDArray[np.float64]], shape: tuple[int, int]) -> Mask:
    """Pixels whose centre is inside any of the polygons, by the even-odd rule; the first centre is at (0.5, 0.5)."""
    mask = np.zeros(shape, np.bool_)
    for corners in parts:
        (x, y), (next_x, next_y) = corners.T, np.roll(corners, -1, axis=0).T
        first, last = (
            np.clip(np.ceil(ends - 0.5), 0, shape[0]) for ends in (np.minimum(y, next_y), np.maximum(y, next_y))
        )
        counts = (last - first).astype(np.int64)  # of the rows that each edge crosses
        if counts.sum() > _MOST_CROSSINGS:
            raise InputError(f"a polygon of {len(corners)} corners crosses {counts.sum()} rows", _REMEDY)
        edges = np.repeat(np.arange(len(corners)), counts)
        rows = first[edges].astype(np.int64) + np.arange(len(edges)) - np.repeat(np.cumsum(counts) - counts, counts)
        slopes = (next_x - x)[edges] / (next_y - y)[edges]
        columns = np.ceil(x[edges] + (rows + 0.5 - y[edges]) * slopes - 0.5)
        flips = np.zeros((shape[0], shape[1] + 1), np.bool_)
        np.logical_xor.at(flips, (rows, np.clip(columns, 0, shape[1]).astype(np.int64)), True)
        mask |= np.logical_xor.accumulate(flips, axis=1)[:, :-1]
    return mask


def _decode_run_lengths(outline: Mapping[str, Any], shape: tuple[int, int], where: str) -> Mask:
    """The mask of COCO's run lengths, down the columns, of pixels outside and inside in turn."""
    counts = outline.get("counts")
    if isinstance(counts, str):
        runs = _unpack_run_lengths(counts)
    else:
        items = cast(list[Any], counts) if isinstance(counts, list) else []
        runs = [run for run in items if type(run) is int]
    if outline.get("size") != list(shape) or min(runs, default=-1) < 0 or sum(runs) != shape[0] * shape[1]:
        found = f"{where} has run lengths of {sum(runs)} pixels and size {str(outline.get('size'))[:40]}"
        raise InputError(f"{found}, not of {shape[0] * shape[1]} and {list(shape)}", _REMEDY)
    inside = np.arange(len(runs)) % 2 == 1
    return np.repeat(inside, runs).reshape(shape, order="F")


def _unpack_run_lengths(text: str) -> list[int]:
    """Run lengths of COCO's compressed form: five bits a character, signed, from the third on as differences."""
    runs: list[int] = []
    value = bits = 0
    for letter in text:
        code = ord(letter) - 48
        value |= (code & 31) << bits
        bits += 5
        if code & 32 and bits < 40:
            continue
        if code & 16:
            value -= 1 << bits
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = bits = 0
    return runs


def _decode_bitmap(text: object, corner: npt.NDArray[np.float64], shape: tuple[int, int], where: str) -> Mask:
    """The mask of a small picture, in base64, whose first pixel lies at ``corner``."""
    try:
        data = base64.b64decode(text if isinstance(text, str) else "", validate=True)
    except (binascii.Error, ValueError) as error:
        raise InputError(f"{where} has a mask that is not base64", _REMEDY) from error
    with open_picture_bytes(data, where) as image:
        part = np.array(image.convert("L")) > 0
    column, row = np.rint(corner).astype(int)
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise InputError(f"{where} has a mask at column {column}, row {row}, outside the picture", _REMEDY)
    mask = np.zeros(shape, np.bool_)
    part = part[: shape[0] - row, : shape[1] - column]
    mask[row : row + part.shape[0], column : column + part.shape[1]] = part
    return mask
