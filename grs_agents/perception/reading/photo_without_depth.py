"""A photo without depth: a model of the user's own estimates it, and the lens is looked for where it may be told."""

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
    Recording,
    apply_exif_orientation,
    assemble_frame,
    downscale_rgb,
    limit_frame_size,
)
from grs_agents.perception.reading.picture import Picture
from grs_agents.perception.types import Image, RGBDFrame


class DepthEstimate(Protocol):
    """What a depth tool answers."""

    @property
    def depth(self) -> "npt.NDArray[np.floating[Any]]":
        """(H, W) metres along the optical axis, 0 or NaN where it cannot tell."""
        ...

    @property
    def focal(self) -> float | None:
        """The focal length in pixels of the given picture, if it estimates that too."""
        ...


Estimator = Callable[[Image, float | None, str], DepthEstimate]
"""From the picture, its focal length in pixels if known, and what to call it in errors, to its depth."""


def assemble_frame_from_photo(recording: Recording, estimate: Estimator, field_of_view: float | None) -> RGBDFrame:
    """Estimate the depth of a photo. The focal length is that of ``camera.json``, else of ``field_of_view`` (degrees,
    of the width), else of the photo's EXIF, else the model's own."""
    camera = recording.camera
    recording = apply_exif_orientation(recording, [] if camera is None else [(camera.width, camera.height)])
    name = str(recording.picture.file)
    size = limit_frame_size(*recording.picture_size)
    rgb = recording.picture.rgb if size == recording.picture_size else downscale_rgb(recording.picture.rgb, *size)
    focal, source_note = _focal_length_with_source(recording, size, field_of_view)
    found = estimate(rgb, focal, name)
    depth = np.asarray(found.depth)
    if depth.ndim != 2 or depth.dtype.kind != "f":
        remedy = "let it give (H, W) metres"
        raise InputError(f"{name}: the depth tool gave an array of shape {depth.shape} and type {depth.dtype}", remedy)
    if focal is None:
        focal, source_note = found.focal, "its focal length is the depth tool's estimate"
    if focal is None:
        advice = "add camera.json beside it, or give its angle: --set depth.field_of_view=DEGREES"
        raise InputError(f"{name} does not say its focal length, nor does the depth tool", advice)
    if camera is None:
        camera = camera_from_focal_length(focal, size, f"{name}, {source_note}")
        recording = replace(recording, picture=Picture(recording.picture.file, rgb)).with_note(source_note)
    measured = RecordedDepth(depth, 1.0, f"the depth estimated for {name}", "the depth tool: it must give metres")
    noted = recording.with_note("depth was estimated from the colours alone, not measured")
    return assemble_frame(noted, camera, measured)


def _focal_length_with_source(
    recording: Recording, size: tuple[int, int], field_of_view: float | None
) -> tuple[float | None, str]:
    """The focal length in pixels of a picture of ``size``, and a note of where it was told."""
    if recording.camera is not None:
        return recording.camera.fx * size[0] / recording.camera.width, "camera.json"
    if field_of_view is not None:
        focal = size[0] / 2 / math.tan(math.radians(field_of_view) / 2)
        return focal, f"its focal length is that of depth.field_of_view = {field_of_view:g} degrees"
    film_mm = recording.picture.focal_35mm
    if film_mm is not None:
        return focal_length_from_35mm(film_mm, size), f"its focal length is EXIF's, {film_mm:g} mm on 35 mm film"
    return None, ""
