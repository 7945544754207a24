"""Scenes with ground truth: a label for each pixel, poses and boxes if known; images of BOP data sets."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from grs_agents.base import Frozen, Quat, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import is_folder, list_folder_names, path_exists, read_json
from grs_agents.perception.image_geometry import Labels
from grs_agents.perception.reading.bop import METRES_PER_MILLIMETRE, PREFIX, is_bop_source, parse_bop_source
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.point_cloud_files import read_ply
from grs_agents.perception.reading.scene_source import read_scene, short_scene_name
from grs_agents.perception.types import Aabb, Array, Mask, RGBDFrame

FEWEST_PIXELS = 100
LEAST_VISIBLE = 0.1
"""Visible pixels and visible share below which an object need not be found, as in pose data sets."""


class TrueObject(Frozen):
    """An object of a labelled scene; unknown values are ``None``.

    Attributes:
        id: its label in ``labels.png``.
        asset: library name; empty if the library lacks it or it is unknown.
        absent: the library certainly lacks it.
        kind: a word for it; empty if unknown.
        position: centre of its frame, m, robot frame.
        orientation: xyzw.
        yaw: of an upright object, rad, in place of ``orientation``.
        box: axis-aligned, robot frame.
        visible: visible pixels.
        whole: pixels visible without occlusion.
    """

    id: int
    asset: str = ""
    absent: bool = False
    kind: str = ""
    position: Vec3 | None = None
    orientation: Quat | None = None
    yaw: float | None = None
    box: Aabb | None = None
    visible: int | None = None
    whole: int | None = None

    @property
    def rotation(self) -> Quat | None:
        """Its orientation, from ``yaw`` where that alone is given."""
        if self.orientation is None and self.yaw is not None:
            return (0.0, 0.0, float(np.sin(self.yaw / 2)), float(np.cos(self.yaw / 2)))
        return self.orientation


class Truth(Frozen):
    """``truth.json`` of a scene folder.

    Attributes:
        objects: of the scene.
        sensor: noise model of its depth; empty for a real sensor.
        tilt: downward tilt of the camera, degrees.
        seed: of a synthesised scene.
    """

    objects: tuple[TrueObject, ...] = ()
    sensor: str = ""
    tilt: float | None = None
    seed: int | None = None


@dataclass(frozen=True)
class LabelledScene:
    """A frame with its truth.

    Attributes:
        name: for tables.
        frame: the photo with depth.
        labels: (H, W), 0 = background.
        truth: of the objects, as far as known.
        points: (N, 3) of the true surface of objects by label, m, camera frame; if poses are given in that frame.
        fixed: (H, W) mask of the robot and of bin walls, which are no objects; ``None`` if unknown.
    """

    name: str
    frame: RGBDFrame
    labels: Labels
    truth: Truth = field(default_factory=Truth)
    points: Mapping[int, Array] = field(default_factory=dict[int, Array])
    fixed: Mask | None = None

    @property
    def unlabelled(self) -> Mask:
        """Returns: mask (H, W) of unlabelled pixels: pixels without depth, if labels were made on the depth and cover
        none of them."""
        unmeasured = self.frame.depth <= 0
        return unmeasured & ~(self.labels[unmeasured] > 0).any()

    def ignored(self) -> frozenset[int]:
        """Labels of objects with too few visible pixels to be required."""
        areas = np.bincount(self.labels.ravel(), minlength=1 + max((item.id for item in self.truth.objects), default=0))
        small = {label for label, area in enumerate(areas) if label and 0 < area < FEWEST_PIXELS}
        hidden = {item.id for item in self.truth.objects if areas[item.id] < LEAST_VISIBLE * (item.whole or 0)}
        return frozenset(small | hidden)


def read_labelled(source: Path) -> LabelledScene:
    """Read a scene folder that also holds ``labels.png`` (8 or 16 bit), perhaps ``robot.png``, ``walls.png`` and
    ``truth.json``; or a BOP image.

    Raises:
        InputError: the scene or its truth cannot be read, or their sizes differ.
    """
    frame = read_scene(source)
    if is_bop_source(source):
        rows, columns = frame.depth.shape
        labels, infos = read_masks(source, (rows, columns)).labels, bop_objects(source)
        if len(infos) != labels.max():  # it is not known which mask is whose
            return LabelledScene(short_scene_name(source), frame, labels)
        objects = tuple(
            TrueObject(id=number, visible=info["visible"], whole=info["whole"]) for number, info in enumerate(infos, 1)
        )
        points = {number: info["points"] for number, info in enumerate(infos, 1) if "points" in info}
        return LabelledScene(short_scene_name(source), frame, labels, Truth(objects=objects), points)
    labels = _read_picture(source / "labels.png", frame).astype(np.int32)
    masks = [file for file in (source / "robot.png", source / "walls.png") if file.is_file()]
    fixed = np.logical_or.reduce([_read_picture(file, frame) > 0 for file in masks]) if masks else None
    return LabelledScene(short_scene_name(source), frame, labels, read_truth(source / "truth.json"), fixed=fixed)


def _read_picture(file: Path, frame: RGBDFrame) -> npt.NDArray[Any]:
    """A single-channel picture (H, W) of the photo's size."""
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.is_file() else None
    if image is None or image.ndim != 2 or image.dtype.name not in ("uint8", "uint16"):
        raise InputError(f"{file} is no picture of labels", "write one channel of 8 or 16 bits, 0 = background")
    if image.shape != frame.depth.shape:
        raise InputError(f"{file} has shape {image.shape}, the photo {frame.depth.shape}", "give both one size")
    return np.asarray(image)


def read_truth(file: Path) -> Truth:
    """Read ``truth.json``; nothing is known where there is none.

    Raises:
        InputError: it cannot be read or does not fit.
    """
    try:
        value: Any = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        return Truth.model_validate(cast(dict[str, Any], value))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{file}: {where}: {first['msg']}", "correct it, or leave it out") from error
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot read {file}: {error}", "correct it, or leave it out") from error


def scene_folders(places: Iterable[Path]) -> list[Path]:
    """The scene folders among places and in them, sorted for each place.

    Raises:
        InputError: a place has none.
    """
    scenes: list[Path] = []
    for place in places:
        folders = sorted(file.parent for file in [*place.glob("camera.json"), *place.glob("*/camera.json")])
        if not folders:
            raise InputError(f"{place} holds no scene", "name a scene folder, or a folder of scene folders")
        scenes += folders
    return scenes


def labelled_folders(folder: Path) -> Sequence[Path]:
    """The scene folders with labels in a folder, or the folder itself, sorted by name.

    Raises:
        InputError: there is none.
    """
    folders = sorted({file.parent for pattern in ("labels.png", "*/labels.png") for file in folder.glob(pattern)})
    if not folders:
        raise InputError(
            f"{folder} holds no labelled scene", "name a folder of folders with rgb, depth, camera, labels"
        )
    return folders


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
    scenes = [path for path in [folder, *inner] if is_folder(path) and path_exists(path / "scene_camera.json")]
    if not scenes:
        parse_bop_source(Path(source))
        return [source]
    images: list[str] = []
    for scene in scenes:
        keys = _object(scene / "scene_camera.json")
        numbers = sorted((key for key in keys if key.isascii() and key.isdigit() and len(key) < 10), key=int)
        images += [f"{PREFIX}{scene}/{int(number)}" for number in numbers]
    if not images:
        raise InputError(f"{source} has no image", "name a split or a scene of a data set in the BOP format")
    chosen = np.unique(np.linspace(0, len(images) - 1, min(most, len(images))).round().astype(int))
    return [images[index] for index in chosen]


def bop_objects(source: Path) -> list[dict[str, Any]]:
    """``visible``, ``whole`` and ``points`` of each object with visible pixels, in the order of its mask's number.

    ``points`` are (N, 3) in the camera frame (m), of the object's model at its pose. Unknown values are left out;
    without ``scene_gt_info.json`` all are unknown.

    Raises:
        InputError: a file is not of the format.
    """
    image = parse_bop_source(source)
    shown = _image_objects(image.scene / "scene_gt_info.json", image.number)
    poses = _image_objects(image.scene / "scene_gt.json", image.number)
    objects: list[dict[str, Any]] = []
    for index, info in enumerate(shown):
        if not info.get("px_count_visib", 0):
            continue
        entry: dict[str, Any] = {"visible": int(info["px_count_visib"]), "whole": int(info.get("px_count_all", 0))}
        if index < len(poses) and (points := _posed(image.scene, poses[index])) is not None:
            entry["points"] = points
        objects.append(entry)
    return objects


def _posed(scene: Path, pose: Mapping[str, Any]) -> Array | None:
    """The model's vertices at a pose; ``None`` without a model."""
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


def _image_objects(file: Path, number: int) -> Sequence[Mapping[str, Any]]:
    """The objects of an image in a file of the scene; empty if the file does not exist."""
    if not path_exists(file):
        return ()
    value = _object(file).get(str(number), [])
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in cast(list[Any], value)):
        raise InputError(f"{file}: image {number} is no list of objects", "get the data set again")
    return cast(list[dict[str, Any]], value)


def _object(file: Path) -> dict[str, Any]:
    return read_json(file, "get the data set again")
