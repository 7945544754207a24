"""The camera of a scene: read, checked, and told again for a picture of another size."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from grs_agents.errors import InputError
from grs_agents.scene.frame import Camera
from grs_agents.scene.reading.files import read_json

KEYS = "fx fy cx cy width height depth_scale"
LARGEST = 1e9
"""No value of an intrinsic matrix is larger."""
FULL_FRAME_DIAGONAL = 43.267
"""Of 35 mm film, in millimetres: focal lengths "in 35 mm" are told for this diagonal (CIPA DC-008)."""


def read_camera(file: Path, depth_scale: float | None = None) -> Camera:
    """Read ``camera.json``.

    Args:
        file: its path.
        depth_scale: metres per unit of depth where the file says nothing of it; without it the file must.

    Raises:
        InputError: it cannot be read, is not JSON, or a value is missing, unknown, not finite or absurd.
    """
    values = read_json(file, f"put camera.json there, with {KEYS}")
    if depth_scale is not None:
        values = {"depth_scale": depth_scale} | values
    return camera_of(values, str(file))


def camera_of(values: Mapping[str, Any], where: str) -> Camera:
    """The camera with these values; ``where`` is named in errors.

    Raises:
        InputError: a value is missing, unknown, not finite or absurd.
    """
    try:
        return Camera.model_validate(dict(values))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"][:1])
        given = f" = {str(first['input'])[:80]}" if key and first["type"] != "missing" else ""
        remedy = f"give every one of {KEYS}, finite, and T_robot_cam if calibrated"
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(f"{where}: {key}{given}{': ' if key else ''}{problem}", remedy) from error


def camera_of_matrix(matrix: object, size: tuple[int, int], where: str, **more: Any) -> Camera:
    """The camera with intrinsic matrix K: three rows of three numbers, or nine numbers row by row.

    Args:
        matrix: K as lists.
        size: width and height in pixels.
        where: what errors call it.
        more: ``depth_scale`` and ``T_robot_cam``.

    Raises:
        InputError: it is no such matrix, or a value is not finite or absurd.
    """
    rows = f"{where} = {str(matrix)[:80]} is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    remedy = "give the 3x3 intrinsic matrix of a pinhole camera, in pixels"
    flat = list(_numbers(matrix))
    if len(flat) != 9:
        raise InputError(rows, remedy)
    fx, skew, cx, zero, fy, cy, *last = flat
    if abs(skew) > 1e-3 * abs(fx) or zero != 0 or last != [0, 0, 1]:
        raise InputError(rows, remedy)
    values = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": size[0], "height": size[1], **more}
    return camera_of(values, where)


def _numbers(value: object) -> Iterator[float]:
    """The finite numbers in lists of lists, in order."""
    if isinstance(value, list):
        for one in cast(list[object], value):
            yield from _numbers(one)
    elif isinstance(value, int | float) and abs(value) < LARGEST:
        yield float(value)


def camera_of_focal(focal: float, size: tuple[int, int], where: str) -> Camera:
    """A camera with square pixels that looks through the middle of its picture; ``focal`` in pixels."""
    width, height = size
    values = {"fx": focal, "fy": focal, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return camera_of({**values, "width": width, "height": height, "depth_scale": 0.001}, where)


def focal_of_35mm(millimetres: float, size: tuple[int, int]) -> float:
    """A focal length told for 35 mm film, in pixels of a picture of ``size``."""
    width, height = size
    return millimetres / FULL_FRAME_DIAGONAL * (width * width + height * height) ** 0.5


def resized(camera: Camera, width: int, height: int) -> Camera:
    """The same camera for its picture scaled to another size; pixel centres are at whole numbers."""
    across, down = width / camera.width, height / camera.height
    return camera.model_copy(
        update={
            "fx": camera.fx * across,
            "fy": camera.fy * down,
            "cx": (camera.cx + 0.5) * across - 0.5,
            "cy": (camera.cy + 0.5) * down - 0.5,
            "width": width,
            "height": height,
        }
    )
