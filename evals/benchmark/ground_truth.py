"""Scenes with ground truth: a label for each pixel, and poses and boxes where known."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from evals.benchmark.ground_truth_bop import bop_objects
from grs_agents.base import Frozen, Quat, Vec3
from grs_agents.base.errors import InputError
from grs_agents.perception.image_geometry import Labels
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.reading.masks import read_masks
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
        """Returns: mask (H, W) of unlabelled pixels: those without depth, if no label covers any of them, as with
        labels that were made on the depth."""
        unmeasured = self.frame.depth <= 0
        return unmeasured & ~(self.labels[unmeasured] > 0).any()

    def ignored(self) -> frozenset[int]:
        """Labels of objects of which too little is seen to ask for them."""
        areas = np.bincount(self.labels.ravel(), minlength=1 + max((one.id for one in self.truth.objects), default=0))
        small = {label for label, area in enumerate(areas) if label and 0 < area < FEWEST_PIXELS}
        hidden = {one.id for one in self.truth.objects if areas[one.id] < LEAST_VISIBLE * (one.whole or 0)}
        return frozenset(small | hidden)


def read_labelled(source: Path) -> LabelledScene:
    """Read a scene folder that also holds ``labels.png`` (8 or 16 bit), perhaps ``robot.png``, ``walls.png`` and
    ``truth.json``; or a BOP image.

    Raises:
        InputError: the scene or its truth cannot be read, or their sizes differ.
    """
    frame = read_scene(source)
    if is_bop_source(source):
        return _bop_scene(source, frame)
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


def _bop_scene(source: Path, frame: RGBDFrame) -> LabelledScene:
    rows, columns = frame.depth.shape
    labels, told = read_masks(source, (rows, columns)), bop_objects(source)
    if len(told) != labels.max():  # it is not known which mask is whose
        return LabelledScene(short_scene_name(source), frame, labels)
    objects = tuple(
        TrueObject(id=number, visible=one["visible"], whole=one["whole"]) for number, one in enumerate(told, 1)
    )
    points = {number: one["points"] for number, one in enumerate(told, 1) if "points" in one}
    return LabelledScene(short_scene_name(source), frame, labels, Truth(objects=objects), points)


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


def labelled_folders(folder: Path) -> Sequence[Path]:
    """The scene folders with labels in a folder, or the folder itself, sorted by name.

    Raises:
        InputError: there is none.
    """
    found = sorted({file.parent for pattern in ("labels.png", "*/labels.png") for file in folder.glob(pattern)})
    if not found:
        raise InputError(
            f"{folder} holds no labelled scene", "name a folder of folders with rgb, depth, camera, labels"
        )
    return found
