"""Untrusted pictures: the size is checked before a pixel is decoded; torn or huge pictures are refused by name."""

import struct
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.elsewhere import current_decoder
from grs_agents.base.foreign.files import MOST_BYTES, read_bytes

MOST_PIXELS = 64_000_000
"""Pictures of more pixels are not decoded."""
FORMATS = ("PNG", "JPEG", "TIFF", "WEBP", "BMP")
MALFORMED = (
    *(OSError, SyntaxError, ValueError, TypeError, ArithmeticError, LookupError, EOFError, RuntimeError),
    *(AttributeError, MemoryError, struct.error, zlib.error, Pillow.DecompressionBombError),
)
"""Errors of Pillow's readers on torn or forged files."""
_MOST_RUN_BYTES = 1 << 26
_MOST_RUN_PIXELS = 16_000_000
"""Bounds of a picture of a run folder, in bytes and pixels: a frame has at most 9 million pixels."""


_HEIF_BRANDS = {b"ftyp" + brand for brand in (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")}
"""Bytes 4 to 12 of a HEIC photo; iPhones write ``heic``."""


@contextmanager
def open_picture(
    file: Path, remedy: str, formats: tuple[str, ...] = FORMATS, most: int = MOST_BYTES, pixels: int = MOST_PIXELS
) -> Generator[tuple[Pillow.Image, bytes]]:
    """A picture of checked size, not decoded, and its bytes. Raises InputError: it is missing, torn or too large."""
    data = read_bytes(file, remedy, most)
    with open_picture_bytes(data, str(file), formats, pixels) as image:
        yield image, data


@contextmanager
def open_picture_bytes(
    data: bytes, where: str, formats: tuple[str, ...] = FORMATS, pixels: int = MOST_PIXELS
) -> Generator[Pillow.Image]:
    """A picture of checked size, not decoded; ``where`` is its name in errors. Raises InputError: torn or too large."""
    known = ", ".join(formats)
    if formats == FORMATS and data[4:12] in _HEIF_BRANDS:
        try:
            pillow_heif = import_module("pillow_heif")
        except ImportError as error:
            install = 'pip install "grs-agents[heic]", or write it as .jpg'
            raise InputError(
                f"{where} is a HEIC photo, and the package pillow-heif is not installed", install
            ) from error
        pillow_heif.register_heif_opener()
        formats = ("HEIF",)
    try:
        with Pillow.open(BytesIO(data), formats=formats) as image:
            width, height = image.size
            if width * height > pixels:
                message = f"{where} has {width}x{height} pixels, more than {pixels}"
                raise InputError(message, "give it at a smaller size")
            yield image
    except InputError:
        raise
    except Pillow.UnidentifiedImageError as error:
        message = f"{where} is not a readable picture ({len(data)} bytes)"
        raise InputError(message, f"write it as one of {known}") from error
    except MALFORMED as error:
        reason = str(error)[:200] or type(error).__name__
        raise InputError(f"{where} is not a readable picture: {reason}", f"write it again as one of {known}") from error


def read_picture(file: Path, flags: int) -> npt.NDArray[Any]:
    """A PNG or JPEG of a run folder, decoded by OpenCV. Raises InputError: it is missing, torn or too large."""
    decoder = current_decoder()
    if decoder is not None and (decoded := decoder.read_picture(file, flags)) is not None:
        return decoded
    remedy = "restore the file or run again"
    with open_picture(file, remedy, ("PNG", "JPEG"), _MOST_RUN_BYTES, _MOST_RUN_PIXELS) as (_, data):
        image: npt.NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        if image is None:
            raise ValueError("it is torn")
        return image
