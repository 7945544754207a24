"""A scene folder: a photo, its depth as a picture, an array or a point cloud, and ``camera.json``."""

from pathlib import Path

import numpy as np

from grs_agents.errors import InputError
from grs_agents.scene.frame import Camera
from grs_agents.scene.reading import cloud as clouds
from grs_agents.scene.reading.arrays import read_npy
from grs_agents.scene.reading.camera import read_camera
from grs_agents.scene.reading.cloud import Cloud, depth_of, read_cloud
from grs_agents.scene.reading.depth import Measured, Units
from grs_agents.scene.reading.files import exists, names_in
from grs_agents.scene.reading.fit import Recording
from grs_agents.scene.reading.picture import SUFFIXES, read_color, read_units

COLOR_STEMS = ("rgb", "color")
NO_CLOUDS = ("masks", "labels")
METRE = 1.0


def read_folder(folder: Path) -> Recording:
    """Read ``rgb.*``, ``camera.json``, and ``depth.*`` or a point cloud.

    Raises:
        InputError: a file is missing or twice there, or cannot be read.
    """
    names = names_in(folder)
    photos = [name for name in names if _is(name, COLOR_STEMS, SUFFIXES)]
    picture = read_color(folder / (_only(photos, folder) or "rgb.png"))
    depths = [name for name in names if _is(name, ("depth",), (*SUFFIXES, ".npy"))]
    depths = depths or [name for name in names if _is_cloud(name)]
    depth_file = _only(depths, folder)
    camera_file = folder / "camera.json"
    if depth_file is None:
        camera = read_camera(camera_file, METRE) if exists(camera_file) else None
        return Recording(folder, picture, camera)
    return with_depth(Recording(folder, picture), folder / depth_file, camera_file)


def with_depth(recording: Recording, file: Path, camera_file: Path) -> Recording:
    """The recording with the depth in ``file`` and the camera of both.

    Raises:
        InputError: one of the files cannot be read.
    """
    depth = read_depth(file)
    if isinstance(depth, Cloud):
        camera = read_camera(camera_file, METRE)
        units, how = depth_of(depth, camera)
        return _measured(recording, camera, units, file).noting(how)
    camera = read_camera(camera_file, METRE if depth.dtype.kind == "f" else None)
    return _measured(recording, camera, depth, file)


def read_depth(file: Path) -> Cloud | Units:
    """Depth in the file's own unit, (H, W), or points.

    Raises:
        InputError: it cannot be read.
    """
    if file.suffix.lower() in clouds.SUFFIXES and file.stem.lower() != "depth":
        return read_cloud(file)
    if file.suffix.lower() != ".npy":
        return read_units(file)
    array = read_npy(file)
    if array.ndim != 2 or array.dtype.kind == "b" or array.dtype == np.uint8:
        raise InputError(
            f"{file} is an array of shape {array.shape} and type {array.dtype}", "give (H, W), metres as floats"
        )
    return array


def _measured(recording: Recording, camera: Camera, units: Units, file: Path) -> Recording:
    measured = Measured(units, camera.depth_scale, str(file))
    return Recording(recording.source, recording.picture, camera, measured, recording.notes)


def _is(name: str, stems: tuple[str, ...], suffixes: tuple[str, ...]) -> bool:
    path = Path(name.lower())
    return path.stem in stems and path.suffix in suffixes


def _is_cloud(name: str) -> bool:
    path = Path(name.lower())
    return path.suffix in clouds.SUFFIXES and path.stem not in NO_CLOUDS


def _only(names: list[str], folder: Path) -> str | None:
    """The one name there is.

    Raises:
        InputError: there are several.
    """
    if len(names) > 1:
        raise InputError(
            f"{folder} holds {' and '.join(names[:4])}: which of them is meant cannot be told", "leave one of them"
        )
    return names[0] if names else None
