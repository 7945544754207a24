"""Bring colour, depth and camera to one pixel grid: the frame that everything else works on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from grs_agents.errors import InputError
from grs_agents.perception.frame import Camera, Image, RGBDFrame
from grs_agents.perception.reading.camera import resized
from grs_agents.perception.reading.depth import Measured, at_size, metres, same_shape
from grs_agents.perception.reading.picture import Picture, upright

MOST_FRAME_PIXELS = 9_000_000
"""A frame of more pixels (4K has 8.8 million) is made smaller: nothing of 2 cm is lost by it."""
SMALLEST = 8
"""A frame has at least this many pixels a side."""


@dataclass(frozen=True)
class Recording:
    """What was found of a scene.

    Attributes:
        source: what was named on the command line.
        picture: the colours.
        camera: the camera of the colour picture or of the depth picture, whichever has its size.
        measured: the depth.
        notes: what a reader of the scene should know about how it was read.
    """

    source: Path
    picture: Picture
    camera: Camera | None = None
    measured: Measured | None = None
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the colour picture."""
        height, width = self.picture.rgb.shape[:2]
        return width, height

    def noting(self, note: str) -> "Recording":
        """The same with one more note."""
        return replace(self, notes=(*self.notes, note))


def frame_of(recording: Recording, camera: Camera, measured: Measured) -> RGBDFrame:
    """Put colour, depth and camera on the colour picture's grid.

    Raises:
        InputError: the sizes belong to different views, the camera to neither picture, or the depth is of no use.
    """
    height, width = measured.units.shape
    if min(*recording.size, width, height) < SMALLEST:
        raise InputError(
            f"{recording.picture.file} is {recording.size[0]}x{recording.size[1]} and its depth {width}x{height}",
            f"give pictures of at least {SMALLEST} pixels a side",
        )
    recording = turned(recording, [(camera.width, camera.height), (width, height)])
    size, file = recording.size, recording.picture.file
    if not same_shape(size, (width, height)):
        raise InputError(
            f"{measured.where} is {width}x{height} but {file} is {size[0]}x{size[1]}, of another shape",
            "register depth to colour, or crop both to the same view",
        )
    if (camera.width, camera.height) not in (size, (width, height)):
        raise InputError(
            f"{file} is {size[0]}x{size[1]} but camera.json says {camera.width}x{camera.height}",
            "give the size, and the numbers that belong to it, of the colour or of the depth picture",
        )
    depth, rgb = metres(measured), recording.picture.rgb
    target = working_size(*size)
    if size != (width, height):
        recording = recording.noting(f"depth of {width}x{height} pixels was brought to {target[0]}x{target[1]}")
    if target != size:
        recording = recording.noting(
            f"the photo of {size[0]}x{size[1]} pixels was made smaller, {target[0]}x{target[1]}"
        )
        rgb = smaller(rgb, *target)
    if target != (width, height):
        depth = at_size(depth, *target)
    camera = resized(camera, *target).model_copy(update={"depth_scale": measured.stored_scale})
    return RGBDFrame(rgb, depth, camera, recording.source, recording.notes)


def turned(recording: Recording, sizes: Sequence[tuple[int, int]]) -> Recording:
    """Turn a photo as its EXIF orientation says, where camera and depth show that they belong to the turned photo.

    Args:
        recording: what was found.
        sizes: width and height of what belongs to the photo; nothing for a photo alone, which is turned.

    Raises:
        InputError: it cannot be told whether they belong to the stored or to the turned photo.
    """
    picture = recording.picture
    if picture.orientation == 1:
        return recording
    rgb = upright(picture.rgb, picture.orientation)
    as_shown = all(same_shape(one, (rgb.shape[1], rgb.shape[0])) for one in sizes)
    if sizes and as_shown and all(same_shape(one, recording.size) for one in sizes):
        raise InputError(
            f"{picture.file} has EXIF orientation {picture.orientation}: whether the camera's numbers are those of the "
            "stored or of the turned picture cannot be told",
            "save it as its pixels are to be looked at, without that tag",
        )
    return replace(recording, picture=Picture(picture.file, rgb, 1, picture.focal_35mm)) if as_shown else recording


def working_size(width: int, height: int) -> tuple[int, int]:
    """The size itself, or one of the same shape with at most `MOST_FRAME_PIXELS`."""
    share = (MOST_FRAME_PIXELS / (width * height)) ** 0.5
    return (width, height) if share >= 1 else (int(width * share), int(height * share))


def smaller(rgb: Image, width: int, height: int) -> Image:
    """The colours averaged over the pixels of a smaller picture."""
    return np.asarray(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
