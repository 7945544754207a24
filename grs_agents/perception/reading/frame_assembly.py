"""Frame assembly: colour, depth in metres and camera on the pixel grid of the colour picture."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.perception.image_geometry import depth_in_metres
from grs_agents.perception.reading.camera import DEPTH_SCALE_REMEDY, scale_camera_to_size
from grs_agents.perception.reading.depth_encoding import (
    FARTHEST,
    MILLIMETRE,
    NEAREST,
    Depth,
    Units,
    convert_ray_distance,
    list_measured_rays,
    measure_plane_share,
)
from grs_agents.perception.reading.lens_distortion import LensDistortion, rectification_map, rectify_picture
from grs_agents.perception.reading.picture import ColorPicture, rotate_by_exif
from grs_agents.perception.types import Camera, Image, RGBDFrame

Scalar = TypeVar("Scalar", bound=np.generic)

LEAST_MEASURED = 0.02  # at least this share of the pixels must have a depth
LEAST_RELIEF = 0.02  # metres between nearest and farthest point of a table with objects: they are at least 2 cm
BEYOND = 65.0  # metres; farther depth is dropped, which also keeps it within 16 bits of millimetres
JUMP = 0.03  # relative depth difference of neighbouring pixels on different surfaces


@dataclass(frozen=True)
class RecordedDepth:
    """A depth picture as it was recorded."""

    units: Units  # (H, W), 0, NaN, infinite, negative or the type's largest number where nothing was measured
    scale: float  # metres per unit
    where: str  # its name in errors
    scale_source: str = "depth_scale in camera.json"  # origin of its scale, for the remedy of a wrong scale


def convert_depth_to_metres(measured: RecordedDepth) -> Depth:
    """(H, W) float32 metres, 0 where nothing was measured."""
    units, scale, where = measured.units, measured.scale, measured.where
    with np.errstate(over="ignore", invalid="ignore"):  # a forged file's numbers may leave the range
        depth = depth_in_metres(units, scale)
        valid = np.isfinite(depth) & (depth > 0)
    if units.dtype.kind in "ui":
        valid &= units != np.iinfo(units.dtype.name).max  # saturated
    measured_at = depth[valid]
    if measured_at.size < LEAST_MEASURED * depth.size:
        needed = f"at least {LEAST_MEASURED:.0%} are needed"
        found = f"{where} has a depth at {measured_at.size} of {depth.size} pixels, {needed}"
        raise InputError(found, "record the depth again")
    median = float(np.median(measured_at, overwrite_input=True))
    if not NEAREST <= median <= FARTHEST:
        problem = (
            f"{where}: depth_scale {scale:g} gives a median depth of {median:g} m, outside {NEAREST}..{FARTHEST} m"
        )
        # The reciprocal of a scale given in units per metre (Open3D, ROS), then the scales of common sensors.
        likely = [(1 / scale, f"depth_scale {1 / scale:g} (1 / {scale:g})")] if scale > 1 else []
        likely += [(usual, f"depth_scale {usual:g}") for usual in (MILLIMETRE, 1.0, 0.0001, 0.0002)]
        for factor, name in likely:
            if NEAREST <= median / scale * factor <= FARTHEST:
                remedy = f"with {name} it would be {median / scale * factor:.4g} m: correct {measured.scale_source}"
                raise InputError(problem, remedy)
        raise InputError(problem, f"{DEPTH_SCALE_REMEDY}: correct {measured.scale_source}")
    if units.dtype.kind == "f" and scale == 1 and float(measured_at.max()) <= 1:
        low, high = (float(value) for value in np.percentile(measured_at, (1, 99)))
        if low > 0.5 and 0 < high - low < LEAST_RELIEF:  # OpenGL's z-buffer: 0 at the near plane, 1 at the far plane
            raise InputError(
                f"{where} hardly varies ({low:.4g}..{high:.4g}) and lies in 0..1: it looks like a z-buffer",
                "give metres along the optical axis: near * far / (far - value * (far - near))",
            )
    depth[~valid | (depth > BEYOND)] = 0
    return depth


def have_same_aspect_ratio(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two picture sizes (width, height) have the same aspect ratio, to a pixel of the smaller picture."""
    (width, height), (other_width, other_height) = sorted((size, other))
    return abs(other_width / width - other_height / height) * max(width, height) <= other_width / width


def resize_depth(depth: Depth, width: int, height: int) -> Depth:
    """Depth resampled to another size without flying pixels.

    Smaller by the nearest pixel. Larger by interpolation of inverse depth, which is exact on planes, between four
    neighbours on the same surface, and by the nearest pixel elsewhere."""
    nearest = resize_nearest(depth, width, height)
    if width <= depth.shape[1]:
        return nearest
    inverse = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    corners = np.stack([inverse[:-1, :-1], inverse[:-1, 1:], inverse[1:, :-1], inverse[1:, 1:]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    same_surface = (low > 0) & (high <= low * (1 + JUMP))
    rows, columns = _preceding_pixel_indices(depth.shape[0], height), _preceding_pixel_indices(depth.shape[1], width)
    blend = cv2.resize(inverse, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.where(same_surface[np.ix_(rows, columns)], 1 / np.maximum(blend, np.float32(1e-6)), nearest)


def resize_nearest(picture: "npt.NDArray[Scalar]", width: int, height: int) -> "npt.NDArray[Scalar]":
    """A picture (H, W) at another size, by the nearest pixel."""
    rows = _resampled_pixel_centers(picture.shape[0], height)
    columns = _resampled_pixel_centers(picture.shape[1], width)
    return picture[np.ix_(np.rint(rows).astype(int), np.rint(columns).astype(int))]


def _resampled_pixel_centers(old: int, new: int) -> npt.NDArray[np.float64]:
    """(new,) pixel coordinates, among ``old`` pixels, of the centres of ``new`` pixels; clamped to the picture."""
    return np.clip((np.arange(new) + 0.5) * old / new - 0.5, 0, old - 1)


def _preceding_pixel_indices(old: int, new: int) -> npt.NDArray[np.int64]:
    """(new,) index of the pixel before each of these coordinates; its successor is in the picture too."""
    return np.minimum(np.floor(_resampled_pixel_centers(old, new)).astype(np.int64), old - 2)


MOST_FRAME_PIXELS = 9_000_000
"""Larger frames (4K has 8.8 million pixels) are reduced: objects of 2 cm remain visible."""
IGNORED_DISTORTION = 1.0  # px; calibrations are hardly better
SMALLEST = 8  # least pixels a side of a frame


@dataclass(frozen=True)
class SceneRecording:
    """Colour, depth and camera of a scene as read, not yet on the same pixel grid."""

    source: Path  # as named on the command line
    picture: ColorPicture  # the colours
    camera: Camera | None = None  # of the colour or of the depth picture, whichever has its size
    measured: RecordedDepth | None = None  # the depth
    notes: tuple[str, ...] = ()  # on the reading of the scene
    distortion: LensDistortion | None = None  # of the lens that `camera` belongs to
    rectified: bool | None = None  # whether colour and depth are rectified already, if the user said so

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of the colour picture."""
        height, width = self.picture.rgb.shape[:2]
        return width, height

    def with_note(self, note: str) -> "SceneRecording":
        """A copy with another note."""
        return replace(self, notes=(*self.notes, note))


def assemble_frame(recording: SceneRecording, camera: Camera, measured: RecordedDepth) -> RGBDFrame:
    """Put colour, depth and camera on the colour picture's grid."""
    height, width = measured.units.shape
    if min(*recording.picture_size, width, height) < SMALLEST:
        found = (
            f"{recording.picture.file} is {'x'.join(map(str, recording.picture_size))} and its depth {width}x{height}"
        )
        raise InputError(found, f"give pictures of at least {SMALLEST} pixels a side")
    recording = apply_exif_orientation(recording, [(camera.width, camera.height), (width, height)])
    size, file = recording.picture_size, recording.picture.file
    if not have_same_aspect_ratio(size, (width, height)):
        found = f"{measured.where} is {width}x{height} but {file} is {size[0]}x{size[1]}, of another shape"
        raise InputError(found, "register depth to colour, or crop both to the same view")
    if (camera.width, camera.height) not in (size, (width, height)):
        remedy = "give the size, and the numbers that belong to it, of the colour or of the depth picture"
        raise InputError(f"{file} is {size[0]}x{size[1]} but camera.json says {camera.width}x{camera.height}", remedy)
    depth, rgb = convert_depth_to_metres(measured), recording.picture.rgb
    target = limit_frame_size(*size)
    if size != (width, height):
        recording = recording.with_note(f"depth of {width}x{height} pixels was brought to {target[0]}x{target[1]}")
    if target != size:
        recording = recording.with_note(
            f"the photo of {size[0]}x{size[1]} pixels was made smaller, {target[0]}x{target[1]}"
        )
        rgb = downscale_rgb(rgb, *target)
    if target != (width, height):
        depth = resize_depth(depth, *target)
    depth_scale = measured.scale if measured.units.dtype == np.uint16 else MILLIMETRE  # as a 16-bit picture holds it
    camera = scale_camera_to_size(camera, *target).model_copy(update={"depth_scale": depth_scale})
    if recording.distortion is not None:
        rgb, depth, note = _rectify(rgb, depth, camera, recording.distortion, recording.rectified)
        recording = recording.with_note(note)
    depth, note = convert_ray_distance(depth, camera.intrinsics, measured.where)
    recording = recording.with_note(note) if note else recording
    return RGBDFrame(rgb, depth, camera, recording.source, recording.notes)


def _rectify(
    rgb: Image, depth: Depth, camera: Camera, lens: LensDistortion, rectified: bool | None
) -> tuple[Image, Depth, str]:
    """Colour and depth of a pinhole camera, with a note; unchanged if they are rectified already.

    If the user did not say which, planes decide: the reading under which the largest plane has more pixels.
    """
    at = rectification_map(camera, lens)
    moved = float(np.abs(at - np.indices(depth.shape)[::-1].transpose(1, 2, 0)).max())
    if moved < IGNORED_DISTORTION:
        return rgb, depth, f"the lens distorts by at most {moved:.1f} px, which is ignored"
    straight = np.asarray(rectify_picture(depth, at, interpolate=False), np.float32)
    reason = "as the camera's settings say"
    if rectified is None:
        before, after = (measure_plane_share(*list_measured_rays(picture, camera)) for picture in (depth, straight))
        rectified = after <= before
        reason = f"its largest plane has {before:.1%} of the pixels as rectified, {after:.1%} as raw"
    if rectified:
        return rgb, depth, f"colour and depth were taken as rectified: {reason}"
    rgb = np.asarray(rectify_picture(rgb, at, interpolate=True), np.uint8)
    return rgb, straight, f"colour and depth were rectified, by up to {moved:.0f} px: {reason}"


def apply_exif_orientation(recording: SceneRecording, sizes: Sequence[tuple[int, int]]) -> SceneRecording:
    """Rotate a photo by its EXIF orientation if camera and depth belong to the rotated photo.

    ``sizes`` are width and height of camera and depth; without any the photo is rotated."""
    picture = recording.picture
    if picture.orientation == 1:
        return recording
    rgb = rotate_by_exif(picture.rgb, picture.orientation)
    as_shown = all(have_same_aspect_ratio(size, (rgb.shape[1], rgb.shape[0])) for size in sizes)
    if sizes and as_shown and all(have_same_aspect_ratio(size, recording.picture_size) for size in sizes):
        raise InputError(
            f"{picture.file} has EXIF orientation {picture.orientation}: whether the camera's numbers are those of the "
            "stored or of the turned picture cannot be told",
            "save it as its pixels are to be looked at, without that tag",
        )
    return replace(recording, picture=ColorPicture(picture.file, rgb, 1, picture.focal_35mm)) if as_shown else recording


def limit_frame_size(width: int, height: int) -> tuple[int, int]:
    """The size, reduced to at most `MOST_FRAME_PIXELS` at the same aspect ratio."""
    share = (MOST_FRAME_PIXELS / (width * height)) ** 0.5
    return (width, height) if share >= 1 else (int(width * share), int(height * share))


def downscale_rgb(rgb: Image, width: int, height: int) -> Image:
    """The picture reduced by averaging over areas."""
    return np.asarray(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
