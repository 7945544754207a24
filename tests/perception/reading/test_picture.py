"""Pictures of every kind become 8-bit RGB or units of depth, the right way up; huge and torn ones are named."""

import struct
import sys
import zlib
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.scene_source import read_scene
from tests.needs import needs
from tests.perception.reading.conftest import CAMERA, Truth, png, write


def encoded(image: Image.Image, form: str = "PNG", **options: Any) -> bytes:
    data = BytesIO()
    image.save(data, form, **options)
    return data.getvalue()


def scene(folder: Path, photo: bytes, depth: bytes, name: str = "rgb.png", **camera: Any) -> Path:
    return write(folder, CAMERA | {"depth_scale": 0.001} | camera, **{name.replace(".", "__"): photo}, depth__png=depth)


def millimetres(truth: Truth) -> bytes:
    return png(np.rint(truth.depth * 1000).astype(np.uint16))


def tagged(orientation: int, focal: int = 0) -> Image.Exif:
    exif = Image.Exif()
    exif[0x0112] = orientation
    if focal:
        exif.get_ifd(0x8769)[0xA405] = focal
    return exif


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "L", "LA", "1", "CMYK", "YCbCr"])
def test_every_colour_mode_is_read(tmp_path: Path, truth: Truth, mode: str) -> None:
    photo = Image.fromarray(truth.rgb).convert(mode)
    form, name = ("JPEG", "rgb.jpg") if mode in ("CMYK", "YCbCr") else ("PNG", "color.png")
    options: dict[str, Any] = {"P": {"transparency": 3}, "YCbCr": {"quality": 95, "subsampling": 0}}.get(mode, {})
    frame = read_scene(scene(tmp_path, encoded(photo, form, **options), millimetres(truth), name))
    expected = np.asarray(photo.convert("RGB")).astype(int)
    assert np.abs(frame.rgb - expected).mean() < (30 if form == "JPEG" else 1e-9)


@pytest.mark.parametrize(("form", "name"), [("TIFF", "rgb.tif"), ("WEBP", "rgb.webp"), ("BMP", "rgb.BMP")])
def test_other_formats_are_read(tmp_path: Path, truth: Truth, form: str, name: str) -> None:
    options = {"lossless": True} if form == "WEBP" else {}
    photo = encoded(Image.fromarray(truth.rgb), form, **options)
    assert (read_scene(scene(tmp_path, photo, millimetres(truth), name)).rgb == truth.rgb).all()


@needs("pillow_heif")
@pytest.mark.parametrize("orientation", [1, 6])
def test_a_heic_photo_is_read_upright(tmp_path: Path, truth: Truth, orientation: int) -> None:
    """Its decoder turns the pixels, so that the orientation which the camera noted is done with."""
    import_module("pillow_heif").register_heif_opener()
    rows, columns = np.indices(truth.depth.shape)
    upright = np.stack([5 * columns, 7 * rows, np.full_like(rows, 90)], axis=-1).astype(np.uint8)
    stored = Image.fromarray(upright if orientation == 1 else np.rot90(upright).copy())
    photo = encoded(stored, "HEIF", quality=95, exif=tagged(orientation).tobytes())
    frame = read_scene(scene(tmp_path, photo, millimetres(truth), "rgb.heic"))
    assert np.abs(frame.rgb.astype(int) - upright).mean() < 12


def test_a_heic_photo_without_its_package_is_named(
    tmp_path: Path, truth: Truth, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    photo = b"\0\0\0\x1cftypheic" + bytes(64)
    with pytest.raises(InputError, match=r'rgb\.jpg is a HEIC photo, .*pip install "grs-agents\[heic\]"'):
        read_scene(scene(tmp_path, photo, millimetres(truth), "rgb.jpg"))


def test_sixteen_bit_colours_keep_their_upper_half(tmp_path: Path, truth: Truth) -> None:
    photo = png(truth.rgb.astype(np.uint16) * 257)
    assert np.abs(read_scene(scene(tmp_path, photo, millimetres(truth))).rgb - truth.rgb.astype(int)).max() <= 1


@pytest.mark.parametrize("kind", [np.uint16, np.int32, np.float32])
def test_depth_in_tiff_has_any_type(tmp_path: Path, truth: Truth, kind: type) -> None:
    scale = 1.0 if kind is np.float32 else 0.001
    units = (truth.depth / scale if kind is np.float32 else np.rint(truth.depth / scale)).astype(kind)
    content = encoded(Image.fromarray(units), "TIFF")
    folder = write(tmp_path, CAMERA | {"depth_scale": scale}, rgb__png=png(truth.rgb), depth__tiff=content)
    frame = read_scene(folder)
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    assert (frame.depth / frame.camera.depth_scale).max() < 65536  # it can be kept in 16 bits


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_turned_photo_is_turned_if_depth_and_camera_are(tmp_path: Path, truth: Truth, orientation: int) -> None:
    stored = np.ascontiguousarray(
        {
            5: truth.rgb.transpose(1, 0, 2),
            6: np.rot90(truth.rgb),
            7: truth.rgb[::-1, ::-1].transpose(1, 0, 2),
            8: np.rot90(truth.rgb, -1),
        }[orientation]
    )
    photo = encoded(Image.fromarray(stored), "PNG", exif=tagged(orientation))
    assert (read_scene(scene(tmp_path, photo, millimetres(truth))).rgb == truth.rgb).all()


def test_a_turned_photo_stays_if_depth_and_camera_are_the_stored_ones(tmp_path: Path, truth: Truth) -> None:
    photo = encoded(Image.fromarray(truth.rgb), "PNG", exif=tagged(6))
    assert (read_scene(scene(tmp_path, photo, millimetres(truth))).rgb == truth.rgb).all()


def test_half_a_turn_cannot_be_told_and_is_refused(tmp_path: Path, truth: Truth) -> None:
    photo = encoded(Image.fromarray(truth.rgb), "PNG", exif=tagged(3))
    with pytest.raises(InputError, match="EXIF orientation 3"):
        read_scene(scene(tmp_path, photo, millimetres(truth)))


def huge_png(width: int, height: int) -> bytes:
    """A PNG that promises much and holds one row."""
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(b"\0" * 100)))
    parts = [
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize("size", [(9000, 9000), (60_000, 60_000), (2**31 - 1, 2**31 - 1)])
def test_a_huge_picture_is_refused_by_its_header(tmp_path: Path, truth: Truth, size: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=r"rgb.png.*pixels"):
        read_scene(scene(tmp_path, huge_png(*size), millimetres(truth)))


@pytest.mark.parametrize(
    ("depth", "word"),
    [
        (np.arange(36 * 48 * 3, dtype=np.uint16).reshape(36, 48, 3), "3 channels of uint16"),
        (np.full((36, 48), 90, np.uint8), "1 channels of uint8"),
        (np.full((36, 48, 4), 90, np.uint8), "4 channels"),
    ],
)
def test_depth_of_another_kind_is_refused(tmp_path: Path, truth: Truth, depth: Any, word: str) -> None:
    with pytest.raises(InputError, match=f"depth.png has {word}"):
        read_scene(scene(tmp_path, png(truth.rgb), png(depth)))


def test_depth_that_was_saved_as_three_equal_channels_of_16_bits_is_read(tmp_path: Path, truth: Truth) -> None:
    units = np.rint(truth.depth * 1000).astype(np.uint16)
    written = scene(tmp_path, png(truth.rgb), png(np.repeat(units[..., None], 3, axis=2)))
    assert np.abs(read_scene(written).depth - truth.depth).max() <= 0.0006


def test_depth_in_a_palette_is_refused(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(InputError, match="palette"):
        read_scene(scene(tmp_path, png(truth.rgb), encoded(Image.fromarray(truth.labels).convert("P"))))
