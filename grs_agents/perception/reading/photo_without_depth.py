"""Photos without depth: depth by the user's own model, focal length by camera.json, configuration, EXIF or model."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.camera import camera_from_focal_length, focal_length_from_35mm
from grs_agents.perception.reading.frame_assembly import (
    RecordedDepth,
    SceneRecording,
    apply_exif_orientation,
    assemble_frame,
    downscale_rgb,
    limit_frame_size,
)
from grs_agents.perception.reading.picture import ColorPicture
from grs_agents.perception.types import Image, RGBDFrame


class DepthEstimate(Protocol):
    """Result of a depth tool."""

    @property
    def depth(self) -> "npt.NDArray[np.floating[Any]]":
        """(H, W) metres along the optical axis, 0 or NaN where unknown."""
        ...

    @property
    def focal(self) -> float | None:
        """The focal length in pixels of the given picture, if estimated."""
        ...


Estimator = Callable[[Image, float | None, str], DepthEstimate]
"""Maps a picture, its focal length in pixels if known, and its name in errors to its depth."""


def assemble_frame_from_photo(recording: SceneRecording, estimate: Estimator, field_of_view: float | None) -> RGBDFrame:
    """Estimate the depth of a photo. The focal length is that of ``camera.json``, else of ``field_of_view`` (degrees,
    of the width), else of the photo's EXIF, else the model's own."""
    camera = recording.camera
    recording = apply_exif_orientation(recording, [] if camera is None else [(camera.width, camera.height)])
    name = str(recording.picture.file)
    size = limit_frame_size(*recording.picture_size)
    rgb = recording.picture.rgb if size == recording.picture_size else downscale_rgb(recording.picture.rgb, *size)
    film_mm = recording.picture.focal_35mm
    focal: float | None = None  # of a picture of ``size``
    note = "its focal length is the depth tool's estimate"
    if camera is not None:
        focal, note = camera.fx * size[0] / camera.width, "camera.json"
    elif field_of_view is not None:
        focal = size[0] / 2 / math.tan(math.radians(field_of_view) / 2)
        note = f"its focal length is that of depth.field_of_view = {field_of_view:g} degrees"
    elif film_mm is not None:
        focal = focal_length_from_35mm(film_mm, size)
        note = f"its focal length is EXIF's, {film_mm:g} mm on 35 mm film"
    estimated = estimate(rgb, focal, name)
    depth = np.asarray(estimated.depth)
    if depth.ndim != 2 or depth.dtype.kind != "f":
        remedy = "let it give (H, W) metres"
        raise InputError(f"{name}: the depth tool gave an array of shape {depth.shape} and type {depth.dtype}", remedy)
    focal = estimated.focal if focal is None else focal
    if focal is None:
        advice = "add camera.json beside it, or give its angle: --set depth.field_of_view=DEGREES"
        raise InputError(f"{name} does not say its focal length, nor does the depth tool", advice)
    if camera is None:
        camera = camera_from_focal_length(focal, size, f"{name}, {note}")
        recording = replace(recording, picture=ColorPicture(recording.picture.file, rgb)).with_note(note)
    measured = RecordedDepth(depth, 1.0, f"the depth estimated for {name}", "the depth tool: it must give metres")
    noted = recording.with_note("depth was estimated from the colours alone, not measured")
    return assemble_frame(noted, camera, measured)
