"""Camera of a scene: reading, checking, scaling to a picture of another size."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import path_exists, read_json
from grs_agents.perception.reading.calibration_files import Calibration, distinct_calibrations, read_values
from grs_agents.perception.reading.depth_encoding import MILLIMETRE, DepthUnit, Units, resolve_stated_scale
from grs_agents.perception.reading.lens_distortion import FISHEYE, LensDistortion, normalize_lens_model
from grs_agents.perception.types import Camera

KEYS = "fx fy cx cy width height depth_scale"
DEPTH_SCALE_REMEDY = "give depth_scale: metres per unit of depth, 0.001 for millimetres"
MEANINGS = {
    "fx": "focal length in pixels",
    "fy": "focal length in pixels",
    "cx": "principal point in pixels",
    "cy": "principal point in pixels",
    "width": "of the picture, in pixels",
    "height": "of the picture, in pixels",
    "depth_scale": "metres per unit of depth, 0.001 for millimetres",
    "K": "3x3 intrinsic matrix, in pixels",
    "T_robot_cam": "4x4, from the camera frame (x right, y down, z forward) to the robot frame, metres",
    "joints": "positions of the arm's joints in the photo, rad, base first",
    "up": "direction away from gravity, three numbers in the camera frame (x right, y down, z forward)",
}
"""Meanings of the keys of camera.json, for errors."""
_OTHER_NAMES = {
    "fx": "fl_x",
    "fy": "fl_y",
    "width": "image_width w xres im_w",
    "height": "image_height h yres im_h",
    "cx": "ppx",
    "cy": "ppy",
    "depth_scale": "depth_factor factor_depth scale depthscale png_depth_scale depth_units",
    "T_robot_cam": "extrinsics extrinsic pose camera_pose t_base_cam t_world_cam t_cam_robot",
    "joints": "joint_positions joint_angles joint_state qpos",
}
ALIASES = {name: key for key, names in _OTHER_NAMES.items() for name in names.split()}
"""Other names that sensors' SDKs and data sets have for these keys, lower case."""
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Order of OpenCV's distortion coefficients."""
DISTORTION_KEYS = ("d", "distortion", "distortion_coefficients", "dist_coeffs", "coeffs", *COEFFICIENTS)
LENS_KEYS = ("distortion_model", "model", "camera_model")
CONVENTION_KEYS = ("convention", "axes", "coordinate_system", "camera_convention")
OPENCV_NAMES = ("opencv", "cv", "ros_optical", "optical")
LARGEST = 1e9  # bound on the values of an intrinsic matrix
INTRINSICS = ("fx", "fy", "cx", "cy", "width", "height")
SMALLEST_CHECKED = 16  # pixels; the principal point of a smaller picture may lie within 0..1
OTHER_SIZES = (0.25, 1 / 3, 0.5, 1.5, 2.0, 3.0, 4.0)
"""Ratios between the sizes of sensor streams, by which intrinsics of a wrong picture are off."""
FULL_FRAME_DIAGONAL = 43.267
"""Diagonal of 35 mm film, mm, to which "35 mm equivalent" focal lengths refer (CIPA DC-008)."""


@dataclass(frozen=True)
class CameraFile:
    """A camera, and notes on its file."""

    camera: Camera
    notes: tuple[str, ...] = ()
    distortion: LensDistortion | None = None  # of the lens, if it is not negligible
    taken: str = ""  # file and key of the intrinsics; empty for the documented keys of camera.json
    states_scale: bool = False  # whether the file gives ``depth_scale`` itself


def read_camera_file(
    file: Path, unit: DepthUnit | None = None, size: tuple[int, int] | None = None, units: Units | None = None
) -> CameraFile:
    """Read ``camera.json``, or a file of another program with intrinsics.

    ``K`` may replace ``fx fy cx cy``, and other names of intrinsics and size are understood. Unknown keys of
    camera.json go into the notes; refused are those that seem to mean a missing key or would change the result.

    Args:
        file: JSON, YAML, text, CSV or MATLAB; see `calibration_files`.
        unit: default unit of depth.
        size: width and height of the photo, the default of a file that states none.
        units: the depth (H, W) as recorded, by which a foreign scale is understood.

    Raises:
        InputError: it cannot be read, or a value is missing, not finite or absurd; it holds several cameras, of which
            none has the photo's size or is named after the colour camera; or a key seems to mean a missing key.
    """
    values: object = read_values(file) if path_exists(file) else read_json(file, f"put camera.json there, with {KEYS}")
    if isinstance(values, list) and len(cast(list[object], values)) == 1:
        values = cast(list[object], values)[0]
    own_keys = isinstance(values, dict) and bool({"fx", "K", "k"} & cast(dict[object, object], values).keys())
    calibrations = [] if own_keys else distinct_calibrations(cast(object, values), file.name)
    if calibrations:
        return camera_from_calibration(choose_calibration(calibrations, size, str(file)), size, unit, units)
    if not isinstance(values, dict):
        raise InputError(f"{file} is not a JSON object", f"put camera.json there, with {KEYS}")
    return _camera_from_mapping(
        {str(k): v for k, v in cast(dict[object, Any], values).items()}, file, unit, size, units
    )


def _camera_from_mapping(
    given: Mapping[str, Any], file: Path, unit: DepthUnit | None, size: tuple[int, int] | None, units: Units | None
) -> CameraFile:
    """The camera of a mapping with ``fx fy cx cy`` or ``K``."""
    values: dict[str, Any] = {key: value for key, value in given.items() if key in Camera.model_fields}
    unused: list[str] = []
    distortion: dict[str, float] = {}
    foreign_scale: float | None = None
    lens_model = ""
    for key, value in given.items():
        name = key.lower()
        alias = ALIASES.get(name, "")
        if name == "k":
            where = f"{file}: {key}"
            intrinsics = intrinsics_from_matrix(value, where)
            for part, number in intrinsics.items():
                if part in given and given[part] != number:
                    found = f"{where} says {part} = {number:g}, but {part} = {given[part]!a:.40}"
                    raise InputError(found, "leave one of them out")
            values |= intrinsics
        elif key in Camera.model_fields:
            continue
        elif name in DISTORTION_KEYS:
            distortion |= _distortion_of_key(name, value, f"{file}: {key}")
        elif alias in INTRINSICS and alias not in given and isinstance(value, int | float):
            values[alias] = value
        elif alias == "depth_scale" and alias not in given and isinstance(value, int | float) and 0 < value < LARGEST:
            foreign_scale = float(value)
        elif name in LENS_KEYS and isinstance(value, str):
            lens_model = normalize_lens_model(value)
        elif not (name in CONVENTION_KEYS and isinstance(value, str) and value.lower() in OPENCV_NAMES):
            _refuse_meaningful_key(key, value, given, str(file))
            unused.append(f"{key[:40]!a}")
    if size is not None and not {"width", "height"} & values.keys():
        values |= {"width": size[0], "height": size[1]}
    standard = file.name == "camera.json"
    notes = [f"camera.json: not used: {', '.join(unused[:12])}"] if unused and standard else []
    if unit is not None and "depth_scale" not in values:
        if foreign_scale is not None:
            unit = unit if units is None else resolve_stated_scale(units, foreign_scale)
        if unit.scale is None:
            raise InputError(f"{file}: depth_scale is missing, and {unit.reason}", DEPTH_SCALE_REMEDY)
        values = {"depth_scale": unit.scale} | values
        notes += [f"{file.name} gives no depth_scale: {unit.reason}"] if unit.reason else []
    order = COEFFICIENTS if lens_model not in FISHEYE else ("k1", "k2", "k3", "k4")
    coefficients = tuple(distortion.get(name, 0.0) for name in order)
    lens = LensDistortion(lens_model, coefficients, str(file))
    camera = camera_from_values(values, str(file))
    taken = "" if standard else file.name
    return CameraFile(camera, tuple(notes), None if lens.is_none else lens, taken, "depth_scale" in given)


def _distortion_of_key(name: str, value: object, where: str) -> dict[str, float]:
    """Coefficients by name of a list in OpenCV's order, or of a single named coefficient."""
    if value is None:
        return {}
    if isinstance(value, Mapping):
        value = cast(Mapping[str, object], value).get("data", [])
    numbers = _flatten_list(value)
    if len(numbers) > len(COEFFICIENTS) or not all(
        type(number) in (int, float) and abs(cast(float, number)) < LARGEST for number in numbers
    ):
        raise InputError(
            f"{where} = {value!a:.80} are no distortion coefficients of OpenCV",
            f"give at most {len(COEFFICIENTS)} numbers, or rectify colour and depth and leave them out",
        )
    named = [name] if name in COEFFICIENTS else COEFFICIENTS[: len(numbers)]
    return dict(zip(named, (float(cast(float, number)) for number in numbers), strict=True))


def camera_from_calibration(
    calibration: Calibration, size: tuple[int, int] | None, unit: DepthUnit | None, units: Units | None
) -> CameraFile:
    """The camera of a foreign file or of the command line; arguments as `read_camera_file`, errors likewise."""
    width, height = calibration.size or size or (0, 0)
    notes: list[str] = []
    if unit is None:
        unit = DepthUnit(MILLIMETRE)
    elif calibration.scale is not None and units is not None:
        unit = resolve_stated_scale(units, calibration.scale)
    if unit.scale is None:
        remedy = "give it as --depth-scale: metres per unit of depth, 0.001 for millimetres"
        raise InputError(f"{calibration.source}: the unit of depth is not stated, and {unit.reason}", remedy)
    if unit.reason:
        notes.append(f"the unit of depth is not stated: {unit.reason}")
    values = {name: getattr(calibration, name) for name in ("fx", "fy", "cx", "cy")}
    camera = camera_from_values(
        {**values, "width": width, "height": height, "depth_scale": unit.scale}, calibration.source
    )
    lens = LensDistortion(normalize_lens_model(calibration.lens_model), calibration.distortion, calibration.source)
    return CameraFile(camera, tuple(notes), None if lens.is_none else lens, calibration.source)


def choose_calibration(calibrations: Sequence[Calibration], size: tuple[int, int] | None, where: str) -> Calibration:
    """The colour camera among several: the only one of the photo's size, or named after colour.

    Raises:
        InputError: several are left.
    """
    named = [each for each in calibrations if re.search("color|colour|rgb", each.source, re.IGNORECASE)]
    left = named or list(calibrations)
    left = [each for each in left if each.size == size] or left
    left = [each for each in left if not re.search("depth|infra|left|right", each.source, re.IGNORECASE)] or left
    if len(left) > 1:
        names = ", ".join(each.source for each in left[:6])
        raise InputError(f"{where} holds {len(left)} cameras: {names}", "give one as --camera FX,FY,CX,CY")
    return left[0]


def _refuse_meaningful_key(key: str, value: object, values: Mapping[str, Any], where: str) -> None:
    """Refuse an unknown key that would change the result, or seems to mean a missing key."""
    name = key.lower()
    if name in CONVENTION_KEYS and "T_robot_cam" in values:
        raise InputError(
            f"{where}: {key} = {value!a:.40}, but T_robot_cam is taken to be from OpenCV's camera axes "
            "(x right, y down, z forward)",
            f"from OpenGL's axes, negate its second and third columns; then leave {key} out",
        )
    spelt = {field.lower(): field for field in Camera.model_fields if len(field) > 2}
    close = [] if name in ALIASES else get_close_matches(name, spelt, 1, 0.8)
    meant = spelt[close[0]] if close else ALIASES.get(name)
    if meant is not None and meant not in values:
        remedy = f"give {meant}: {MEANINGS[meant]}; or leave {key[:40]!a} out"
        raise InputError(f"{where}: unknown key {key[:40]!a}, and {meant} is missing", remedy)


def camera_from_values(values: Mapping[str, Any], where: str) -> Camera:
    """The camera with these values; ``where`` is named in errors.

    Raises:
        InputError: a value is missing, not finite or absurd; the principal point is a share of the picture or that of a
            picture of another size.
    """
    stated = {key: values.get(key) for key in INTRINSICS}
    numbers = {
        key: float(value) for key, value in stated.items() if isinstance(value, int | float) and abs(value) < LARGEST
    }
    if (  # intrinsics as shares of the picture's width and height, as ARKit and some SDKs give them
        len(numbers) == len(INTRINSICS)
        and min(numbers["width"], numbers["height"]) >= SMALLEST_CHECKED
        and 0 < numbers["cx"] <= 1
        and 0 < numbers["cy"] <= 1
    ):
        width, height = numbers["width"], numbers["height"]
        remedy = f"give pixels: ({numbers['cx'] * width:g}, {numbers['cy'] * height:g})"
        if max(numbers["fx"], numbers["fy"]) < 10:
            remedy += f", and fx = {numbers['fx'] * width:g}, fy = {numbers['fy'] * height:g}"
        raise InputError(
            f"{where}: the principal point ({numbers['cx']:g}, {numbers['cy']:g}) lies in 0..1: these are shares of "
            "the picture, not pixels",
            remedy,
        )
    try:
        camera = Camera.model_validate(dict(values))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"][:1])
        given = f" = {str(first['input'])[:80]}" if key and first["type"] != "missing" else ""
        remedy = f"give every one of {KEYS}, finite; T_robot_cam if calibrated, joints as a list of rad"
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(f"{where}: {key}{given}{': ' if key else ''}{problem}", remedy) from error
    # A principal point at the centre of a picture of another usual size. A crop moves it too, but hardly ever along the
    # diagonal by a usual factor.
    factors = (2 * camera.cx + 1) / camera.width, (2 * camera.cy + 1) / camera.height
    factor = sum(factors) / 2
    usual = min(OTHER_SIZES, key=lambda size: abs(size - factor))
    if max(abs(each - usual) for each in factors) < 0.05 * usual:
        fits = f"{round(camera.width * usual)}x{round(camera.height * usual)}"
        raise InputError(
            f"{where}: the principal point ({camera.cx:g}, {camera.cy:g}) is the centre of a picture of {fits}, "
            f"not of this one of {camera.width}x{camera.height}",
            f"divide fx, fy, cx and cy by {usual:.3g}, or give width and height of the picture that they belong to",
        )
    return camera


def camera_from_matrix(matrix: object, size: tuple[int, int], where: str, **more: Any) -> Camera:
    """The camera with intrinsic matrix K of a picture of ``size`` (width, height), and ``more`` fields."""
    values = {**intrinsics_from_matrix(matrix, where), "width": size[0], "height": size[1], **more}
    return camera_from_values(values, where)


def intrinsics_from_matrix(matrix: object, where: str) -> dict[str, float]:
    """``fx fy cx cy`` of the intrinsic matrix K, three rows of three numbers or nine numbers row by row."""
    rows = f"{where} = {str(matrix)[:80]} is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    remedy = "give the 3x3 intrinsic matrix of a pinhole camera, in pixels"
    flat = [float(item) for item in _flatten_list(matrix) if isinstance(item, int | float) and abs(item) < LARGEST]
    if len(flat) != 9:
        raise InputError(rows, remedy)
    fx, skew, cx, zero, fy, cy, *last = flat
    if abs(skew) > 1e-3 * abs(fx) or zero != 0 or last != [0, 0, 1]:
        raise InputError(rows, remedy)
    return {"fx": fx, "fy": fy, "cx": cx, "cy": cy}


def _flatten_list(value: object) -> list[object]:
    """Items of a list, or of a list of lists, in order; any other value is a single item."""
    rows = cast(list[object], value) if isinstance(value, list) else [value]
    return [item for row in rows for item in (cast(list[object], row) if isinstance(row, list) else [row])]


def camera_from_focal_length(focal: float, size: tuple[int, int], where: str) -> Camera:
    """A camera with square pixels that looks through the middle of its picture; ``focal`` in pixels."""
    width, height = size
    values = {"fx": focal, "fy": focal, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return camera_from_values({**values, "width": width, "height": height, "depth_scale": 0.001}, where)


def focal_length_from_35mm(millimetres: float, size: tuple[int, int]) -> float:
    """A 35 mm equivalent focal length, in pixels of a picture of ``size``."""
    width, height = size
    return millimetres / FULL_FRAME_DIAGONAL * (width * width + height * height) ** 0.5


def scale_camera_to_size(camera: Camera, width: int, height: int) -> Camera:
    """The camera of the picture scaled to another size; pixel centres are at whole numbers."""
    across, down = width / camera.width, height / camera.height
    focal = {"fx": camera.fx * across, "fy": camera.fy * down}
    center = {"cx": (camera.cx + 0.5) * across - 0.5, "cy": (camera.cy + 0.5) * down - 0.5}
    return camera.model_copy(update={**focal, **center, "width": width, "height": height})
