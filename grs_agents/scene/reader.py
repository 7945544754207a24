"""Read a scene folder: ``rgb.png``, ``depth.png`` (uint16) and ``camera.json``; refuse what is wrong by name."""

import json
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from grs_agents.errors import InputError
from grs_agents.scene.frame import Camera, RGBDFrame

NEAREST, FARTHEST = 0.1, 10.0
"""The median depth of a table-top photo lies between these, in metres."""
LEAST_MEASURED = 0.02
"""At least this share of the pixels must have a depth."""


def read_scene(folder: Path) -> RGBDFrame:
    """Read and check a scene folder.

    Raises:
        InputError: a file is missing or unreadable, sizes differ, the camera is incomplete or not finite, nothing was
            measured, or the depth is in another unit than ``depth_scale`` says.
    """
    if not folder.is_dir():
        remedy = "name a folder with rgb.png, depth.png and camera.json"
        raise InputError(f"scene folder {folder} does not exist", remedy)
    camera = read_camera(folder / "camera.json")
    rgb = _read_rgb(folder / "rgb.png", camera)
    raw = _read_depth(folder / "depth.png", camera)
    depth = (raw * np.float64(camera.depth_scale)).astype(np.float32)
    _check_depth(folder, raw, camera)
    return RGBDFrame(rgb=rgb, depth=depth, camera=camera, source=folder)


def read_camera(file: Path) -> Camera:
    """Read ``camera.json``.

    Raises:
        InputError: it cannot be read, is not JSON, or a value is missing, unknown or not finite.
    """
    try:
        value: Any = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}", "put camera.json into the scene folder") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is not JSON: {error}", "write fx fy cx cy width height depth_scale") from error
    if not isinstance(value, dict):
        raise InputError(f"{file} is not a JSON object", "write fx fy cx cy width height depth_scale")
    try:
        return Camera.model_validate(cast(dict[str, Any], value))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"][:1])
        given = f" = {str(first['input'])[:80]}" if where and first["type"] != "missing" else ""
        remedy = "give every one of fx fy cx cy width height depth_scale, finite, and T_robot_cam if calibrated"
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(f"{file}: {where}{given}{': ' if where else ''}{problem}", remedy) from error


def _read_image(file: Path) -> npt.NDArray[Any]:
    try:
        data = np.frombuffer(file.read_bytes(), np.uint8)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}", f"put {file.name} into the scene folder") from error
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{file} is not a readable picture ({data.size} bytes)", "write it again as PNG")
    return cast(npt.NDArray[Any], image)


def _read_rgb(file: Path, camera: Camera) -> npt.NDArray[np.uint8]:
    image = _read_image(file)
    if image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    if image.dtype != np.uint8:
        raise InputError(f"{file} has pixels of type {image.dtype}", "write it as 8-bit RGB")
    _check_size(file, image, camera)
    if image.ndim == 2:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB).astype(np.uint8)
    code = cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return cv2.cvtColor(image, code).astype(np.uint8)


def _read_depth(file: Path, camera: Camera) -> npt.NDArray[np.uint16]:
    image = _read_image(file)
    if image.dtype != np.uint16 or image.ndim != 2:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise InputError(f"{file} has {channels} channels of {image.dtype}", "write it as one channel of uint16")
    _check_size(file, image, camera)
    return image


def _check_size(file: Path, image: npt.NDArray[Any], camera: Camera) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            f"{file} is {width}x{height} but camera.json says {camera.width}x{camera.height}",
            "register colour and depth to one size and give that size in camera.json",
        )


def _check_depth(folder: Path, raw: npt.NDArray[np.uint16], camera: Camera) -> None:
    measured = raw[raw > 0]
    file = folder / "depth.png"
    if measured.size < LEAST_MEASURED * raw.size:
        raise InputError(
            f"{file} has a depth at {measured.size} of {raw.size} pixels, at least {LEAST_MEASURED:.0%} are needed",
            "record the depth again",
        )
    median = float(np.median(measured)) * camera.depth_scale
    if not NEAREST <= median <= FARTHEST:
        factor = 1000.0 if median < NEAREST else 0.001
        other = camera.depth_scale * factor
        raise InputError(
            f"{file}: depth_scale {camera.depth_scale:g} gives a median depth of {median:g} m, "
            f"outside {NEAREST}..{FARTHEST} m",
            f"with depth_scale {other:g} it would be {median * factor:g} m: correct depth_scale in camera.json",
        )
