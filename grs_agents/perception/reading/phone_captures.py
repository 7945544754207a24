"""Captures of phone apps: Record3D (``.r3d`` or unpacked), Stray Scanner and Polycam (raw folders), all of ARKit.

Depth is smaller than the photo and comes with a confidence; poses are in a world whose y axis points up."""

import stat
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeGuard, cast

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import MALFORMED
from grs_agents.base.foreign.bounded_streams import check_zip_compression, open_zip
from grs_agents.base.foreign.files import (
    MOST_JSON_BYTES,
    MOST_VALUES_OF_DATA,
    is_folder,
    list_folder_names,
    parse_json,
    path_exists,
    read_bytes,
    read_json,
    read_text,
)
from grs_agents.base.foreign.pictures import MOST_PIXELS, open_picture_bytes
from grs_agents.base.geometry.transforms import quaternion_to_matrix, to_vec3
from grs_agents.perception.reading.camera import (
    LARGEST,
    camera_from_values,
    intrinsics_from_matrix,
    scale_camera_to_size,
)
from grs_agents.perception.reading.frame_assembly import (
    MILLIMETRE,
    RecordedDepth,
    SceneRecording,
    Units,
    have_same_aspect_ratio,
)
from grs_agents.perception.reading.picture import ColorPicture, read_depth_picture, read_label_picture
from grs_agents.perception.types import Camera, Image

INSTALL = 'pip install "grs-agents[record3d]"'
MOST_DIRECTORY = 1 << 23  # bytes of the table of members: 40,000 frames of three files
MOST_MEMBER = 1 << 26
LOW_CONFIDENCE = 0  # of three levels; ARKit's guess at edges and on glass
OPENGL_TO_OPENCV = np.array([1.0, -1.0, -1.0])
MOST_VIDEO_FRAMES = 100_000


def is_record3d(path: Path) -> bool:
    """Whether this is a Record3D capture, packed or unpacked."""
    if is_folder(path):
        return path_exists(path / "metadata") and is_folder(path / "rgbd")
    return path.suffix.lower() == ".r3d"


def is_stray_folder(path: Path) -> bool:
    """Whether this is a folder of Stray Scanner."""
    return path_exists(path / "rgb.mp4") and path_exists(path / "camera_matrix.csv") and is_folder(path / "depth")


def is_polycam_folder(path: Path) -> bool:
    """Whether this is a raw folder of Polycam, or the ``keyframes`` in it."""
    return any(
        is_folder(folder / "depth") and (is_folder(folder / "cameras") or is_folder(folder / "corrected_cameras"))
        for folder in (path, path / "keyframes")
    )


def read_record3d(path: Path, choice: str = "") -> SceneRecording:
    """Read a frame of a Record3D capture, the first or that of ``choice``.

    Raises:
        InputError: it is torn or has no such frame, or no package that decompresses LZFSE is installed.
    """
    frame = _parse_frame_number(choice, path)
    where, remedy = f"{path}, metadata", "export it from Record3D again"
    with _open_members(path) as read_member:
        metadata: Any = parse_json(read_member("metadata", MOST_JSON_BYTES), where, remedy, MOST_VALUES_OF_DATA)
        if not isinstance(metadata, dict):
            raise InputError(f"{where} is no object", remedy)
        metadata = cast(dict[str, Any], metadata)
        photo, packed = read_member(f"rgbd/{frame}.jpg"), read_member(f"rgbd/{frame}.depth")
        try:
            confidence = read_member(f"rgbd/{frame}.conf")
        except KeyError:  # captures of the front camera have none
            confidence = None
    rgb = _decode_photo(photo, f"{path}, rgbd/{frame}.jpg")
    camera = _camera_of_record3d(metadata, frame, where)
    units = _unpack_lzfse(packed, np.dtype("<f4"), f"{path}, rgbd/{frame}.depth")
    units = units.reshape(_shape_of_record3d_depth(metadata, len(units), f"{path}, rgbd/{frame}.depth"))
    levels = None
    if confidence is not None:
        levels = _unpack_lzfse(confidence, np.dtype(np.uint8), f"{path}, rgbd/{frame}.conf")
        levels = levels.reshape(units.shape) if levels.size == units.size else levels
    first, pose = (_item_of(metadata.get("poses"), number) for number in (0, frame))
    up = None
    # A session that begins at the identity has the world of its first photo, which is not level.
    if _is_list_of_numbers(first, 4) and _is_list_of_numbers(pose, 4) and np.linalg.norm(first[:3]) > 1e-6:
        up = to_vec3(quaternion_to_matrix(pose[:4])[1] * OPENGL_TO_OPENCV)
    return _Parts(path, frame, "Record3D", rgb, camera, units, 1.0, levels, up).assemble()


def read_stray_folder(path: Path, choice: str = "") -> SceneRecording:
    """Read a frame of a folder of Stray Scanner. Raises InputError: it is torn, or has no such frame."""
    frame = _parse_frame_number(choice, path)
    names = [name for name in list_folder_names(path / "depth") if Path(name).suffix.lower() == ".png"]
    if frame >= len(names):
        raise InputError(f"{path} has no frame {frame}: depth has {len(names)}", "frames count from 0")
    file = path / "depth" / names[frame]
    number = int(file.stem) if file.stem.isascii() and file.stem.isdigit() and len(file.stem) < 10 else frame
    rgb = _read_video_frame(path / "rgb.mp4", number)
    rows = [[_parse_number(word) for word in row] for row in _read_rows(path / "camera_matrix.csv")]
    intrinsics = intrinsics_from_matrix(rows, str(path / "camera_matrix.csv"))
    up = None
    if path_exists(path / "odometry.csv"):
        pose = _find_odometry(path / "odometry.csv", number)
        intrinsics |= {key: pose[key] for key in intrinsics if pose.get(key, 0.0) > 0}
        if all(key in pose for key in ("qx", "qy", "qz", "qw")):
            # Poses are of a camera that looks along z, with y down.
            up = to_vec3(quaternion_to_matrix([pose[key] for key in ("qx", "qy", "qz", "qw")])[1])
    size = {"width": rgb.shape[1], "height": rgb.shape[0], "depth_scale": MILLIMETRE}
    camera = camera_from_values({**intrinsics, **size}, str(path / "camera_matrix.csv"))
    levels = path / "confidence" / file.name
    confidence = read_label_picture(levels) if path_exists(levels) else None
    units = read_depth_picture(file)
    return _Parts(path, frame, "Stray Scanner", rgb, camera, units, MILLIMETRE, confidence, up).assemble()


def read_polycam_folder(path: Path, choice: str = "") -> SceneRecording:
    """Read a key frame of a raw folder of Polycam, of the undistorted ones if there are any.

    Raises:
        InputError: it is torn, or has no such frame with photo, camera and depth.
    """
    frame = _parse_frame_number(choice, path)
    folder = path / "keyframes" if is_folder(path / "keyframes") else path
    corrected = is_folder(folder / "corrected_images") and is_folder(folder / "corrected_cameras")
    images, cameras = (folder / ("corrected_" * corrected + name) for name in ("images", "cameras"))
    photos = {Path(name).stem: images / name for name in list_folder_names(images)}
    depths = {Path(name).stem: folder / "depth" / name for name in list_folder_names(folder / "depth")}
    stems = [Path(name).stem for name in list_folder_names(cameras) if name.endswith(".json")]
    whole = sorted((stem for stem in stems if stem in photos and stem in depths), key=lambda stem: (len(stem), stem))
    if frame >= len(whole):
        remedy = "frames count from 0; export the raw data with depth" if whole else "export the raw data with depth"
        raise InputError(f"{path} has {len(whole)} frames with photo, camera and depth, no frame {frame}", remedy)
    stem = whole[frame]
    values = read_json(cameras / f"{stem}.json", "export the raw data again")
    stated = {key: values.get(key) for key in ("fx", "fy", "cx", "cy", "width", "height")}
    camera = camera_from_values({**stated, "depth_scale": MILLIMETRE}, str(cameras / f"{stem}.json"))
    second_row = [values.get(f"t_1{column}") for column in range(3)]
    up = to_vec3(np.array(second_row) * OPENGL_TO_OPENCV) if _is_list_of_numbers(second_row, 3) else None
    levels = folder / "confidence" / depths[stem].name
    rgb = _decode_photo(read_bytes(photos[stem]), str(photos[stem]))
    confidence = read_label_picture(levels) if path_exists(levels) else None
    parts = _Parts(path, frame, "Polycam", rgb, camera, read_depth_picture(depths[stem]), MILLIMETRE, confidence, up)
    recording = parts.assemble()
    return (
        recording if corrected else recording.with_note("its photos are not rectified: there are no corrected_images")
    )


@dataclass(frozen=True)
class _Parts:
    """What a capture holds of a frame."""

    path: Path
    frame: int
    app: str
    rgb: Image
    camera: Camera  # of the photo, at any size
    units: Units  # (h, w)
    scale: float  # metres per unit
    confidence: "npt.NDArray[Any] | None"  # (h, w), levels from 0
    up: Vec3 | None  # away from gravity, camera frame (OpenCV)

    def assemble(self) -> SceneRecording:
        """The recording, without depth of low confidence."""
        size, stated = (self.rgb.shape[1], self.rgb.shape[0]), (self.camera.width, self.camera.height)
        if not have_same_aspect_ratio(size, stated):
            found = f"{self.path}: the photo of frame {self.frame} is {size[0]}x{size[1]}, its camera of {stated}"
            raise InputError(found, "export it again")
        units, note = self.units, f"frame {self.frame} of a capture of {self.app}"
        if self.confidence is not None:
            if self.confidence.shape != units.shape:
                found = f"{self.path}: depth of {units.shape} and confidence of {self.confidence.shape} (rows, columns)"
                raise InputError(found, "export it again")
            doubtful = self.confidence == LOW_CONFIDENCE
            units = np.where(doubtful, units.dtype.type(0), units)
            note += f"; depth of low confidence ({doubtful.mean():.0%}) was dropped"
        camera = scale_camera_to_size(self.camera, *size).model_copy(update={"depth_scale": self.scale, "up": self.up})
        where = f"{self.path}, depth of frame {self.frame}"
        measured = RecordedDepth(units, self.scale, where, f"the app's unit ({self.app})")
        return SceneRecording(self.path, ColorPicture(self.path, self.rgb), camera, measured, notes=(note,))


@contextmanager
def _open_members(path: Path) -> Generator[Callable[..., bytes]]:
    """A function that reads a file of a capture, packed or unpacked, by its name there; KeyError for a missing file."""

    def read_file(name: str, most: int = MOST_MEMBER) -> bytes:
        if not path_exists(path / name):
            raise KeyError(name)
        return read_bytes(path / name, most=most)

    try:
        if is_folder(path):
            yield read_file
            return
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"cannot read {path}: it is no regular file", "give a .r3d")
        with path.open("rb") as file, open_zip(file, str(path), MOST_DIRECTORY) as archive:

            def read_member(name: str, most: int = MOST_MEMBER) -> bytes:
                member = archive.getinfo(name)
                check_zip_compression(member, str(path))
                with archive.open(member) as content:
                    data = content.read(most + 1)
                if len(data) > most:
                    raise InputError(f"{path}, {name[:80]} unpacks to more than {most} bytes", "export it again")
                return data

            yield read_member
    except InputError:
        raise
    except KeyError as error:
        name = str(error.args[0])[:120]
        raise InputError(f"{path} has no {name}", "frames count from 0; export it from the app again") from error
    except MALFORMED as error:
        reason = str(error)[:200] or type(error).__name__
        raise InputError(f"{path} is not a readable capture: {reason}", "export it from the app again") from error


def _parse_frame_number(text: str, path: Path) -> int:
    if text and not (text.isascii() and text.isdigit() and len(text) <= 9):
        raise InputError(f"{path}:{text} names no frame", f"write {path}:FRAME; frames count from 0")
    return int(text or 0)


def _decode_photo(data: bytes, where: str) -> Image:
    """(H, W, 3) as stored: cameras of phone captures are those of the stored pixels, whatever EXIF says."""
    with open_picture_bytes(data, where) as image:
        return np.asarray(image.convert("RGB"))


def _camera_of_record3d(metadata: Mapping[str, Any], frame: int, where: str) -> Camera:
    """Camera of a frame: its own coefficients if there are any, else K, column by column."""
    stated = _item_of(metadata.get("perFrameIntrinsicCoeffs"), frame)
    if _is_list_of_numbers(stated, 4):
        intrinsics: dict[str, float] = dict(zip(("fx", "fy", "cx", "cy"), stated[:4], strict=True))
    else:
        matrix = metadata.get("K")
        columns = matrix if _is_list_of_numbers(matrix, 9) else []
        intrinsics = intrinsics_from_matrix([columns[start::3] for start in range(3)], f"{where}: K")
    size = {"width": metadata.get("w"), "height": metadata.get("h"), "depth_scale": 1.0}
    return camera_from_values({**intrinsics, **size}, where)


def _shape_of_record3d_depth(metadata: Mapping[str, Any], count: int, where: str) -> tuple[int, int]:
    """Rows and columns of ``count`` depths: as stated, else (old versions) of the photo's aspect ratio."""
    width, height = metadata.get("dw"), metadata.get("dh")
    if type(width) is not int or type(height) is not int:
        width = max(round((count * metadata["w"] / metadata["h"]) ** 0.5), 1)
        height = count // width
    if width * height != count or not 0 < width < 10_000:
        found = f"{where} unpacks to {count} depths, not to {width!a:.20} x {height!a:.20}"
        raise InputError(found, "export it from Record3D again")
    return height, width


def _unpack_lzfse(data: bytes, dtype: "np.dtype[Any]", where: str) -> Units:
    """(N,) numbers of a file compressed by LZFSE."""
    try:
        lzfse = import_module("lzfse")
    except ImportError as error:
        raise InputError(f"{where} is compressed by LZFSE, and the package lzfse is not installed", INSTALL) from error
    try:
        unpacked: bytes = lzfse.decompress(data)
    except (lzfse.error, MemoryError) as error:
        message = f"{where} cannot be unpacked: {str(error) or type(error).__name__}"
        raise InputError(message, "export it from Record3D again") from error
    if len(unpacked) > MOST_MEMBER or len(unpacked) % dtype.itemsize:
        raise InputError(f"{where} unpacks to {len(unpacked)} bytes", "export it from Record3D again")
    return np.frombuffer(unpacked, dtype)


def _read_video_frame(file: Path, number: int) -> Image:
    """(H, W, 3) of a frame of a video, counted from 0, as stored."""
    if not (file.is_file() and number <= MOST_VIDEO_FRAMES):
        raise InputError(f"{file} is no video with a frame {number}", "export the capture again")
    video = cv2.VideoCapture(str(file), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    try:
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        size = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
        if size[0] * size[1] > MOST_PIXELS:
            raise InputError(
                f"{file} is of {size[0]:g}x{size[1]:g}, more than {MOST_PIXELS} pixels", "export it smaller"
            )
        grabbed = all(video.grab() for _ in range(number + 1))
        done, frame = video.retrieve() if grabbed else (False, None)
    finally:
        video.release()
    if not done or frame is None:
        raise InputError(f"{file} has no readable frame {number}", "choose an earlier frame, or export it again")
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB), np.uint8)


def _item_of(value: object, number: int) -> object:
    """An item of a list, ``None`` if it has none of that number or is no list."""
    items = cast(list[object], value) if isinstance(value, list) else []
    return items[number] if number < len(items) else None


def _is_list_of_numbers(value: object, least: int) -> TypeGuard[list[float]]:
    """Whether it is a list of at least so many finite numbers."""
    if not isinstance(value, list):
        return False
    items = cast(list[object], value)
    return len(items) >= least and all(isinstance(item, int | float) and abs(item) < LARGEST for item in items)


def _read_rows(file: Path) -> list[list[str]]:
    """Words of the lines of a file with commas; empty lines are left out."""
    lines = read_text(file, "export the capture again", MOST_MEMBER).splitlines()
    return [[word.strip() for word in line.split(",")] for line in lines if line.strip()]


def _find_odometry(file: Path, number: int) -> dict[str, float]:
    """Numbers of a frame in ``odometry.csv``, by the names in its first line; empty if it has no such frame."""
    names, *rows = _read_rows(file) or [[]]
    if "frame" in names:
        column = names.index("frame")
        for row in rows:
            if len(row) == len(names) and row[column].isdigit() and int(row[column][:9]) == number:
                return {
                    name: value
                    for name, word in zip(names, row, strict=True)
                    if np.isfinite(value := _parse_number(word))
                }
    return {}


def _parse_number(word: str) -> float:
    """The number that a word spells, else NaN."""
    try:
        return float(word)
    except ValueError:
        return float("nan")
