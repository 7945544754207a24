"""The truth of an image of a BOP data set: visible masks, how much of each object is seen, poses of known models."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import is_folder, list_folder_names, path_exists, read_json
from grs_agents.perception.reading.bop import METRES_PER_MILLIMETRE, PREFIX, parse_bop_source
from grs_agents.perception.reading.point_cloud_files import read_ply
from grs_agents.perception.types import Array

MODELS = ("models_eval", "models", "models_cad", "models_reconst")
MOST_POINTS = 4000


def bop_sources(source: str, most: int) -> list[str]:
    """The images of ``bop:ROOT/SPLIT``, ``bop:ROOT/SPLIT/SCENE`` or ``bop:ROOT/SPLIT/SCENE/IMAGE``.

    Args:
        source: such a name.
        most: largest number of images, spread evenly.

    Raises:
        InputError: there is no image.
    """
    folder = Path(source.removeprefix(PREFIX))
    inner = [folder / name for name in list_folder_names(folder)] if is_folder(folder) else []
    scenes = [one for one in [folder, *inner] if is_folder(one) and path_exists(one / "scene_camera.json")]
    if not scenes:
        parse_bop_source(Path(source))
        return [source]
    images = [f"{PREFIX}{scene}/{int(number)}" for scene in scenes for number in sorted(_entries(scene), key=int)]
    if not images:
        raise InputError(f"{source} has no image", "name a split or a scene of a data set in the BOP format")
    chosen = np.unique(np.linspace(0, len(images) - 1, min(most, len(images))).round().astype(int))
    return [images[index] for index in chosen]


def bop_objects(source: Path) -> list[dict[str, Any]]:
    """For each object with visible pixels, in the order of its mask's number: ``visible``, ``whole``, ``points``.

    ``points`` are (N, 3) in the camera frame (m), of the object's model at its pose. Unknown values are left out;
    without ``scene_gt_info.json`` all are unknown.

    Raises:
        InputError: a file is not of the format.
    """
    image = parse_bop_source(source)
    shown = _listed(image.scene / "scene_gt_info.json", image.number)
    poses = _listed(image.scene / "scene_gt.json", image.number)
    objects: list[dict[str, Any]] = []
    for index, info in enumerate(shown):
        if not info.get("px_count_visib", 0):
            continue
        one: dict[str, Any] = {"visible": int(info["px_count_visib"]), "whole": int(info.get("px_count_all", 0))}
        if index < len(poses) and (points := _posed(image.scene, poses[index])) is not None:
            one["points"] = points
        objects.append(one)
    return objects


def _posed(scene: Path, pose: Mapping[str, Any]) -> Array | None:
    """The model's vertices at a pose, or ``None`` where there is no model."""
    root = scene.parent.parent
    name = f"obj_{int(pose.get('obj_id', 0)):06d}.ply"
    file = next((root / folder / name for folder in MODELS if path_exists(root / folder / name)), None)
    if file is None:
        return None
    rotation, shift = np.array(pose.get("cam_R_m2c"), np.float64), np.array(pose.get("cam_t_m2c"), np.float64)
    if rotation.shape != (9,) or shift.shape != (3,):
        raise InputError(f"{scene}/scene_gt.json has a pose of another form", "give cam_R_m2c and cam_t_m2c")
    points = np.asarray(read_ply(file)[0], np.float64)
    points = points[:: len(points) // MOST_POINTS + 1]
    return (points @ rotation.reshape(3, 3).T + shift) * METRES_PER_MILLIMETRE


def _entries(scene: Path) -> list[str]:
    file = scene / "scene_camera.json"
    return [key for key in _object(file) if key.isascii() and key.isdigit() and len(key) < 10]


def _listed(file: Path, number: int) -> Sequence[Mapping[str, Any]]:
    """The list of objects that a file of the scene has for an image; empty where there is none."""
    if not path_exists(file):
        return ()
    value = _object(file).get(str(number), [])
    if not isinstance(value, list) or not all(isinstance(one, dict) for one in cast(list[Any], value)):
        raise InputError(f"{file}: image {number} is no list of objects", "get the data set again")
    return cast(list[dict[str, Any]], value)


def _object(file: Path) -> dict[str, Any]:
    return read_json(file, "get the data set again")
