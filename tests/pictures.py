"""Pictures that a test reads."""

from pathlib import Path
from typing import Any

import cv2
import numpy.typing as npt


def read_picture(path: Path, how: int = cv2.IMREAD_UNCHANGED) -> npt.NDArray[Any]:
    """The picture in a file, as OpenCV reads it: colours as blue, green, red."""
    picture = cv2.imread(str(path), how)
    assert picture is not None, f"{path} is not a picture"
    return picture
