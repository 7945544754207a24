"""The objects of a scene as events tell them: number in the label picture, name, pose, asset.
The described scene can be shown as its assets where the photo shows them, seen by the camera of the photo."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from grs_agents.base import Pose, Vec3
from grs_agents.library import (
    COLORS,
    FINER,
    Lens,
    Library,
    Shape,
    build_textured_triangles,
    matrix_from_quaternion,
    render_color_and_depth,
    transform_shape,
)
from grs_agents.sim.instance import InstanceObject
from grs_agents.sim.world import load_object_model

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


FloatArray = npt.NDArray[np.float64]
_NEAREST = 0.01
"""Depth (m) from which a triangle is drawn; what reaches behind the camera has no picture."""
_MARK = 0.002
"""A mark on the table may lie so much (m) below its top and is seen all the same."""
_TABLE_MIDDLE, _TABLE_HALF = (0.4, 0.0), 1.2
"""The simulated table top, m."""
_WOOD, _SKY = (0.60, 0.52, 0.42), (0.90, 0.90, 0.90)


def library_with_run_assets(folder: Path, library: Library) -> Library:
    """``library`` with the assets laid over that the run has made so far."""
    own = folder / "assets"
    return _cached_overlay(library, own, modification_time_ns(own / "manifest.json")) if own.is_dir() else library


@lru_cache(maxsize=2)
def _cached_overlay(library: Library, own: Path, _written: int) -> Library:
    """Kept, since reading a manifest takes longer than showing its assets."""
    return library.with_overlay(own)


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


def render_from_photo_camera(
    objects: Sequence[InstanceObject],
    library: Library,
    camera: dict[str, Any],
    background: str | None = None,
    table: Vec3 | None = None,
    width: int = 480,
) -> npt.NDArray[np.uint8]:
    """Objects on the table (H, ``width``, 3) as the camera of the photo would see them, in their own colours.

    It is drawn by the z-buffer, alike on every machine and without OpenGL.

    Args:
        objects: what stands there, each placed by its origin: of :func:`build_twin_objects` or of a task instance.
        library: 3D assets.
        camera: ``fx``, ``fy``, ``cx``, ``cy``, ``width``, ``height`` in pixels and ``T_robot_cam``.
        background: library name of what stands around, or None.
        table: colour of its top (sRGB, 0..1), or None for wood.
        width: of the picture; its shape is the photo's.
    """
    scale = float(camera["width"]) / (width * FINER)
    lens = Lens(
        float(camera["fx"]) / scale,
        float(camera["fy"]) / scale,
        (float(camera["cx"]) + 0.5) / scale - 0.5,
        (float(camera["cy"]) + 0.5) / scale - 0.5,
        width * FINER,
        min(round(float(camera["height"]) / scale / FINER), 4 * width) * FINER,  # no photo is narrower
    )
    pose = np.asarray(camera["T_robot_cam"], dtype=np.float64)
    shapes = [shape for item in objects for shape in _visible_shapes(item, library)]
    shapes += library.load_object_model(background).visuals if background else ()
    fine, deep = _render_table_and_sky(lens, pose, table or _WOOD)
    if shapes:
        painted = build_textured_triangles(library, shapes)
        local = (painted.corners - pose[:3, 3]) @ pose[:3, :3]
        ahead = (local[:, :, 2] > _NEAREST).all(axis=1)
        corners = painted.corners[ahead]
        uvs = painted.uvs[ahead]
        part = replace(painted, corners=corners, uvs=uvs, colors=painted.colors[ahead], texture=painted.texture[ahead])
        colors, depth = render_color_and_depth(part, local[ahead], lens)
        seen = (colors[:, :, 3] > 0) & (depth < deep + _MARK)
        fine[seen] = colors[seen, :3]
    pixels = fine.reshape(lens.height // FINER, FINER, width, FINER, 3).mean(axis=(1, 3))
    return np.rint(pixels * 255).astype(np.uint8)


def _visible_shapes(item: InstanceObject, library: Library) -> list[Shape]:
    """The shapes that are seen of an object, in the robot's frame."""
    model = load_object_model(item, library)
    shapes = model.visuals or model.colliders
    if item.color:
        look = {"color": item.color, "texture": None}
        return [transform_shape(shape, item.pose).model_copy(update=look) for shape in shapes]
    named = COLORS.get(library.asset(item.asset).color if item.asset in library else "", COLORS["gray"])
    bare = {"color": (*named, 1.0)}
    placed = [transform_shape(shape, item.pose) for shape in shapes]
    return [shape if shape.color or shape.texture else shape.model_copy(update=bare) for shape in placed]


def _render_table_and_sky(lens: Lens, pose: FloatArray, table: Vec3) -> tuple[FloatArray, FloatArray]:
    """Colour (H, W, 3) of table and sky, and depth (H, W) of the table, m; infinite where there is none."""
    rays = np.ones((lens.height, lens.width, 3))
    rays[..., 0] = (np.arange(lens.width) - lens.cx) / lens.fx
    rays[..., 1] = ((np.arange(lens.height) - lens.cy) / lens.fy)[:, None]
    turned = rays @ pose[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -pose[2, 3] / turned[..., 2]
        points = pose[:2, 3] + far[..., None] * turned[..., :2]
        hit = (far > 0) & (np.abs(points - _TABLE_MIDDLE) < _TABLE_HALF).all(axis=-1)
    return np.where(hit[..., None], table, _SKY), np.where(hit, far, np.inf)
