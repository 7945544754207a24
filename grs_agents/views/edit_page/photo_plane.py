"""The photo as a plane in the 3D view, and the pictures made of it."""

import base64
import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.edits import inner_pixel
from grs_agents.perception.image_geometry import label_connected_components
from grs_agents.perception.types import Intrinsics, Mask

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
DISTANCE: Final = 4.0  # m from the camera: behind everything on a table
_SHOWN_SIDE = 1280  # px of the longer side of the photo on the page
THUMBNAIL: Final = 56  # px
_OUTLINE, _SELECTED, _LEVEL, _PREVIEW = (0, 255, 80), (255, 255, 0), (0, 200, 255), (255, 0, 160)


@dataclass(frozen=True)
class Viewer:
    """The camera of a browser's view, OpenCV axes, robot frame."""

    rotation: Floats  # (3, 3)
    position: Floats  # (3,) m
    field_of_view: float  # vertical, rad
    aspect: float  # width over height


@dataclass(frozen=True)
class PhotoPlane:
    """The photo at a distance in front of its camera, so that a pixel lies on its own ray."""

    camera: Intrinsics
    pose: Floats  # (4, 4) camera frame to robot frame

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m."""
        return self.camera.width / self.camera.fx * DISTANCE, self.camera.height / self.camera.fy * DISTANCE

    @property
    def centre(self) -> Floats:
        """(3,) m, robot frame."""
        x = ((self.camera.width - 1) / 2 - self.camera.cx) / self.camera.fx
        y = ((self.camera.height - 1) / 2 - self.camera.cy) / self.camera.fy
        return self.pose[:3, :3] @ np.array([x, y, 1.0]) * DISTANCE + self.pose[:3, 3]

    def find_pixel(self, screen: tuple[float, float], viewer: Viewer) -> tuple[float, float] | None:
        """Column and row of the photo under a point of the screen (0..1 right and down); None if it is behind."""
        half = np.tan(viewer.field_of_view / 2)
        ray = np.array([(2 * screen[0] - 1) * half * viewer.aspect, (2 * screen[1] - 1) * half, 1.0])
        direction = self.pose[:3, :3].T @ (viewer.rotation @ ray)
        start = self.pose[:3, :3].T @ (viewer.position - self.pose[:3, 3])
        if abs(direction[2]) < 1e-9 or (along := (DISTANCE - start[2]) / direction[2]) <= 0:
            return None
        point = start + along * direction
        column = point[0] / DISTANCE * self.camera.fx + self.camera.cx
        row = point[1] / DISTANCE * self.camera.fy + self.camera.cy
        return float(column), float(row)

    def find_field_of_view(self, aspect: float) -> float:
        """The vertical field (rad) of a view from the photo's camera in which the whole photo is seen."""
        camera = self.camera
        across = max(camera.cx + 0.5, camera.width - 0.5 - camera.cx) / camera.fx / aspect
        upright = max(camera.cy + 0.5, camera.height - 0.5 - camera.cy) / camera.fy
        return float(2 * np.arctan(1.02 * max(across, upright)))


def draw_photo(
    rgb: Image, masks: Mapping[int, Mask], selected: int | None, levels: Mapping[str, Mask], preview: Mask | None
) -> Image:
    """The photo with outlines of objects by their numbers, and of named planes; 1280 px."""
    scale = min(1.0, _SHOWN_SIDE / max(rgb.shape[:2]))
    shape = (max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale)))
    picture = rgb.copy() if scale == 1 else np.asarray(cv2.resize(rgb, shape, interpolation=cv2.INTER_AREA), np.uint8)

    def fit(mask: Mask) -> npt.NDArray[np.uint8]:
        return cv2.resize(mask.astype(np.uint8), shape, interpolation=cv2.INTER_NEAREST).astype(np.uint8)

    if preview is not None:
        inside = fit(preview) > 0
        picture[inside] = (picture[inside] * 0.4 + np.array(_PREVIEW) * 0.6).astype(np.uint8)
    for mask in levels.values():
        _draw_outline(picture, fit(mask), _LEVEL, 1)
    for number, mask in masks.items():
        color, width = (_SELECTED, 3) if number == selected else (_OUTLINE, 1)
        _draw_outline(picture, fit(mask), color, width)
    numbered = [(str(number), mask) for number, mask in masks.items()]
    for text, mask in (*levels.items(), *numbered):
        if text and mask.any():
            column, row = inner_pixel(fit(mask) > 0)
            at = (column - 6 * len(text), row + 6)
            cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 4, cv2.LINE_AA)
            cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def clean_region(mask: Mask) -> Mask:
    """The large parts of a noisy mask (H, W), without small holes."""
    kernel = np.ones((7, 7), np.uint8)
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    return label_connected_components(cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel), mask.size // 200) > 0


def _draw_outline(picture: Image, mask: npt.NDArray[np.uint8], color: tuple[int, int, int], width: int) -> None:
    lines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(picture, lines, -1, color, width, cv2.LINE_AA)


def crop_thumbnail(rgb: Image, mask: Mask) -> Image:
    """A square picture of an object, 56 px."""
    rows, columns = np.nonzero(mask) if mask.any() else (np.array([0]), np.array([0]))
    half = max(int(np.ptp(rows)), int(np.ptp(columns)), 8) // 2 + 3
    row, column = (int(rows.min()) + int(rows.max())) // 2, (int(columns.min()) + int(columns.max())) // 2
    around = rgb[max(row - half, 0) : row + half, max(column - half, 0) : column + half]
    return cv2.resize(around, (THUMBNAIL, THUMBNAIL), interpolation=cv2.INTER_AREA).astype(np.uint8)


def inline_picture(rgb: Image) -> str:
    """A picture as an ``img`` element."""
    data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])[1]
    return f'<img alt="" src="data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}">'


def escape_lines(*lines: str, size: float = 0.8) -> str:
    """Foreign text as HTML, a line each."""
    shown = "<br>".join(html.escape(line) for line in lines)
    return f'<div style="font-size:{size}em;line-height:1.35;padding:0 0.6em;overflow-wrap:anywhere">{shown}</div>'
