"""Scene objects from events: mask label, display name, size, bounding box, and pose in the simulated twin."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.spec import load_object_model

Rectangle = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""


def object_mask_label(item: dict[str, Any], index: int) -> int:
    """The object's pixel value in the label image: its ``label``, else its ``id``, else its list position from 1."""
    for key in ("label", "id"):
        if isinstance(item.get(key), int):
            return item[key]
    return index + 1


def object_display_name(item: dict[str, Any]) -> str:
    """The object's name, description or id."""
    return str(item.get("name") or item.get("description") or f"object {item.get('id', '')}")


def format_object_size(item: dict[str, Any], unknown: str = "") -> str:
    """The extents of an object's box in centimetres, e.g. ``4.0 x 4.0 x 4.0``; ``unknown`` without a box."""
    if not item.get("box"):
        return unknown
    return " x ".join(f"{extent:.1f}" for extent in np.subtract(item["box"]["high"], item["box"]["low"]) * 100)


def mask_bounding_boxes(labels: npt.NDArray[Any]) -> dict[int, Rectangle]:
    """Bounding box of each label of a label image (H, W); 0 is the background."""
    boxes: dict[int, Rectangle] = {}
    for label in np.flatnonzero(np.bincount(labels.ravel())):
        if label:
            left, top, width, height = cv2.boundingRect((labels == label).astype(np.uint8))
            boxes[int(label)] = (left, top, width, height)
    return boxes


def library_with_run_assets(folder: Path, library: Library) -> Library:
    """``library`` overlaid with the assets that the run has built so far."""
    assets = folder / "assets"
    if not assets.is_dir():
        return library
    return _overlay_run_assets(library, assets, modification_time_ns(assets / "manifest.json"))


@lru_cache(maxsize=2)
def _overlay_run_assets(library: Library, assets: Path, _modified: int) -> Library:
    """Cached, since reading a manifest takes longer than drawing its assets."""
    return library.copy_with_overlay_root(assets)


def modification_time_ns(file: Path) -> int:
    """Modification time of ``file`` (ns) as a cache key; 0 without the file."""
    return file.stat().st_mtime_ns if file.is_file() else 0


def build_twin_objects(objects: Sequence[dict[str, Any]], library: Library) -> list[InstanceObject]:
    """The matched objects of a scene summary, at their settled poses in the twin where known."""
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
            # events give the pose of the asset's centre, a world places its origin
            (center, quaternion), (low, high) = placed.pose, load_object_model(placed, library).bounds
            middle = (np.array(low) + np.array(high)) / 2
            x, y, z = map(float, np.array(center) - matrix_from_quaternion(quaternion) @ middle)
            objects_placed.append(placed.model_copy(update={"pose": ((x, y, z), quaternion)}))
    return objects_placed
