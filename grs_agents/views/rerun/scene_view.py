"""The photo in the recording: picture, depth, masks, boxes in two and three dimensions, point cloud."""

import colorsys
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr

from grs_agents.base.foreign import pictures as foreign
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.base.trace.events import SceneStage
from grs_agents.library.library import Library
from grs_agents.views.common.safe_text import replace_undrawable_chars, to_markdown_cell, to_viewer_markdown
from grs_agents.views.common.scene_objects import (
    build_twin_objects,
    format_object_size,
    library_with_run_assets,
    mask_bounding_boxes,
    modification_time_ns,
    object_display_name,
    object_mask_label,
)
from grs_agents.views.rerun.recording import Paths, Recording
from grs_agents.views.rerun.rollout_view import log_asset_shapes
from grs_agents.views.rerun.waiting import clear_placeholder

MOST_POINTS = 40_000
"""Points of the cloud that are kept, evenly spread over the picture."""
SMALL = 64 * 1024
"""Bytes up to which a PNG is shown as it is."""
_BOX = (205, 135, 20)
_TINT = 0.4
"""How much a mask covers of the photo."""
_PICTURES = {"rgb": Paths.PHOTO, "coverage": Paths.COVERAGE, "twin": Paths.TWIN_PICTURE, "depth": Paths.DEPTH}
Image = npt.NDArray[Any]


def read_picture(path: Path, flags: int) -> Image:
    """A picture as OpenCV reads it."""
    return _read_picture_cached(path, modification_time_ns(path), flags)


@lru_cache(maxsize=4)
def _read_picture_cached(path: Path, _changed: int, flags: int) -> Image:
    """The pictures read last; photo and depth serve several parts of a stage."""
    image = foreign.read_picture(path, flags)
    image.setflags(write=False)
    return image


def log_picture(recording: Recording, path: str, file: Path) -> None:
    """Show the colour picture ``file``, compressed."""
    recording.log(path, _encode_picture_cached(file, modification_time_ns(file)))


@lru_cache(maxsize=16)
def _encode_picture_cached(file: Path, _changed: int) -> rr.EncodedImage:
    """A picture as it is shown; kept, since the prompts of a run show the same few again and again."""
    if file.suffix == ".png" and file.is_file() and file.stat().st_size < SMALL:
        return rr.EncodedImage(contents=file.read_bytes(), media_type="image/png")
    return _encode_jpeg(read_picture(file, cv2.IMREAD_COLOR), 88)


def _encode_jpeg(image: Image, quality: int, draw_order: float | None = None) -> rr.EncodedImage:
    """A JPEG of ``image`` (H, W, 3), blue first."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg", draw_order=draw_order)


class SceneView:
    """Shows scene stages; camera, picture and depth of an earlier stage serve later ones."""

    def __init__(self, folder: Path, library: Library) -> None:
        self._folder, self._library = folder, library
        self._files: dict[str, str] = {}
        self._camera: dict[str, Any] = {}
        self._depth_scale: float | None = None
        self._cloud_shown_for: Any = None
        self._asset_paths: dict[int, str] = {}
        self._shown: dict[str, str] = {}

    def show_scene_stage(self, recording: Recording, event: SceneStage) -> None:
        """Show what ``event`` brings."""
        self._files.update(event.files)
        self._camera.update(event.summary.get("camera") or {})
        scale = event.summary.get("depth_scale") or self._camera.get("depth_scale")
        self._depth_scale = float(scale) if scale else None
        if event.summary.get("camera"):
            self._show_camera(recording)
        self._show_new_pictures(recording, event)
        self._show_point_cloud(recording)
        objects: list[dict[str, Any]] = event.summary.get("objects") or []
        if "masks" in event.files:
            self._show_masks_and_boxes(recording, objects)
        if objects:
            _show_bounding_boxes(recording, objects)
            recording.log_markdown(Paths.OBJECTS, _format_object_table(objects, event.summary.get("coverage")))
            self._show_twin_objects(recording, objects)
        background = event.summary.get("asset" if event.stage == "background" else "background")
        if background:
            library = library_with_run_assets(self._folder, self._library)
            log_asset_shapes(recording, Paths.SURROUNDINGS, str(background), library)

    def _show_new_pictures(self, recording: Recording, event: SceneStage) -> None:
        for kind, path in _PICTURES.items():
            file = event.files.get(kind)
            if file is None or file == self._shown.get(kind):
                continue
            if kind not in self._shown:
                clear_placeholder(recording, path)
            self._shown[kind] = file
            if kind == "depth":
                self._show_depth_image(recording)
            else:
                log_picture(recording, path, resolve_member_file(self._folder, file))

    def _show_twin_objects(self, recording: Recording, objects: list[dict[str, Any]]) -> None:
        """The assets that stand for the objects, where they do; the viewer draws them from the camera of the photo."""
        library = library_with_run_assets(self._folder, self._library)
        for item in build_twin_objects(objects, library):
            path, (position, quaternion) = f"{Paths.TWIN}/object_{item.id}", item.pose
            recording.log(path, rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=quaternion)))
            looks = f"{path}/{rr.escape_entity_path_part(item.asset)}"
            before = self._asset_paths.get(item.id)
            if before != looks:
                log_asset_shapes(recording, looks, item.asset, library)
                self._asset_paths[item.id] = looks
            if before and before != looks:
                recording.log(before, rr.Clear(recursive=True))

    def _show_camera(self, recording: Recording) -> None:
        camera = self._camera
        pinhole = rr.Pinhole(
            focal_length=[camera["fx"], camera["fy"]],
            principal_point=[camera["cx"], camera["cy"]],
            resolution=[camera["width"], camera["height"]],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.25,
        )
        recording.log(Paths.SCENE, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        recording.log(Paths.CAMERA, pinhole)
        if camera.get("T_robot_cam"):
            pose = np.asarray(camera["T_robot_cam"], dtype=np.float64)
            recording.log(Paths.CAMERA, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))

    def _show_depth_image(self, recording: Recording) -> None:
        file = resolve_member_file(self._folder, self._files["depth"])
        sample = read_picture(file, cv2.IMREAD_UNCHANGED)[::4, ::4]
        seen = sample[sample > 0]
        low, high = np.percentile(seen, [2, 98]) if seen.size else (0, 1)
        blob = file.read_bytes()
        meter = 1 / self._depth_scale if self._depth_scale else 1000.0
        image = rr.EncodedDepthImage(
            blob=blob, media_type="image/png", meter=meter, depth_range=(float(low), float(high)), colormap="turbo"
        )
        recording.log(Paths.DEPTH, image)

    def _show_point_cloud(self, recording: Recording) -> None:
        """The point cloud in the robot frame, once the camera's pose is known."""
        camera, pose = self._camera, self._camera.get("T_robot_cam")
        if not pose or pose == self._cloud_shown_for or not {"rgb", "depth"} <= self._files.keys():
            return
        depth = read_picture(resolve_member_file(self._folder, self._files["depth"]), cv2.IMREAD_UNCHANGED)
        color = read_picture(resolve_member_file(self._folder, self._files["rgb"]), cv2.IMREAD_COLOR)
        step = max(1, int(np.ceil(np.sqrt(depth.size / MOST_POINTS))))
        metres = depth[::step, ::step] * np.float32(self._depth_scale or 0.001)
        rows, columns = np.nonzero(metres)
        z = metres[rows, columns]
        x = (columns * step - camera["cx"]) / camera["fx"] * z
        y = (rows * step - camera["cy"]) / camera["fy"] * z
        matrix = np.asarray(pose, dtype=np.float32)
        points = np.column_stack([x, y, z]).astype(np.float32) @ matrix[:3, :3].T + matrix[:3, 3]
        colors = color[::step, ::step][rows, columns, ::-1]
        recording.log(f"{Paths.SCENE}/points", rr.Points3D(points, colors=colors, radii=[0.003]))
        self._cloud_shown_for = pose

    def _show_masks_and_boxes(self, recording: Recording, objects: list[dict[str, Any]]) -> None:
        labels = read_picture(resolve_member_file(self._folder, self._files["masks"]), cv2.IMREAD_UNCHANGED)
        boxes = mask_bounding_boxes(labels)
        present = list(boxes)
        self._show_tinted_photo(recording, labels, present)
        if boxes:
            drawn = rr.Boxes2D(
                array=list(boxes.values()),
                array_format=rr.Box2DFormat.XYWH,
                colors=[_label_color(label) for label in present],
                labels=[str(label) for label in present],
                show_labels=True,
            )
            recording.log(f"{Paths.CAMERA}/boxes", drawn)

    def _show_tinted_photo(self, recording: Recording, labels: Image, present: list[int]) -> None:
        """The photo with each mask in its colour; laid over it, a segmentation image would tint its background too."""
        if "rgb" not in self._files:
            return
        image = read_picture(resolve_member_file(self._folder, self._files["rgb"]), cv2.IMREAD_COLOR)
        if image.shape[:2] != labels.shape:
            return
        colors = np.zeros((int(labels.max()) + 1, 3), np.uint8)
        for label in present:
            colors[label] = _label_color(label)[::-1]
        tinted, masked = image.copy(), labels > 0
        if not masked.any():
            return
        tinted[masked] = cv2.addWeighted(image[masked], 1 - _TINT, colors[labels[masked]], _TINT, 0)
        recording.log(f"{Paths.CAMERA}/masks", _encode_jpeg(tinted, 85, draw_order=1.0))


def _label_color(label: int) -> tuple[int, int, int]:
    """A colour that is far from those of the labels before."""
    red, green, blue = colorsys.hsv_to_rgb(label * 0.618034 % 1.0, 0.75, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


def _format_object_table(objects: list[dict[str, Any]], coverage: dict[str, Any] | None) -> str:
    """The objects as a table; its numbers are those on the photo, since names would cover one another there.

    Below it which share of what rises above the table they own, if it was measured.
    """
    rows = ["### Objects in the photo", "", "| | name | size (cm) | asset |", "|---|---|---|---|"]
    for index, item in enumerate(objects):
        asset, name = to_markdown_cell(item.get("asset") or ""), to_markdown_cell(object_display_name(item))
        rows.append(f"| {object_mask_label(item, index)} | {name} | {format_object_size(item, '?')} | {asset} |")
    if coverage:
        rows += ["", f"coverage: {coverage['share']:.2f} of what rises above the table"]
    return to_viewer_markdown("\n".join(rows))


def _show_bounding_boxes(recording: Recording, objects: list[dict[str, Any]]) -> None:
    """The axis-aligned boxes in the robot frame."""
    boxed = [item for item in objects if item.get("box")]
    low = np.array([item["box"]["low"] for item in boxed], dtype=np.float64).reshape(-1, 3)
    high = np.array([item["box"]["high"] for item in boxed], dtype=np.float64).reshape(-1, 3)
    centers = (low + high) / 2
    labels = [replace_undrawable_chars(object_display_name(item)) for item in boxed]
    boxes = rr.Boxes3D(
        centers=centers, sizes=high - low, colors=[_BOX] * len(boxed), labels=labels, show_labels=True, radii=[0.001]
    )
    recording.log(f"{Paths.SCENE}/boxes", boxes)
