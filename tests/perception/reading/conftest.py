"""One small scene, a slanted plane with a step on it, written in every form that scenes are read from."""

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

WIDTH, HEIGHT, FX, FY, CX, CY = 48, 36, 60.0, 62.0, 23.0, 18.5
CAMERA = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH, "height": HEIGHT}


@dataclass(frozen=True)
class Truth:
    """What every form tells: colours (H, W, 3), depth (H, W) in metres, and masks of two things."""

    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float64]
    labels: npt.NDArray[np.uint8]

    @property
    def points(self) -> npt.NDArray[np.float32]:
        """(H, W, 3) in the camera's frame; NaN where there is no depth."""
        rows, columns = np.indices(self.depth.shape)
        z = np.where(self.depth > 0, self.depth, np.nan)
        return np.stack([(columns - CX) / FX * z, (rows - CY) / FY * z, z], axis=-1).astype(np.float32)


def make_truth() -> Truth:
    rows, columns = np.indices((HEIGHT, WIDTH))
    rgb = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    depth = 0.9 - 0.002 * rows + 0.001 * columns
    depth[10:20, 10:25] -= 0.1
    depth[5:8, 40:] = 0
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[10:20, 10:25], labels[25:30, 30:40] = 3, 7
    return Truth(rgb, np.round(depth, 3), labels)


@pytest.fixture(scope="session")
def truth() -> Truth:
    """The small scene."""
    return make_truth()


def png(image: npt.NDArray[Any]) -> bytes:
    """A picture as PNG; colours are given as RGB."""
    return cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)[1].tobytes()


def write(folder: Path, camera: dict[str, Any] | None = None, **files: bytes) -> Path:
    """Write files, their names with ``__`` for the dot, and ``camera.json``."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name.replace("__", ".")).write_bytes(content)
    if camera is not None:
        (folder / "camera.json").write_text(json.dumps(camera))
    return folder


def ply_of(points: npt.NDArray[Any], form: str = "binary_little_endian") -> bytes:
    """A PLY file with a colour and a face element around the points."""
    flat = points.reshape(-1, 3)
    head = f"ply\nformat {form} 1.0\ncomment of a test\nelement vertex {len(flat)}\n"
    head += "property float x\nproperty uchar red\nproperty double y\nproperty float z\n"
    head += "element face 0\nproperty list uchar int vertex_indices\nend_header\n"
    if form == "ascii":
        body = "".join(f"{x:.9g} 7 {y:.9g} {z:.9g}\n" for x, y, z in flat).encode()
    else:
        order = "<" if form == "binary_little_endian" else ">"
        body = b"".join(struct.pack(f"{order}fBdf", x, 7, y, z) for x, y, z in flat)
    return head.encode() + body


def pcd_of(points: npt.NDArray[Any], form: str = "binary", organised: bool = True) -> bytes:
    """A PCD file with a descriptor of two numbers before the coordinates."""
    flat = points.reshape(-1, 3).astype("<f4")
    rows, columns = points.shape[:2] if organised else (1, len(flat))
    head = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS d rgb x y z\nSIZE 1 4 4 4 4\n"
    head += f"TYPE U F F F F\nCOUNT 2 1 1 1 1\nWIDTH {columns}\nHEIGHT {rows}\nVIEWPOINT 0 0 0 1 0 0 0\n"
    head += f"POINTS {len(flat)}\nDATA {form}\n"
    if form == "ascii":
        body = "".join(f"1 2 0.5 {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in flat).encode()
    elif form == "binary":
        body = b"".join(struct.pack("<BBffff", 1, 2, 0.5, *point) for point in flat)
    else:
        data = bytes([1, 2]) * len(flat) + struct.pack("<f", 0.5) * len(flat) + flat.T.copy().tobytes()
        packed = lzf_packed(data)
        body = struct.pack("<II", len(packed), len(data)) + packed
    return head.encode() + body


def lzf_packed(data: bytes) -> bytes:
    """LZF by the simplest means: copies of what was three or more bytes long before, else literals."""
    out, literal, seen, at = bytearray(), bytearray(), dict[bytes, int](), 0

    def flush() -> None:
        for start in range(0, len(literal), 32):
            part = literal[start : start + 32]
            out.extend([len(part) - 1, *part])
        literal.clear()

    while at < len(data):
        key = data[at : at + 3]
        back = at - seen.get(key, at) - 1
        seen[key] = at
        if len(key) == 3 and 0 <= back < 8192:
            length = 3
            while length < 264 and at + length < len(data) and data[at + length] == data[at + length - back - 1]:
                length += 1
            flush()
            code = length - 2
            head = [(code << 5) | (back >> 8)] if code < 7 else [(7 << 5) | (back >> 8), code - 7]
            out.extend([*head, back & 255])
            at += length
        else:
            literal.append(data[at])
            at += 1
    flush()
    return bytes(out)


def npy_of(array: npt.NDArray[Any], folder: Path) -> bytes:
    """An array as ``.npy``."""
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "array.npy", array)
    data = (folder / "array.npy").read_bytes()
    (folder / "array.npy").unlink()
    return data


def write_bop(root: Path, truth: Truth, depth_scale: float = 0.1) -> Path:
    """A BOP data set of one scene with one image; the path to give."""
    scene = root / "test" / "000048"
    for name, image in (
        ("rgb/000012.png", truth.rgb),
        ("depth/000012.png", np.rint(truth.depth * 1000 / depth_scale).astype(np.uint16)),
        ("mask_visib/000012_000000.png", (truth.labels == 3).astype(np.uint8) * 255),
        ("mask_visib/000012_000001.png", (truth.labels == 7).astype(np.uint8) * 255),
    ):
        (scene / name).parent.mkdir(parents=True, exist_ok=True)
        (scene / name).write_bytes(png(image))
    entry = {"cam_K": [FX, 0.0, CX, 0.0, FY, CY, 0.0, 0.0, 1.0], "depth_scale": depth_scale}
    (scene / "scene_camera.json").write_text(json.dumps({"12": entry}))
    return Path(f"bop:{root}/test/48/12")


def write_npz(file: Path, truth: Truth, **changes: Any) -> Path:
    """An archive; ``None`` leaves an array out."""
    arrays: dict[str, Any] = {
        "rgb": truth.rgb,
        "depth": truth.depth.astype(np.float32),
        "K": np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]]),
        "masks": truth.labels,
    }
    arrays = {name: value for name, value in (arrays | changes).items() if value is not None}
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(file, **arrays)
    return file


Writer = Callable[[Path, Truth], Path]


def _folder(folder: Path, truth: Truth) -> Path:
    millimetres = np.rint(truth.depth * 1000).astype(np.uint16)
    return write(folder, CAMERA | {"depth_scale": 0.001}, rgb__png=png(truth.rgb), depth__png=png(millimetres))


def _cloud(name: str, content: Callable[[Truth, Path], bytes]) -> Writer:
    def make(folder: Path, truth: Truth) -> Path:
        return write(folder, CAMERA, rgb__png=png(truth.rgb), **{name: content(truth, folder)})

    return make


def _shuffled(truth: Truth) -> npt.NDArray[np.float32]:
    return np.random.default_rng(1).permutation(truth.points.reshape(-1, 3))


FORMS: dict[str, Writer] = {
    "folder": _folder,
    "depth.npy": _cloud("depth__npy", lambda truth, folder: npy_of(truth.depth, folder)),
    "ply": _cloud("cloud__ply", lambda truth, _: ply_of(truth.points)),
    "ply big": _cloud("scan__PLY", lambda truth, _: ply_of(_shuffled(truth), "binary_big_endian")),
    "ply text": _cloud("cloud__ply", lambda truth, _: ply_of(_shuffled(truth), "ascii")),
    "pcd": _cloud("cloud__pcd", lambda truth, _: pcd_of(truth.points)),
    "pcd text": _cloud("cloud__pcd", lambda truth, _: pcd_of(truth.points, "ascii", organised=False)),
    "pcd packed": _cloud("cloud__pcd", lambda truth, _: pcd_of(truth.points, "binary_compressed")),
    "npy": _cloud("cloud__npy", lambda truth, folder: npy_of(truth.points, folder)),
    "npy list": _cloud("cloud__npy", lambda truth, folder: npy_of(_shuffled(truth), folder)),
    "npy grid": _cloud("z__npy", lambda truth, folder: npy_of(truth.depth, folder)),
    "npz": lambda folder, truth: write_npz(folder / "scene.npz", truth),
    "bop": write_bop,
}
"""Each form by name: writes the scene and says what to read."""
