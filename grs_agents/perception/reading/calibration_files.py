"""Intrinsics in files of other programs: JSON, YAML, text, CSV and MATLAB, by their keys and by the form of a matrix.

Formats: ROS ``camera_info`` (``K``, ``P``, ``D``) and calibration YAML, BOP (``cam_K``), Open3D (``intrinsic_matrix``,
by columns), OpenCV's FileStorage, RealSense (``ppx``, ``coeffs``), Azure Kinect (``ModelParameters``), Record3D (``K``,
``w``, ``h``), ScanNet, GraspNet (``factor_depth``) and plain matrices.
"""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError, suggest_name
from grs_agents.base.foreign.arrays import read_npy
from grs_agents.base.foreign.files import MOST_TEXT_BYTES, MOST_VALUES_OF_DATA, parse_json, read_bytes

SUFFIXES = (".json", ".yaml", ".yml", ".txt", ".csv", ".mat", ".xml", ".ini", ".cfg", ".conf", ".info", ".k")
MATRICES = (
    *("k", "cam_k", "camera_matrix", "cameramatrix", "intrinsic_matrix", "intrinsicmatrix", "intrinsics", "intrinsic"),
    *("camera_intrinsics", "cam_intrinsics", "color_intrinsics", "rgb_intrinsics", "intrinsic_color", "cam_intrinsic"),
    *("camera_intrinsic", "m_calibrationcolorintrinsic", "depth_intrinsics", "p", "projection_matrix"),
)
"""Keys of a camera matrix, lower case; ``P`` of ROS only without another."""
NUMBERS = {
    "fx": "fx",
    "fy": "fy",
    "cx": "cx",
    "cy": "cy",
    "ppx": "cx",
    "ppy": "cy",
    "fl_x": "fx",
    "fl_y": "fy",
    "focal_x": "fx",
    "focal_y": "fy",
    "focal_length_x": "fx",
    "focal_length_y": "fy",
    "center_x": "cx",
    "principal_point_x": "cx",
    "principal_point_y": "cy",
    "center_y": "cy",
    "fx_color": "fx",
    "fy_color": "fy",
    "mx_color": "cx",
    "my_color": "cy",
    "cx_color": "cx",
    "cy_color": "cy",
    "u0": "cx",
    "v0": "cy",
}
WIDTHS = ("width", "image_width", "w", "xres", "cols", "sensorwidth", "im_w", "resolution x", "colorwidth", "img_width")
HEIGHTS = (
    *("height", "image_height", "h", "yres", "rows", "sensorheight", "im_h", "resolution y", "colorheight"),
    "img_height",
)
DISTORTIONS = (
    *("d", "distortion_coefficients", "distortion", "dist_coeffs", "coeffs", "dist", "distcoeffs"),
    *("distortion_model_coefficients", "dist_coeff"),
)
SCALES = ("depth_scale", "factor_depth", "depth_factor", "depthscale", "png_depth_scale", "depth_units")
_DEEPEST = 6
_MOST_CAMERAS = 64
_YAML_TAGS = re.compile(r"!!opencv-(?:nd-)?matrix|!<tag:[^>\n]*>")


@dataclass(frozen=True)
class Calibration:
    """A pinhole camera as a file states it; intrinsics in pixels."""

    fx: float
    fy: float
    cx: float
    cy: float
    source: str  # file and key, for notes and errors
    size: tuple[int, int] | None = None  # width and height of its picture
    distortion: tuple[float, ...] = ()  # coefficients; empty for a rectified picture
    lens_model: str = ""  # as the file names it
    scale: float | None = None  # the number under depth_scale and the like, of unknown direction

    def is_same_camera(self, calibration: "Calibration") -> bool:
        """Whether both state the same intrinsics, to a hundredth of a pixel."""
        mine, theirs = (
            (self.fx, self.fy, self.cx, self.cy),
            (calibration.fx, calibration.fy, calibration.cx, calibration.cy),
        )
        return max(abs(a - b) for a, b in zip(mine, theirs, strict=True)) < 0.01


def parse_pinhole_matrix(value: object) -> tuple[float, float, float, float] | None:
    """``fx fy cx cy`` of 9, 12 or 16 numbers, flat or nested, by rows or by columns; ``None`` for other values."""
    if isinstance(value, Mapping):  # OpenCV's FileStorage and ROS: rows, cols, data
        value = cast(Mapping[str, object], value).get("data")
    try:
        flat: npt.NDArray[np.float64] = np.asarray(value, np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        return None
    if flat.size not in (9, 12, 16) or not np.isfinite(flat).all():
        return None
    columns = 3 if flat.size == 9 else 4
    for matrix in (flat.reshape(-1, columns), flat.reshape(columns, -1).T):
        if min(matrix.shape) < 3:
            continue
        (fx, skew, cx), (zero, fy, cy), last = matrix[:3, :3].tolist()
        if fx > 0 and fy > 0 and abs(skew) <= 1e-3 * fx and zero == 0 and last == [0, 0, 1] and (cx or cy):
            return fx, fy, cx, cy
    return None


def find_calibrations(values: object, source: str, depth: int = 0) -> Iterator[Calibration]:
    """The cameras in the values of a parsed file, outermost first."""
    if depth > _DEEPEST:
        return
    if isinstance(values, Mapping):
        mapping = {str(key): value for key, value in cast(Mapping[object, object], values).items()}
        if (calibration := _calibration_of_mapping(mapping, source)) is not None:
            yield calibration
            return
        children = [(f"{source}: {key[:60]}", value) for key, value in mapping.items()]
    elif isinstance(values, Sequence) and not isinstance(values, str | bytes):
        if (numbers := parse_pinhole_matrix(cast(object, values))) is not None:
            yield Calibration(*numbers, source)
            return
        children = [(source, value) for value in cast(Sequence[object], values)[:_MOST_CAMERAS]]
    else:
        return
    for name, value in children:
        yield from find_calibrations(value, name, depth + 1)


def _calibration_of_mapping(mapping: Mapping[str, object], source: str) -> Calibration | None:
    lower = {key.lower(): value for key, value in mapping.items()}
    size: tuple[int, int] | None = None
    width, height = _first_number(lower, WIDTHS), _first_number(lower, HEIGHTS)
    if width is not None and height is not None and max(width, height) < 1e6:
        size = int(width), int(height)
    numbers: dict[str, float] = {}
    key = "fx, fy, cx, cy"
    for name, meaning in NUMBERS.items():
        value = _first_number(lower, (name,))
        if value is not None:
            numbers.setdefault(meaning, value)
    if len(numbers) < 4:
        intrinsics = lower.get("intrinsics")
        parameters: object = None
        if isinstance(intrinsics, Mapping):
            parameters = cast(Mapping[str, object], intrinsics).get("ModelParameters")
        if size is not None and isinstance(parameters, Sequence) and _all_numbers(cast(Sequence[object], parameters)):
            shares = [float(cast(float, number)) for number in cast(Sequence[object], parameters)]
            if len(shares) >= 4:  # Azure Kinect: cx cy fx fy as shares of the picture, k1 to k6, centre, p2, p1
                cx, cy, fx, fy = shares[:4]
                numbers = {"fx": fx * size[0], "fy": fy * size[1], "cx": cx * size[0] - 0.5, "cy": cy * size[1] - 0.5}
                key = "ModelParameters"
                if len(shares) >= 14:
                    lower = {**lower, "d": [shares[4], shares[5], shares[13], shares[12], *shares[6:10]]}
    if len(numbers) < 4:
        for name in MATRICES:
            matrix = parse_pinhole_matrix(lower.get(name))
            if matrix is not None:
                numbers = dict(zip(("fx", "fy", "cx", "cy"), matrix, strict=True))
                key = next(given for given in mapping if given.lower() == name)
                break
    if len(numbers) < 4:
        return None
    distortion: tuple[float, ...] = ()
    for name in DISTORTIONS:
        value = lower.get(name)
        value = cast(Mapping[str, object], value).get("data") if isinstance(value, Mapping) else value
        if isinstance(value, Sequence) and _all_numbers(cast(Sequence[object], value)):
            distortion = tuple(float(cast(float, number)) for number in cast(Sequence[object], value))
            break
    return Calibration(
        **numbers,
        source=f"{source}: {key}",
        size=size,
        distortion=distortion if any(distortion) else (),
        lens_model=lens_model if isinstance(lens_model := lower.get("distortion_model", ""), str) else "",
        scale=_first_number(lower, SCALES),
    )


def _all_numbers(values: Sequence[object]) -> bool:
    return not isinstance(values, str | bytes) and all(type(value) in (int, float) for value in values)


def _first_number(lower: Mapping[str, object], keys: Sequence[str]) -> float | None:
    """The first positive number under these keys; a number written as text counts."""
    for key in keys:
        value = lower.get(key)
        if isinstance(value, str):
            try:
                value = float(value)
            except ValueError:
                continue
        if type(value) in (int, float) and 0 < cast(float, value) < 1e9:
            return float(cast(float, value))
    return None


def read_values(file: Path) -> object:
    """The values of a calibration file: mappings, lists and numbers; ``None`` for a text of another kind.

    Raises:
        InputError: it cannot be read, is malformed, or its reader is not installed.
    """
    suffix = file.suffix.lower()
    if suffix == ".json":
        return parse_json(read_bytes(file), file, "write it as JSON", MOST_VALUES_OF_DATA)
    if suffix == ".mat":
        return _read_matlab(file)
    if suffix == ".npy":
        array = read_npy(file)
        return cast(object, array.tolist()) if array.size <= 16 else None
    data = read_bytes(file, most=MOST_TEXT_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{file} is not UTF-8 text: {error}", "write it as text") from error
    if suffix in (".yaml", ".yml"):
        return _parse_yaml(text, file)
    if suffix == ".csv":
        rows = [row for row in csv.reader(StringIO(text)) if row]
        pairs = {row[0].strip(): row[1].strip() for row in rows if len(row) == 2}
        if pairs:  # RealSense Viewer: a name and a value in each line
            return pairs
    numbers = _parse_numbers(text)
    if numbers is not None:
        return dict(zip(("fx", "fy", "cx", "cy"), numbers, strict=True)) if len(numbers) == 4 else numbers
    if text.lstrip()[:1] in ("{", "["):
        return parse_json(data, file, "write it as JSON", MOST_VALUES_OF_DATA)
    return _parse_assignments(text)


def _parse_yaml(text: str, file: Path) -> object:
    """A YAML document without aliases, which could unfold without bound; OpenCV's FileStorage too."""
    import yaml  # few scenes have any

    text = re.sub(r"^%YAML[: ].*$", "", text, flags=re.MULTILINE)
    text = _YAML_TAGS.sub("", text).expandtabs(4)
    try:
        nesting = 0
        for event in cast(Iterator[object], yaml.parse(text, Loader=yaml.SafeLoader)):
            if isinstance(event, yaml.AliasEvent):
                raise InputError(f"{file} has YAML aliases", "write its values out")
            nesting += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if nesting > 2 * _DEEPEST:
                raise InputError(f"{file} is nested deeper than {2 * _DEEPEST} levels", "give the camera alone")
        return [document for document in yaml.safe_load_all(text) if document is not None]
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{file} is not YAML: {reason}", "write it as YAML or JSON") from error


def _parse_numbers(text: str) -> list[float] | None:
    """The numbers of a text that holds nothing else but separators and comments."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "//", "%"))]
    words = re.sub(r"[,;\[\]]", " ", " ".join(lines)).split()
    try:
        return [float(word) for word in words] if 0 < len(words) <= 64 else None
    except ValueError:
        return None


def _parse_assignments(text: str) -> dict[str, object]:
    """``key = value`` and ``key: value`` lines: numbers, or lists of numbers."""
    values: dict[str, object] = {}
    for line in text.splitlines():
        if match := re.match(r"\s*([A-Za-z_][\w. ]{0,60}?)\s*[=:]\s*(.+?)\s*$", line):
            numbers = _parse_numbers(match[2])
            if numbers:
                values[match[1]] = numbers[0] if len(numbers) == 1 else numbers
    return values


def _read_matlab(file: Path) -> object:
    data = read_bytes(file, most=MOST_TEXT_BYTES)
    try:
        loadmat: Any = import_module("scipy.io").loadmat
    except ImportError as error:
        raise InputError(
            f"{file} is a MATLAB file, and the package scipy is not installed", "pip install scipy"
        ) from error
    try:
        arrays: dict[str, Any] = loadmat(BytesIO(data), chars_as_strings=True)
    except Exception as error:  # its parser raises errors of many kinds on forged files
        raise InputError(
            f"{file} is not a readable MATLAB file: {str(error)[:200]}", "write the camera as JSON"
        ) from error
    values: dict[str, object] = {}
    for name, array in arrays.items():
        if isinstance(array, np.ndarray) and array.dtype.kind in "uif" and array.size <= 16:
            flat = cast(list[float], array.reshape(-1).tolist())
            values[name] = flat[0] if len(flat) == 1 else flat
    return values


def distinct_calibrations(values: object, source: str) -> list[Calibration]:
    """The different cameras in the values of a file named ``source``."""
    distinct: list[Calibration] = []
    for calibration in find_calibrations(values, source):
        if not any(calibration.is_same_camera(earlier) for earlier in distinct):
            distinct.append(calibration)
        if len(distinct) >= _MOST_CAMERAS:
            break
    return distinct


SENSORS: dict[str, tuple[float, float]] = {
    "realsense-d405": (87, 58),
    "realsense-d415": (69, 42),
    "realsense-d435": (69, 42),
    "realsense-d455": (90, 65),
    "realsense-l515": (70, 43),
    "realsense-sr305": (68, 41.5),
    "azure-kinect": (90, 59),
    "femto-bolt": (80, 51),
    "kinect-v1": (62, 48.6),
    "kinect-v2": (84.1, 53.8),
    "primesense": (62, 48.6),
    "oak-d": (69, 54),
}
"""Published fields of view of the colour cameras, horizontal and vertical, degrees, from the makers' data sheets."""


def calibration_from_option(option: str, size: tuple[int, int]) -> Calibration:
    """The camera of ``--camera``: ``FX,FY,CX,CY[,WIDTH,HEIGHT]``, or the name of a sensor.

    A sensor's picture of another aspect ratio is a crop of its full picture: of the width if it is narrower, of the
    height if it is wider.

    Args:
        option: as given on the command line.
        size: width and height of the photo.

    Raises:
        InputError: it is neither.
    """
    width, height = size
    if (view := SENSORS.get(option.lower().replace("_", "-"))) is not None:
        tangents = [math.tan(math.radians(angle / 2)) for angle in view]
        focal = max(width / 2 / tangents[0], height / 2 / tangents[1])
        source = f"{option}'s published field of view (approximate: sizes may be off by some per cent)"
        return Calibration(focal, focal, (width - 1) / 2, (height - 1) / 2, source, size)
    numbers = _parse_numbers(option)
    if numbers is None or len(numbers) not in (4, 6) or not all(map(math.isfinite, numbers)):
        remedy = f"give FX,FY,CX,CY or FX,FY,CX,CY,WIDTH,HEIGHT in pixels, or one of {', '.join(SENSORS)}"
        raise InputError(f"--camera {option[:80]} is no camera", f"{suggest_name(option, SENSORS)}{remedy}")
    fx, fy, cx, cy = numbers[:4]
    calibration = Calibration(fx, fy, cx, cy, "--camera", size)
    return calibration if len(numbers) == 4 else replace(calibration, size=(int(numbers[4]), int(numbers[5])))
