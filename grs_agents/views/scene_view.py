"""The photo in the recording: picture, depth, masks, boxes in two and three dimensions, point cloud."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr

from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.trace import SceneStage
from grs_agents.views.glyphs import cell, document, drawable
from grs_agents.views.objects import label_of, name_of, rectangles
from grs_agents.views.paths import Paths
from grs_agents.views.recording import Recording
from grs_agents.views.shape_view import show_asset
from grs_agents.views.twin import run_library, twin_objects

MOST_POINTS = 40_000
"""Points of the cloud that are kept, evenly spread over the picture."""
_BOX = (255, 205, 60)
Image = npt.NDArray[Any]


def read_picture(path: Path, flags: int) -> Image:
    """A picture as OpenCV reads it.

    Raises:
        InputError: the file is missing or not a picture.
    """
    image = cv2.imread(str(path), flags)
    if image is None:
        raise InputError(f"cannot read the picture {path}", "restore the file or run again")
    return image


def log_picture(recording: Recording, path: str, file: Path) -> None:
    """Show the colour picture ``file``, compressed."""
    image = cv2.cvtColor(read_picture(file, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    recording.log(path, rr.Image(image).compress(jpeg_quality=88))


class SceneView:
    """Shows scene stages; camera, picture and depth of an earlier stage serve later ones."""

    def __init__(self, folder: Path, library: Library) -> None:
        self._folder, self._library = folder, library
        self._files: dict[str, str] = {}
        self._camera: dict[str, Any] = {}
        self._depth_scale: float | None = None
        self._cloud_shown_for: Any = None

    def show(self, recording: Recording, event: SceneStage) -> None:
        """Show what ``event`` brings."""
        self._files.update(event.files)
        self._camera.update(event.summary.get("camera") or {})
        scale = event.summary.get("depth_scale") or self._camera.get("depth_scale")
        self._depth_scale = float(scale) if scale else None
        if event.summary.get("camera"):
            self._show_camera(recording)
        if "rgb" in event.files:
            log_picture(recording, f"{Paths.CAMERA}/rgb", self._folder / event.files["rgb"])
        if "depth" in event.files:
            self._show_depth(recording)
        self._show_cloud(recording)
        objects: list[dict[str, Any]] = event.summary.get("objects") or []
        if "masks" in event.files:
            self._show_masks(recording, objects)
        if objects:
            _show_boxes(recording, objects)
            table = rr.TextDocument(_objects(objects), media_type=rr.MediaType.MARKDOWN)
            recording.log(Paths.OBJECTS, table)
            self._show_twin(recording, objects)
        background = event.summary.get("asset" if event.stage == "background" else "background")
        if background:
            show_asset(recording, Paths.SURROUNDINGS, str(background), run_library(self._folder, self._library))

    def _show_twin(self, recording: Recording, objects: list[dict[str, Any]]) -> None:
        """The assets that stand for the objects, where they do; the viewer draws them from the camera of the photo."""
        library = run_library(self._folder, self._library)
        for item in twin_objects(objects, library):
            path, (position, quaternion) = f"{Paths.TWIN}/object_{item.id}", item.pose
            pose = rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=quaternion))
            recording.log(path, pose)
            show_asset(recording, path, item.asset, library)

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

    def _show_depth(self, recording: Recording) -> None:
        file = self._folder / self._files["depth"]
        depth = read_picture(file, cv2.IMREAD_UNCHANGED)
        seen = depth[depth > 0]
        low, high = np.percentile(seen, [2, 98]) if seen.size else (0, 1)
        image = rr.EncodedDepthImage(
            blob=file.read_bytes(),
            media_type="image/png",
            meter=1 / self._depth_scale if self._depth_scale else 1000.0,
            depth_range=(float(low), float(high)),
            colormap="turbo",
        )
        recording.log(f"{Paths.CAMERA}/depth", image)

    def _show_cloud(self, recording: Recording) -> None:
        """The point cloud in the robot frame, once the camera's pose is known."""
        camera, pose = self._camera, self._camera.get("T_robot_cam")
        if not pose or pose == self._cloud_shown_for or not {"rgb", "depth"} <= self._files.keys():
            return
        depth = read_picture(self._folder / self._files["depth"], cv2.IMREAD_UNCHANGED)
        color = read_picture(self._folder / self._files["rgb"], cv2.IMREAD_COLOR)
        step = max(1, int(np.ceil(np.sqrt(depth.size / MOST_POINTS))))
        rows, columns = np.mgrid[0 : depth.shape[0] : step, 0 : depth.shape[1] : step]
        metres = depth[rows, columns] * (self._depth_scale or 0.001)
        seen = metres > 0
        x = (columns - camera["cx"]) / camera["fx"] * metres
        y = (rows - camera["cy"]) / camera["fy"] * metres
        matrix = np.asarray(pose, dtype=np.float64)
        points = np.stack([x, y, metres], axis=-1)[seen] @ matrix[:3, :3].T + matrix[:3, 3]
        colors = color[rows, columns][seen][:, ::-1]
        recording.log(f"{Paths.SCENE}/points", rr.Points3D(points, colors=colors, radii=[0.003]))
        self._cloud_shown_for = pose

    def _show_masks(self, recording: Recording, objects: list[dict[str, Any]]) -> None:
        labels = read_picture(self._folder / self._files["masks"], cv2.IMREAD_UNCHANGED)
        present = [int(label) for label in np.unique(labels) if label]
        names = {label_of(item, index): name_of(item) for index, item in enumerate(objects)}
        texts = [drawable(f"{label} {names.get(label, '')}".rstrip()) for label in present]
        infos = [rr.AnnotationInfo(id=0, label="background", color=(0, 0, 0, 0))]
        infos += [rr.AnnotationInfo(id=label, label=text) for label, text in zip(present, texts, strict=True)]
        recording.log(Paths.CAMERA, rr.AnnotationContext(infos))
        recording.log(f"{Paths.CAMERA}/masks", rr.SegmentationImage(labels, opacity=0.45))
        boxes = list(rectangles(labels).values())
        if boxes:
            numbers = [str(label) for label in present]
            drawn = rr.Boxes2D(
                array=boxes, array_format=rr.Box2DFormat.XYWH, class_ids=present, labels=numbers, show_labels=True
            )
            recording.log(f"{Paths.CAMERA}/boxes", drawn)


def _objects(objects: list[dict[str, Any]]) -> str:
    """The objects as a table; its numbers are those on the photo, since names would cover one another there."""
    rows = ["### Objects in the photo", "", "| | name | size (cm) | asset |", "|---|---|---|---|"]
    for index, item in enumerate(objects):
        size = "?"
        if item.get("box"):
            extents = np.subtract(item["box"]["high"], item["box"]["low"]) * 100
            size = " x ".join(f"{extent:.1f}" for extent in extents)
        asset = cell(item.get("asset") or "")
        rows.append(f"| {label_of(item, index)} | {cell(name_of(item))} | {size} | {asset} |")
    return document("\n".join(rows))


def _show_boxes(recording: Recording, objects: list[dict[str, Any]]) -> None:
    """The axis-aligned boxes in the robot frame."""
    boxed = [item for item in objects if item.get("box")]
    low = np.array([item["box"]["low"] for item in boxed], dtype=np.float64).reshape(-1, 3)
    high = np.array([item["box"]["high"] for item in boxed], dtype=np.float64).reshape(-1, 3)
    boxes = rr.Boxes3D(
        centers=(low + high) / 2,
        sizes=high - low,
        colors=[_BOX] * len(boxed),
        labels=[drawable(name_of(item)) for item in boxed],
        show_labels=True,
        radii=[0.001],
    )
    recording.log(f"{Paths.SCENE}/boxes", boxes)
