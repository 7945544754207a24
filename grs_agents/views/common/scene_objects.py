"""The objects of a scene as events tell them: number in the label picture, name, pose, asset.
The described scene can be shown as its assets where the photo shows them."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.spec import load_object_model

Rectangle = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""


def object_mask_label(item: dict[str, Any], index: int) -> int:
    """The pixel value of an object in the label picture: given, or its id, or its place in the list from 1."""
    for key in ("label", "id"):
        if isinstance(item.get(key), int):
            return item[key]
    return index + 1


def object_display_name(item: dict[str, Any]) -> str:
    """What an object is called, as well as is known."""
    return str(item.get("name") or item.get("description") or f"object {item.get('id', '')}")


def format_object_size(item: dict[str, Any], unknown: str = "") -> str:
    """The extents of an object's box in centimetres, e.g. ``4.0 x 4.0 x 4.0``; ``unknown`` where it has none."""
    if not item.get("box"):
        return unknown
    return " x ".join(f"{extent:.1f}" for extent in np.subtract(item["box"]["high"], item["box"]["low"]) * 100)


def mask_bounding_boxes(labels: npt.NDArray[Any]) -> dict[int, Rectangle]:
    """The box around each label of a label picture (H, W), 0 left out."""
    boxes: dict[int, Rectangle] = {}
    for label in np.flatnonzero(np.bincount(labels.ravel())):
        if label:
            left, top, width, height = cv2.boundingRect((labels == label).astype(np.uint8))
            boxes[int(label)] = (left, top, width, height)
    return boxes


def library_with_run_assets(folder: Path, library: Library) -> Library:
    """``library`` with the assets laid over that the run has made so far."""
    own = folder / "assets"
    return _overlay_run_assets(library, own, modification_time_ns(own / "manifest.json")) if own.is_dir() else library


@lru_cache(maxsize=2)
def _overlay_run_assets(library: Library, own: Path, _written: int) -> Library:
    """Kept, since reading a manifest takes longer than showing its assets."""
    return library.copy_with_overlay_root(own)


def modification_time_ns(file: Path) -> int:
    """When ``file`` was written last (ns), by which what was read of it can be kept; 0 where there is none."""
    return file.stat().st_mtime_ns if file.is_file() else 0


def build_twin_objects(objects: Sequence[dict[str, Any]], library: Library) -> list[InstanceObject]:
    """The matched objects of a scene's summary, where they came to rest in the twin if it says so."""
    objects_placed: list[InstanceObject] = []
    for item in objects:
        if item.get("asset") in library and item.get("position") and item.get("orientation") and "id" in item:
            x, y, z = item["position"]
            qx, qy, qz, qw = item["orientation"]
            pose = item.get("settled") or ((x, y, z), (qx, qy, qz, qw))
            try:
                placed = InstanceObject(id=int(item["id"]), asset=str(item["asset"]), pose=pose)
            except ValidationError:  # farther than a simulated scene reaches
                continue
            objects_placed.append(placed.model_copy(update={"pose": _pose_of_asset_origin(placed, library)}))
    return objects_placed


def _pose_of_asset_origin(item: InstanceObject, library: Library) -> Pose:
    """A scene tells where an asset's centre is; a world places its origin."""
    low, high = load_object_model(item, library).bounds
    middle = (np.array(low) + np.array(high)) / 2
    x, y, z = np.array(item.pose[0]) - matrix_from_quaternion(item.pose[1]) @ middle
    return ((float(x), float(y), float(z)), item.pose[1])
