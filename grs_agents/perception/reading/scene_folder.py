"""Reader of a scene folder: a photo, its depth as a picture, an array or a point cloud, and ``camera.json``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import read_npy
from grs_agents.base.foreign.files import list_folder_names, path_exists
from grs_agents.perception.reading import point_cloud as clouds
from grs_agents.perception.reading.camera import DepthUnit, read_camera_file
from grs_agents.perception.reading.frame_assembly import RecordedDepth, SceneRecording, Units, guess_depth_unit
from grs_agents.perception.reading.picture import SUFFIXES, read_color_picture, read_depth_picture
from grs_agents.perception.reading.point_cloud import Cloud, depth_from_cloud, read_point_cloud
from grs_agents.perception.reading.unread_formats import make_unread_format_error

COLOR_STEMS = ("rgb", "color")
NO_CLOUDS = ("masks", "labels")
IN_METRES = DepthUnit(1.0)  # of points, and of depth estimated by a model


def read_scene_folder(folder: Path) -> SceneRecording:
    """Read ``rgb.*``, ``camera.json``, and ``depth.*`` or a point cloud."""
    names = list_folder_names(folder)
    photo = _pick_single_name([name for name in names if _has_stem_and_suffix(name, COLOR_STEMS, SUFFIXES)], folder)
    if photo is None:
        raise _missing_photo_error(folder, names)
    picture = read_color_picture(folder / photo)
    depths = [name for name in names if _has_stem_and_suffix(name, ("depth",), (*SUFFIXES, ".npy"))]
    depths = depths or [name for name in names if _is_point_cloud_name(name)]
    depth_file = _pick_single_name(depths, folder)
    camera_file = folder / "camera.json"
    if depth_file is None:
        return add_camera_to_recording(SceneRecording(folder, picture), camera_file)
    return add_depth_to_recording(SceneRecording(folder, picture), folder / depth_file, camera_file)


def add_camera_to_recording(recording: SceneRecording, camera_file: Path) -> SceneRecording:
    """A recording without depth, with the camera of its photo if the file exists."""
    if not path_exists(camera_file):
        return recording
    read = read_camera_file(camera_file, IN_METRES)
    return replace(recording, camera=read.camera, notes=(*recording.notes, *read.notes))


def add_depth_to_recording(recording: SceneRecording, file: Path, camera_file: Path) -> SceneRecording:
    """The recording with the depth in ``file`` and the camera of both."""
    depth = read_depth_or_cloud(file)
    if isinstance(depth, Cloud):
        read = read_camera_file(camera_file, IN_METRES)
        units, note = depth_from_cloud(depth, read.camera)
        notes = (*read.notes, note)
    else:
        read = read_camera_file(camera_file, guess_depth_unit(depth))
        units, notes = depth, read.notes
    measured = RecordedDepth(units, read.camera.depth_scale, str(file))
    return replace(recording, camera=read.camera, measured=measured, notes=(*recording.notes, *notes))


def read_depth_or_cloud(file: Path) -> Cloud | Units:
    """Depth in the file's own unit, (H, W), or points."""
    if file.suffix.lower() in clouds.SUFFIXES and file.stem.lower() != "depth":
        return read_point_cloud(file)
    if file.suffix.lower() != ".npy":
        return read_depth_picture(file)
    array = read_npy(file)
    if array.ndim != 2 or array.dtype.kind == "b" or array.dtype == np.uint8:
        remedy = "give (H, W), metres as floats"
        raise InputError(f"{file} is an array of shape {array.shape} and type {array.dtype}", remedy)
    return array


def is_scene_file_name(name: str) -> bool:
    """Whether `read_scene_folder` may read a file of this name."""
    return (
        name == "camera.json"
        or _has_stem_and_suffix(name, (*COLOR_STEMS, "depth"), (*SUFFIXES, ".npy"))
        or _is_point_cloud_name(name)
    )


def _missing_photo_error(folder: Path, names: Sequence[str]) -> InputError:
    """Error for a folder without a photo of a known name; another picture may be the photo."""
    stems = ("depth", *NO_CLOUDS)
    others = [name for name in names if Path(name.lower()).suffix in SUFFIXES and Path(name.lower()).stem not in stems]
    unread = next(filter(None, (make_unread_format_error(folder / name) for name in names)), None)
    if not others and unread is not None:
        return unread
    if not others:
        return InputError(f"{folder / 'rgb.png'} does not exist", "put the photo there as rgb.png")
    shown = [f"{name[:60]!a}" for name in others[:4]]
    found = f"{folder / 'rgb.png'} does not exist, but {', '.join(shown)} {'is' if len(others) == 1 else 'are'} there"
    return InputError(found, f"if it is the photo, rename it to rgb{Path(others[0]).suffix.lower()}")


def _has_stem_and_suffix(name: str, stems: tuple[str, ...], suffixes: tuple[str, ...]) -> bool:
    path = Path(name.lower())
    return path.stem in stems and path.suffix in suffixes


def _is_point_cloud_name(name: str) -> bool:
    path = Path(name.lower())
    return path.suffix in clouds.SUFFIXES and path.stem not in NO_CLOUDS


def _pick_single_name(names: list[str], folder: Path) -> str | None:
    """The only name, ``None`` without any; raises InputError for several."""
    if len(names) > 1:
        remedy = "leave one of them"
        raise InputError(f"{folder} holds {' and '.join(names[:4])}: which of them is meant cannot be told", remedy)
    return names[0] if names else None
