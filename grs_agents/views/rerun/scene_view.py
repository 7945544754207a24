"""The photo in the recording: picture, depth, masks, boxes in 2D and 3D, point cloud."""

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
from grs_agents.views.rerun.recording import Paths, RerunRecording
from grs_agents.views.rerun.rollout_view import log_asset_shapes
from grs_agents.views.rerun.waiting import clear_placeholder

MOST_POINTS = 40_000
"""Largest point cloud; its points are a regular subsample of the pixels."""
SMALL = 64 * 1024
"""Size up to which a PNG is logged unchanged, bytes."""
_BOX = (205, 135, 20)
_TINT = 0.4
"""Opacity of a mask over the photo."""
_PICTURES = {"rgb": Paths.PHOTO, "coverage": Paths.COVERAGE, "twin": Paths.TWIN_PICTURE, "depth": Paths.DEPTH}
Image = npt.NDArray[Any]


def read_picture(path: Path, flags: int) -> Image:
    """Read a picture with OpenCV, cached: photo and depth serve several parts of a stage."""
    return _read_picture_cached(path, modification_time_ns(path), flags)


@lru_cache(maxsize=4)
def _read_picture_cached(path: Path, _changed: int, flags: int) -> Image:
    image = foreign.read_picture(path, flags)
    image.setflags(write=False)
    return image


def log_picture(recording: RerunRecording, path: str, file: Path) -> None:
    """Log the colour picture ``file``, compressed."""
    recording.log(path, _encode_picture_cached(file, modification_time_ns(file)))


@lru_cache(maxsize=16)
def _encode_picture_cached(file: Path, _changed: int) -> rr.EncodedImage:
    """Cached, since the prompts of a run show the same few pictures repeatedly."""
    if file.suffix == ".png" and file.is_file() and file.stat().st_size < SMALL:
        return rr.EncodedImage(contents=file.read_bytes(), media_type="image/png")
    return _encode_jpeg(read_picture(file, cv2.IMREAD_COLOR), 88)


def _encode_jpeg(image: Image, quality: int, draw_order: float | None = None) -> rr.EncodedImage:
    """Encode ``image`` (H, W, 3), blue first, as JPEG."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg", draw_order=draw_order)


class SceneStageView:
    """Shows scene stages; camera, picture and depth of earlier stages are reused."""

    def __init__(self, folder: Path, library: Library) -> None:
        self._folder, self._library = folder, library
        self._files: dict[str, str] = {}
        self._camera: dict[str, Any] = {}
        self._depth_scale: float | None = None
        self._cloud_shown_for: Any = None
        self._asset_paths: dict[int, str] = {}
        self._shown: dict[str, str] = {}

    def show_scene_stage(self, recording: RerunRecording, event: SceneStage) -> None:
        """Log the new parts of ``event``."""
        self._files.update(event.files)
        self._camera.update(event.summary.get("camera") or {})
        scale = event.summary.get("depth_scale") or self._camera.get("depth_scale")
        self._depth_scale = float(scale) if scale else None
        if event.summary.get("camera"):
            self._show_camera(recording)
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
        self._show_point_cloud(recording)
        objects: list[dict[str, Any]] = event.summary.get("objects") or []
        if "masks" in event.files:
            self._show_masks_and_boxes(recording)
        if objects:
            boxed = [item for item in objects if item.get("box")]
            low = np.array([item["box"]["low"] for item in boxed], dtype=np.float64).reshape(-1, 3)
            high = np.array([item["box"]["high"] for item in boxed], dtype=np.float64).reshape(-1, 3)
            centers = (low + high) / 2
            labels = [replace_undrawable_chars(object_display_name(item)) for item in boxed]
            boxes = rr.Boxes3D(
                centers=centers,
                sizes=high - low,
                colors=[_BOX] * len(boxed),
                labels=labels,
                show_labels=True,
                radii=[0.001],
            )
            recording.log(f"{Paths.SCENE}/boxes", boxes)
            coverage = event.summary.get("coverage")
            rows = ["### Objects in the photo", "", "| | name | size (cm) | asset |", "|---|---|---|---|"]
            for index, item in enumerate(objects):
                asset, name = to_markdown_cell(item.get("asset") or ""), to_markdown_cell(object_display_name(item))
                rows.append(
                    f"| {object_mask_label(item, index)} | {name} | {format_object_size(item, '?')} | {asset} |"
                )
            if coverage:
                rows += ["", f"coverage: {coverage['share']:.2f} of what rises above the table"]
            recording.log_markdown(Paths.OBJECTS, to_viewer_markdown("\n".join(rows)))
            self._show_twin_objects(recording, objects)
        background = event.summary.get("asset" if event.stage == "background" else "background")
        if background:
            library = library_with_run_assets(self._folder, self._library)
            log_asset_shapes(recording, Paths.SURROUNDINGS, str(background), library)

    def _show_twin_objects(self, recording: RerunRecording, objects: list[dict[str, Any]]) -> None:
        """The matched assets at their poses in the twin; the viewer draws them from the photo's camera."""
        library = library_with_run_assets(self._folder, self._library)
        for item in build_twin_objects(objects, library):
            path, (position, quaternion) = f"{Paths.TWIN}/object_{item.id}", item.pose
            recording.log(path, rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=quaternion)))
            asset_path = f"{path}/{rr.escape_entity_path_part(item.asset)}"
            previous = self._asset_paths.get(item.id)
            if previous != asset_path:
                log_asset_shapes(recording, asset_path, item.asset, library)
                self._asset_paths[item.id] = asset_path
            if previous and previous != asset_path:
                recording.log(previous, rr.Clear(recursive=True))

    def _show_camera(self, recording: RerunRecording) -> None:
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

    def _show_depth_image(self, recording: RerunRecording) -> None:
        file = resolve_member_file(self._folder, self._files["depth"])
        sample = read_picture(file, cv2.IMREAD_UNCHANGED)[::4, ::4]
        valid = sample[sample > 0]
        low, high = np.percentile(valid, [2, 98]) if valid.size else (0, 1)
        blob = file.read_bytes()
        meter = 1 / self._depth_scale if self._depth_scale else 1000.0
        image = rr.EncodedDepthImage(
            blob=blob, media_type="image/png", meter=meter, depth_range=(float(low), float(high)), colormap="turbo"
        )
        recording.log(Paths.DEPTH, image)

    def _show_point_cloud(self, recording: RerunRecording) -> None:
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

    def _show_masks_and_boxes(self, recording: RerunRecording) -> None:
        """The 2D boxes, and the photo tinted by its masks. A segmentation image laid over it would tint its background
        too."""
        labels = read_picture(resolve_member_file(self._folder, self._files["masks"]), cv2.IMREAD_UNCHANGED)
        boxes = mask_bounding_boxes(labels)
        if "rgb" in self._files and boxes:
            image = read_picture(resolve_member_file(self._folder, self._files["rgb"]), cv2.IMREAD_COLOR)
            if image.shape[:2] == labels.shape:
                colors = np.zeros((int(labels.max()) + 1, 3), np.uint8)
                for label in boxes:
                    colors[label] = _label_color(label)[::-1]
                tinted, masked = image.copy(), labels > 0
                tinted[masked] = cv2.addWeighted(image[masked], 1 - _TINT, colors[labels[masked]], _TINT, 0)
                recording.log(f"{Paths.CAMERA}/masks", _encode_jpeg(tinted, 85, draw_order=1.0))
        if boxes:
            drawn = rr.Boxes2D(
                array=list(boxes.values()),
                array_format=rr.Box2DFormat.XYWH,
                colors=[_label_color(label) for label in boxes],
                labels=[str(label) for label in boxes],
                show_labels=True,
            )
            recording.log(f"{Paths.CAMERA}/boxes", drawn)


def _label_color(label: int) -> tuple[int, int, int]:
    """A colour unlike those of the preceding labels: hues are spaced by the golden ratio."""
    red, green, blue = colorsys.hsv_to_rgb(label * 0.618034 % 1.0, 0.75, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)
