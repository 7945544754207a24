"""Pictures of a run folder as OpenCV decodes them; their size is known before a pixel is."""

import io
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from grs_agents.errors import InputError
from grs_agents.foreign.files import read_bytes

MOST_PIXELS = 64_000_000
"""As of the photo that a run begins with."""
_MOST_BYTES = 1 << 26
_MALFORMED = (OSError, SyntaxError, ValueError, LookupError, struct.error, Pillow.DecompressionBombError)
"""What Pillow raises on a header that is torn or forged."""
_REMEDY = "restore the file or run again"


def read_picture(file: Path, flags: int) -> npt.NDArray[Any]:
    """A PNG or JPEG picture.

    Args:
        file: its path.
        flags: OpenCV's, such as ``cv2.IMREAD_COLOR``.

    Raises:
        InputError: the file is missing, no picture, or one of more than ``MOST_PIXELS``.
    """
    data = read_bytes(file, _REMEDY, _MOST_BYTES)
    try:
        with Pillow.open(io.BytesIO(data), formats=("PNG", "JPEG")) as picture:
            width, height = picture.size
    except _MALFORMED as error:
        raise InputError(f"cannot read the picture {file}: it is no PNG or JPEG", _REMEDY) from error
    if width * height > MOST_PIXELS:
        raise InputError(f"{file} has {width}x{height} pixels, more than {MOST_PIXELS}", "give it at a smaller size")
    image: npt.NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise InputError(f"cannot read the picture {file}: it is torn", _REMEDY)
    return image
