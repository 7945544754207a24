"""Masks supplied with a scene: by a person, another program, or a data set."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import Numbers, read_npy, read_npz
from grs_agents.base.foreign.files import is_folder, list_folder_names
from grs_agents.perception.reading.annotations import find_annotation_names, read_annotations
from grs_agents.perception.reading.bop import is_bop_source, parse_bop_source
from grs_agents.perception.reading.captures import split_choice
from grs_agents.perception.reading.frame_assembly import have_same_aspect_ratio, resize_nearest
from grs_agents.perception.reading.picture import SUFFIXES, read_label_picture

Labels = npt.NDArray[np.int32]
MOST_MASKS = 255
STEMS = ("masks", "labels")
FORMS = (
    "masks.png (0 for the background, 1 to 255 for the objects), masks.npy ((H, W) numbers or (N, H, W) masks), or a "
    "folder masks/ with one picture for each object, or the file of an annotation tool (COCO or LabelMe)"
)


@dataclass(frozen=True)
class GivenMasks:
    """Masks of a scene."""

    labels: Labels  # (H, W): 0 for the background, objects from 1, the smaller on top
    names: tuple[str, ...] = ()  # of objects 1, 2, ...; empty if they have none


def read_masks(source: Path, shape: tuple[int, int]) -> GivenMasks:
    """The masks of a scene.

    Args:
        source: of the scene: a folder, an ``.npz``, a photo or recording with masks beside it, or a ``bop:`` image.
        shape: rows and columns of its frame; masks of another size are resampled.

    Raises:
        InputError: there are no masks, too many, or their aspect ratio differs from the frame's.
    """
    if is_bop_source(source):
        image = parse_bop_source(source)
        return _merge_masks(_read_mask_pictures(image.scene / "mask_visib", f"{image.file_stem}_"), shape, str(source))
    source, _ = split_choice(source)
    if is_folder(source):
        return _read_masks_in_folder(source, shape)
    if source.suffix.lower() == ".npz":
        arrays = read_npz(source, {"masks": "(H, W) numbers or (N, H, W) masks"}, {})
        return _masks_from_array(arrays["masks"], shape, f"masks in {source}")
    return _read_masks_in_folder(source.parent, shape, source.name)


def find_mask_names(folder: Path) -> list[str]:
    """The names in a folder of what may hold masks, the first of which is read."""
    names = list_folder_names(folder)
    pictures = [
        name for stem in STEMS for name in names if Path(name).stem.lower() == stem and not name.endswith(".json")
    ]
    return pictures + find_annotation_names(names)


def _read_masks_in_folder(folder: Path, shape: tuple[int, int], photo: str = "") -> GivenMasks:
    """The masks in a folder, of its only photo if none is named."""
    found = find_mask_names(folder)
    if photo and f"{Path(photo).stem}.json" in found:  # its own before those of a data set
        found.insert(0, f"{Path(photo).stem}.json")
    if not found:
        raise InputError(f"{folder} has no masks", f"add {FORMS}; or use tools.segment=segment_rgbd")
    file = folder / found[0]
    if is_folder(file):
        return _merge_masks(_read_mask_pictures(file, ""), shape, str(file))
    if file.suffix.lower() == ".npy":
        return _masks_from_array(read_npy(file), shape, str(file))
    if file.suffix.lower() in SUFFIXES:
        return _number_masks(_resize_mask_to_frame(read_label_picture(file), shape, str(file)), str(file))
    if file.suffix.lower() == ".json":
        photos = (
            [photo] if photo else [name for name in list_folder_names(folder) if Path(name).suffix.lower() in SUFFIXES]
        )
        annotations = read_annotations(file, photos)
        names = [annotation.name for annotation in annotations]
        return _merge_masks([(str(file), annotation.mask) for annotation in annotations], shape, str(file), names)
    raise InputError(f"{file} holds no masks", f"give {FORMS}")


def _read_mask_pictures(folder: Path, prefix: str) -> list[tuple[str, Numbers]]:
    """Names and masks (pixels other than 0) of the pictures of a folder whose names begin with ``prefix``."""
    names = list_folder_names(folder)
    names = [name for name in names if name.startswith(prefix) and Path(name).suffix.lower() in SUFFIXES]
    if not 0 < len(names) <= MOST_MASKS:
        raise InputError(f"{folder} holds {len(names)} masks {prefix}*", f"give 1 to {MOST_MASKS}")
    return [(str(folder / name), read_label_picture(folder / name) > 0) for name in names]


def _masks_from_array(array: Numbers, shape: tuple[int, int], where: str) -> GivenMasks:
    if array.dtype.kind not in "bui" or array.ndim not in (2, 3):
        raise InputError(f"{where} has shape {array.shape} and type {array.dtype}", f"give {FORMS}")
    if array.ndim == 2:
        return _number_masks(_resize_mask_to_frame(array, shape, where), where)
    if not len(array) <= MOST_MASKS:
        raise InputError(f"{where} holds {len(array)} masks", f"give 1 to {MOST_MASKS}")
    return _merge_masks([(where, mask != 0) for mask in array], shape, where)


def _merge_masks(
    masks: list[tuple[str, Numbers]], shape: tuple[int, int], where: str, names: Sequence[str] = ()
) -> GivenMasks:
    """Masks in one label image, the smaller on top."""
    sized = [_resize_mask_to_frame(mask, shape, name) for name, mask in masks]
    labels = np.zeros(shape, np.int32)
    for number in sorted(range(len(sized)), key=lambda number: -int(sized[number].sum())):
        labels[sized[number] > 0] = number + 1
    return _number_masks(labels, where, names)


def _resize_mask_to_frame(mask: Numbers, shape: tuple[int, int], where: str) -> Labels:
    """The mask at the frame's size, by the nearest pixel."""
    rows, columns = mask.shape
    if not have_same_aspect_ratio((columns, rows), (shape[1], shape[0])):
        found = f"{where} is {columns}x{rows} but the frame is {shape[1]}x{shape[0]}, of another shape"
        raise InputError(found, "give masks for the whole photo")
    if mask.dtype.kind != "b" and (int(mask.max()) > np.iinfo(np.int32).max or int(mask.min()) < 0):
        raise InputError(f"{where} has numbers from {mask.min()} to {mask.max()}", "number the objects from 1")
    numbers = mask.astype(np.int32)
    return numbers if mask.shape == shape else resize_nearest(numbers, shape[1], shape[0])


def _number_masks(labels: Labels, where: str, names: Sequence[str] = ()) -> GivenMasks:
    """The masks numbered from 1 without gaps, 0 kept."""
    values, inverse = np.unique(labels, return_inverse=True)
    objects = values[values > 0]
    if not 0 < len(objects) <= MOST_MASKS:
        raise InputError(f"{where} shows {len(objects)} objects", f"give 1 to {MOST_MASKS}: {FORMS}")
    numbers = np.where(values > 0, np.cumsum(values > 0), 0)[inverse].reshape(labels.shape).astype(np.int32)
    return GivenMasks(numbers, tuple(names[int(value) - 1] for value in objects) if names else ())
