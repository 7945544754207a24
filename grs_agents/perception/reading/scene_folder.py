"""Reader of a scene folder: a photo, its depth as a picture, an array or a point cloud, and the camera's file."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePath
from typing import NoReturn

import numpy as np

from grs_agents.base.config.schema import CameraConfig
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import list_npz_names, read_npy, read_npz
from grs_agents.base.foreign.files import list_folder_names, path_exists
from grs_agents.perception.reading import calibration_files, point_cloud
from grs_agents.perception.reading.bop import PREFIX, read_bop_image
from grs_agents.perception.reading.calibration_files import (
    SENSORS,
    Calibration,
    calibration_from_option,
    distinct_calibrations,
    read_values,
)
from grs_agents.perception.reading.camera import (
    KEYS,
    CameraFile,
    camera_from_calibration,
    choose_calibration,
    read_camera_file,
)
from grs_agents.perception.reading.depth_encoding import DepthUnit, Units, decode_sensor_format, guess_depth_unit
from grs_agents.perception.reading.frame_assembly import RecordedDepth, SceneRecording, have_same_aspect_ratio
from grs_agents.perception.reading.picture import COLOR_SUFFIXES, DEPTH_SUFFIXES, read_color_picture, read_depth_picture
from grs_agents.perception.reading.point_cloud import Cloud, depth_from_cloud, read_point_cloud
from grs_agents.perception.reading.scene_files import SceneFiles, find_scene_files, is_camera_name, is_point_cloud_name
from grs_agents.perception.reading.unread_formats import make_unread_format_error
from grs_agents.perception.types import Camera

IN_METRES = DepthUnit(1.0)  # of points, and of depth estimated by a model
_MOST_CAMERA_FILES = 40  # files of unknown names that are searched for intrinsics
_DEPTH_ARRAYS = ("depth", "depth_image", "depth_map", "arr_0", "data")
SCENE_SUFFIXES = (*COLOR_SUFFIXES, *DEPTH_SUFFIXES, *point_cloud.SUFFIXES, *calibration_files.SUFFIXES)
"""Suffixes of the files that `read_scene_folder` may open."""


def read_scene_folder(folder: Path, choice: str = "", hint: CameraConfig | None = None) -> SceneRecording:
    """Read a photo, its depth as a picture, an array or a point cloud, and the intrinsics of both.

    Args:
        folder: see `find_scene_files`.
        choice: the picture, if the folder holds several.
        hint: the user's statements on the camera, which prevail over the folder's.
    """
    hint = hint or CameraConfig()
    names = list_folder_names(folder)
    if "scene_camera.json" in names and choice:  # a scene of a BOP data set
        return replace(
            read_bop_image(Path(f"{PREFIX}{folder / choice}")), source=folder.with_name(f"{folder.name}:{choice}")
        )
    files = find_scene_files(folder, choice)
    if files is None:
        unread = next(filter(None, (make_unread_format_error(folder / name) for name in names)), None)
        raise unread or InputError(f"{folder / 'rgb.png'} does not exist", "put the photo there as rgb.png")
    source = folder if not choice else folder.with_name(f"{folder.name}:{choice}")
    return read_scene_files(source, folder, files, hint)


def read_scene_files(source: Path, folder: Path, files: SceneFiles, hint: CameraConfig) -> SceneRecording:
    """Read the files of a picture in ``folder``; ``source`` is the scene as the user names it."""
    recording = SceneRecording(source, read_color_picture(folder / files.photo))
    if files.depth is None:
        return _add_camera(recording, folder, files, hint)
    return _add_depth(recording, folder, files, files.depth, hint)


def _add_camera(recording: SceneRecording, folder: Path, files: SceneFiles, hint: CameraConfig) -> SceneRecording:
    """A recording without depth, with the camera of its photo if it is known."""
    read = _find_camera(folder, files, recording.picture_size, hint, IN_METRES)
    if read is None:
        return recording
    return replace(recording, camera=read.camera, notes=(*recording.notes, *read.notes))


def add_camera_to_recording(recording: SceneRecording, camera_file: Path, hint: CameraConfig) -> SceneRecording:
    """A recording without depth, with the camera of its photo if the file exists or the user stated it."""
    cameras = ((PurePath(camera_file.name),),) if path_exists(camera_file) else ()
    return _add_camera(
        recording, camera_file.parent, SceneFiles(PurePath(recording.source.name), None, cameras, ""), hint
    )


def _add_depth(
    recording: SceneRecording, folder: Path, files: SceneFiles, depth_path: PurePath, hint: CameraConfig
) -> SceneRecording:
    """The recording with its depth and the camera of both."""
    file = folder / depth_path
    depth = _read_depth_or_cloud(file)
    size, notes = recording.picture_size, list(recording.notes)
    if isinstance(depth, Cloud):
        read = _find_camera(folder, files, size, hint, IN_METRES) or _missing_camera(folder, files)
        units, cloud_note = depth_from_cloud(depth, read.camera)
        notes += [*read.notes, cloud_note]
        unit_note = "points in metres"
    else:
        units, stated, encoding = depth, hint.depth_scale, ""
        if stated is None:
            units, stated, encoding = decode_sensor_format(depth)
        unit = guess_depth_unit(units) if stated is None else DepthUnit(stated)
        read = _find_camera(folder, files, size, hint, unit, units) or _missing_camera(folder, files)
        if hint.depth_scale is None and read.states_scale:  # then the values are what the file says
            units, stated, encoding = depth, None, ""
        if stated is not None:  # by the user or the sensor format
            read = replace(read, camera=read.camera.model_copy(update={"depth_scale": stated}))
        notes += read.notes
        depth_size = (units.shape[1], units.shape[0])
        if not have_same_aspect_ratio(size, depth_size):
            calibration = _find_depth_calibration(folder, files, depth_size)
            if calibration is not None and (read.camera.width, read.camera.height) == size:
                units = _resample_to_color(units, calibration, read.camera)
                notes.append(f"depth of {depth_size[0]}x{depth_size[1]} pixels was resampled by {calibration.source}")
        scale = read.camera.depth_scale
        unit_note = encoding or ("metres" if scale == 1 else f"{scale:g} m a unit")
    alone = recording.source == folder / files.photo  # named without its depth
    if alone or not files.has_standard_names or (read.taken and files.cameras != ((PurePath("camera.json"),),)):
        taken = read.taken or "camera.json"
        notes.insert(0, f"photo {files.photo}, depth {depth_path} ({unit_note}), camera {taken}")
    measured = RecordedDepth(units, read.camera.depth_scale, str(file))
    return replace(
        recording,
        camera=read.camera,
        measured=measured,
        notes=tuple(notes),
        distortion=read.distortion,
        rectified=hint.rectified,
    )


def _find_depth_calibration(folder: Path, files: SceneFiles, size: tuple[int, int]) -> Calibration | None:
    """The only camera that a file names after depth, or gives for a picture of ``size`` (width, height)."""
    distinct: list[Calibration] = []
    for path in [path for group in files.cameras for path in group][:_MOST_CAMERA_FILES]:
        with suppress(InputError):
            for each in distinct_calibrations(read_values(folder / path), str(path)):
                if ("depth" in each.source.lower() and each.size in (None, size)) or each.size == size:
                    distinct += [] if any(each.is_same_camera(earlier) for earlier in distinct) else [each]
    return distinct[0] if len(distinct) == 1 else None


def _resample_to_color(units: Units, calibration: Calibration, camera: Camera) -> Units:
    """Depth (h, w) at the pixels of a colour camera (H, W) of the same center, by the nearest pixel; 0 outside."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx * calibration.fx + calibration.cx
    y = (np.arange(camera.height) - camera.cy) / camera.fy * calibration.fy + calibration.cy
    columns, rows = np.rint(x).astype(int), np.rint(y).astype(int)
    height, width = units.shape
    inside = ((rows >= 0) & (rows < height))[:, None] & ((columns >= 0) & (columns < width))
    sampled = units[np.ix_(np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1))]
    return np.where(inside, sampled, units.dtype.type(0))


def _missing_camera(folder: Path, files: SceneFiles) -> NoReturn:
    """Raise the error for a picture with depth and without intrinsics."""
    looked = ", ".join(str(path) for group in files.cameras for path in group[:4])
    searched = f" ({looked[:200]}: no intrinsics)" if looked else ""
    raise InputError(
        f"{folder / 'camera.json'} does not exist, and no other file states the camera's intrinsics{searched}",
        f"put camera.json there, with {KEYS}; or give --camera FX,FY,CX,CY, or --camera SENSOR: {', '.join(SENSORS)}",
    )


def _read_depth_or_cloud(file: Path) -> Cloud | Units:
    """Depth in the file's own unit, (H, W), or points."""
    suffix = file.suffix.lower()
    if suffix in point_cloud.SUFFIXES and is_point_cloud_name(file.name):
        return read_point_cloud(file)
    if suffix not in (".npy", ".npz"):
        return read_depth_picture(file)
    if suffix == ".npy":
        array = read_npy(file)
    else:
        names = list_npz_names(file)
        likely = [name for name in _DEPTH_ARRAYS if name in names] or names
        if not likely or (len(names) > 1 and likely == names):
            held = ", ".join(name[:40] for name in names[:6]) or "nothing"
            raise InputError(f"{file} holds {held}: which of them is depth cannot be told", "name it depth")
        array = read_npz(file, {likely[0]: "(H, W)"}, {})[likely[0]]
    array = array[0] if array.ndim == 3 and array.shape[0] == 1 else array
    array = array[..., 0] if array.ndim == 3 and array.shape[2] == 1 else array
    if array.ndim != 2 or array.dtype.kind == "b" or array.dtype == np.uint8:
        remedy = "give (H, W), metres as floats"
        raise InputError(f"{file} is an array of shape {array.shape} and type {array.dtype}", remedy)
    return array


def _find_camera(
    folder: Path,
    files: SceneFiles,
    size: tuple[int, int],
    hint: CameraConfig,
    unit: DepthUnit,
    units: Units | None = None,
) -> CameraFile | None:
    """The camera as the user states it, else of the likeliest file with intrinsics; ``None`` without any.

    Raises:
        InputError: a file named like the camera's is damaged, or the likeliest files state different cameras.
    """
    if hint.intrinsics is not None:
        return camera_from_calibration(calibration_from_option(hint.intrinsics, size), size, unit, units)
    for group in files.cameras:
        distinct: list[Calibration] = []
        damaged: InputError | None = None
        holder = group[0]
        for path in group[:_MOST_CAMERA_FILES]:
            if path == PurePath("camera.json"):
                return read_camera_file(folder / path, unit, size, units)
            try:
                found = distinct_calibrations(read_values(folder / path), str(path))
            except InputError as error:
                damaged = damaged or error
                continue
            holder = path if found and not distinct else holder
            distinct += [each for each in found if not any(each.is_same_camera(earlier) for earlier in distinct)]
        if len(distinct) > 1:
            distinct = [choose_calibration(distinct, size, str(folder))]
            holder = PurePath(distinct[0].source.split(": ")[0])
        if distinct:
            return read_camera_file(folder / holder, unit, size, units)
        if damaged is not None and is_camera_name(group[0]):
            raise damaged
    return None
