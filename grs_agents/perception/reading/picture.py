"""Pictures of a scene as arrays: colour, depth and labels; other pixel formats are refused."""

import warnings
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import Numbers
from grs_agents.base.foreign.files import read_bytes
from grs_agents.base.foreign.pictures import FORMATS, MALFORMED, MOST_PIXELS, open_picture
from grs_agents.perception.types import Image

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".heic", ".heif")
COLOR_SUFFIXES = (*SUFFIXES, ".ppm", ".pnm", ".pgm")
DEPTH_SUFFIXES = (*SUFFIXES, ".pgm", ".pnm", ".exr", ".npy", ".npz")
GREY = ("1", "L", "LA", "I;16", "I;16B", "I;16L")
COLORED = ("RGB", "RGBA", "RGBX", "P", "PA", "CMYK", "YCbCr")
_NETPBM = (".ppm", ".pnm", ".pgm")
VOID = (224, 224, 192)
"""Colour of number 255 in label pictures of PASCAL VOC: the border of objects, whose owner is not told."""
MOST_LABEL_COLORS = 256
_STRIP = 256
"""Rows per conversion."""
_ORIENTATION, _EXIF, _FOCAL_35MM = 0x0112, 0x8769, 0xA405


@dataclass(frozen=True)
class ColorPicture:
    """A colour picture as its pixels are stored."""

    file: Path
    rgb: Image  # (H, W, 3) uint8
    orientation: int = 1  # EXIF's, 1 to 8; 1 by default
    # the focal length in millimetres on 35 mm film with the same diagonal angle, if the camera noted it
    focal_35mm: float | None = None


def read_color_picture(file: Path) -> ColorPicture:
    """Read a picture as 8-bit RGB: grey, palette, 16-bit and CMYK are converted, an alpha channel is dropped."""
    with _open_decoded_picture(file) as image:
        if image.mode in GREY[3:]:
            rgb = np.repeat((np.asarray(image) // 257).astype(np.uint8)[..., None], 3, axis=2)
        elif image.mode in GREY or image.mode in COLORED:
            rgb = np.empty((image.height, image.width, 3), np.uint8)
            for top in range(0, image.height, _STRIP):  # in strips: Pillow would hold the pixels three times
                part = image.crop((0, top, image.width, min(top + _STRIP, image.height)))
                rgb[top : top + _STRIP] = np.asarray(part if part.mode == "RGB" else part.convert("RGB"))
        else:
            raise InputError(f"{file} has pixels of kind {image.mode!r}, no colours", "write it as 8-bit RGB")
        orientation, focal = 1, None
        with suppress(*MALFORMED):  # a torn EXIF block is ignored
            exif = image.getexif()
            stated: Any = exif.get(_ORIENTATION, 1)
            orientation = int(stated) if int(stated) in range(1, 9) else 1
            millimetres = float(exif.get_ifd(_EXIF).get(_FOCAL_35MM, 0))
            focal = millimetres if 5 <= millimetres <= 1000 else None
    return ColorPicture(file, rgb, orientation, focal)


def read_depth_picture(file: Path) -> "npt.NDArray[np.number[Any]]":
    """Read a depth picture: (H, W) of 16- or 32-bit integers or floats, in the file's own unit."""
    if file.suffix.lower() == ".exr":
        return _read_exr(file)
    with _open_decoded_picture(file) as image:
        units = np.array(image)
        if units.ndim == 3:  # Pillow cuts channels of 16 bits down to 8
            data = np.frombuffer(read_bytes(file), np.uint8)
            whole: npt.NDArray[Any] | None = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
            units = units if whole is None else whole
    if units.ndim == 3 and units.dtype.itemsize >= 2 and (units[..., :1] == units[..., :3]).all():
        units = units[..., 0]
    if units.ndim != 2 or image.mode in ("P", "1") or units.dtype.itemsize < 2:
        channels = 1 if units.ndim == 2 else units.shape[2]
        kind = f"a palette of {units.dtype}" if image.mode == "P" else f"{channels} channels of {units.dtype}"
        remedy = "write it as one channel of uint16"
        if units.dtype == np.uint8:
            colored = units.ndim == 3 and bool((units[..., :1] != units[..., 1:3]).any())
            drawn = "a colour-mapped view of depth" if colored or image.mode == "P" else "depth in 256 steps"
            remedy = f"it is {drawn}, from which distances cannot be restored: save the sensor's 16-bit depth"
        raise InputError(f"{file} has {kind}, no depth", remedy)
    # Pillow opens a PGM of 16 bits with 32
    return units.astype(np.uint16) if image.format == "PPM" and 0 <= units.min() <= units.max() < 65536 else units


def _read_exr(file: Path) -> "npt.NDArray[np.number[Any]]":
    """The depth channel of an OpenEXR picture, (H, W) float32, by its usual names or the first of equal channels."""
    read_bytes(file)  # a regular file of bounded size
    open_exr: Any = import_module("OpenEXR").File
    try:
        with open_exr(str(file), header_only=True) as header:
            left, top, right, bottom = np.ravel(header.header()["dataWindow"]).tolist()
            if not 0 < (right - left + 1) * (bottom - top + 1) <= MOST_PIXELS:
                raise InputError(
                    f"{file} has {right - left + 1}x{bottom - top + 1} pixels", "give it at a smaller size"
                )
        with open_exr(str(file), separate_channels=True) as picture:
            channels: dict[str, Numbers] = {name: channel.pixels for name, channel in picture.channels().items()}
    except InputError:
        raise
    except Exception as error:  # its parser raises errors of several kinds on forged files
        raise InputError(f"{file} is not a readable OpenEXR picture: {str(error)[:200]}", "write it as .npy") from error
    for name in ("Z", "depth", "Depth", "depth.Z", "Y", "V", "R", *channels):
        if name in channels and channels[name].ndim == 2:
            return channels[name].astype(np.float32)
    raise InputError(f"{file} has no channel of depth", "write it with one channel, Z")


def read_label_picture(file: Path) -> npt.NDArray[np.int32]:
    """Read a label picture: (H, W) numbers, palette indices, or a number for each colour; 0 where VOC says void."""
    with _open_decoded_picture(file) as image:
        numbers = np.array(image)
        void = image.mode == "P" and (image.getpalette() or [])[255 * 3 :] == [*VOID]
    if numbers.ndim == 3 and (numbers[..., :1] == numbers[..., :3]).all():  # grey written as RGB
        numbers = numbers[..., 0]
    if image.mode == "RGB" and numbers.ndim == 3:
        red, green, blue = (numbers[..., channel].astype(np.int32) for channel in range(3))
        numbers = (red << 16) + (green << 8) + blue
        numbers[(red == VOID[0]) & (green == VOID[1]) & (blue == VOID[2])] = 0
        count = len(np.unique(numbers))
        if count > MOST_LABEL_COLORS:
            remedy = "write labels as PNG, without smooth edges"
            raise InputError(f"{file} has {count} colours, more than {MOST_LABEL_COLORS} labels", remedy)
    if numbers.ndim != 2 or numbers.dtype.kind not in "bui":
        raise InputError(f"{file} has pixels of kind {image.mode!r}", "write it as one channel of uint8 or uint16")
    return np.where(numbers == 255, 0, numbers).astype(np.int32) if void else numbers.astype(np.int32)


def rotate_by_exif(rgb: Image, orientation: int) -> Image:
    """The picture rotated or flipped by its EXIF orientation."""
    turned = {
        2: rgb[:, ::-1],
        3: rgb[::-1, ::-1],
        4: rgb[::-1],
        5: rgb.transpose(1, 0, 2),
        6: np.rot90(rgb, -1),
        7: rgb[::-1, ::-1].transpose(1, 0, 2),
        8: np.rot90(rgb),
    }.get(orientation, rgb)
    return np.ascontiguousarray(turned)


@contextmanager
def _open_decoded_picture(file: Path) -> Generator[Pillow.Image]:
    """Open and decode a picture after a check of its size."""
    # Pillow warns of sizes beyond our tighter bound, and of torn EXIF blocks.
    with (
        warnings.catch_warnings(action="ignore"),
        open_picture(
            file, f"put {file.name} there", (*FORMATS, "PPM") if file.suffix.lower() in _NETPBM else FORMATS
        ) as (image, _),
    ):
        image.load()
        yield image
