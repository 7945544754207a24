"""Clouds: what their formats say, and how they become depth at the photo's pixels."""

import contextlib
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.point_cloud_files import decompress_lzf
from grs_agents.perception.reading.scene_source import read_scene
from tests.perception.reading.conftest import CAMERA, Truth, lzf_packed, npy_of, pcd_of, ply_of, png, write


def scene(folder: Path, truth: Truth, content: bytes, name: str = "cloud__npy", **camera: Any) -> Path:
    return write(folder, CAMERA | camera, rgb__png=png(truth.rgb), **{name: content})


def listed(truth: Truth) -> Any:
    points = truth.points.reshape(-1, 3)
    return points[np.isfinite(points[:, 2])]


def test_the_nearest_point_in_a_pixel_counts(tmp_path: Path, truth: Truth) -> None:
    behind = listed(truth) * 1.5
    for order in ([listed(truth), behind], [behind, listed(truth)]):
        frame = read_scene(scene(tmp_path, truth, npy_of(np.concatenate(order), tmp_path)))
        assert np.abs(frame.depth - truth.depth).max() < 1e-5


def test_holes_stay_empty(tmp_path: Path, truth: Truth) -> None:
    frame = read_scene(scene(tmp_path, truth, npy_of(listed(truth), tmp_path)))
    assert not frame.depth[truth.depth == 0].any()


def test_a_sparse_cloud_is_closed_by_larger_points(tmp_path: Path, truth: Truth) -> None:
    points = truth.points[::2, ::2].reshape(-1, 3)
    frame = read_scene(scene(tmp_path, truth, npy_of(points, tmp_path)))
    assert (frame.depth[10:-2, 2:38] > 0).all()
    assert np.abs(frame.depth - truth.depth)[22:-2, 2:-2].max() < 0.01
    assert any("3 pixels wide" in note for note in frame.notes)


def test_a_cloud_too_sparse_for_the_photo_is_refused(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(InputError, match="pixels apart"):
        read_scene(scene(tmp_path, truth, npy_of(truth.points[::12, ::12].reshape(-1, 3), tmp_path)))


def test_a_cloud_in_millimetres_needs_its_scale(tmp_path: Path, truth: Truth) -> None:
    content = npy_of(listed(truth) * 1000, tmp_path)
    with pytest.raises(InputError, match=r"with depth_scale 0.001 it would be"):
        read_scene(scene(tmp_path, truth, content))
    assert np.abs(read_scene(scene(tmp_path, truth, content, depth_scale=0.001)).depth - truth.depth).max() < 1e-5


@pytest.mark.parametrize("axes", [(1, -1, -1), (1, 1, -1)])
def test_a_cloud_in_another_frame_is_refused(tmp_path: Path, truth: Truth, axes: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match=r"behind it.*camera's frame"):
        read_scene(scene(tmp_path, truth, npy_of(listed(truth) * axes, tmp_path)))


def test_an_organised_cloud_of_another_camera_is_projected(tmp_path: Path, truth: Truth) -> None:
    """Its grid is turned by half a turn, its points are not."""
    frame = read_scene(scene(tmp_path, truth, pcd_of(truth.points[::-1, ::-1]), "cloud__pcd"))
    assert np.abs(frame.depth - truth.depth).max() < 1e-5
    assert any("as the camera sees them" in note for note in frame.notes)


def test_a_small_organised_cloud_may_have_the_camera(tmp_path: Path, truth: Truth) -> None:
    large = Truth(np.repeat(np.repeat(truth.rgb, 2, 0), 2, 1), truth.depth, truth.labels)
    frame = read_scene(scene(tmp_path, large, pcd_of(truth.points), "cloud__pcd"))
    assert frame.depth.shape == (72, 96)
    assert frame.camera.fx == 120


PLY = ply_of(np.ones((4, 3)), "ascii")
PCD = pcd_of(np.ones((1, 4, 3)), "ascii")
BINARY = pcd_of(np.ones((1, 4, 3)))
PACKED = pcd_of(np.ones((1, 4, 3)), "binary_compressed")


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("cloud__ply", b"", "does not begin"),
        ("cloud__ply", b"ply\n", "end_header"),
        ("cloud__ply", b"ply\n" + b"comment\n" * 20_000, "end_header"),
        ("cloud__ply", PLY.replace(b"ascii", b"morse"), "morse"),
        ("cloud__ply", PLY.replace(b"format ascii 1.0\n", b""), "format"),
        ("cloud__ply", PLY.replace(b"vertex 4", b"vertex 1000000000"), "1000000000 points"),
        ("cloud__ply", PLY.replace(b"vertex 4", b"vertex -4"), "-4"),
        ("cloud__ply", PLY.replace(b"vertex 4", b"vertex 9999999999999999999999"), "9999999"),
        ("cloud__ply", PLY.replace(b"vertex 4", b"vertex 0"), "0 points"),
        ("cloud__ply", PLY.replace(b"vertex 4", b"vertex 5"), "after 4 of 5"),
        ("cloud__ply", PLY.replace(b"element vertex", b"element vertices"), "vertex"),
        ("cloud__ply", PLY.replace(b"float z", b"float w"), "x, red, y, w"),
        ("cloud__ply", PLY.replace(b"uchar red", b"float x"), "x, x, y, z"),
        ("cloud__ply", PLY.replace(b"uchar red", b"list uchar int red"), "list"),
        ("cloud__ply", PLY.replace(b"float z", b"quad z"), "quad"),
        ("cloud__ply", PLY.replace(b"7 1", b"7 one"), "one"),
        ("cloud__ply", b"ply\nformat ascii 1.0\nelement face 1\nelement vertex 4\nend_header\n", "before"),
        ("cloud__ply", b"ply\nformat \xff\nend_header\n", "no text"),
        ("cloud__pcd", b"", "DATA"),
        ("cloud__pcd", PCD.replace(b"FIELDS", b"FELDS"), "no FIELDS"),
        ("cloud__pcd", PCD.replace(b"x y z", b"x y"), "FIELDS, SIZE"),
        ("cloud__pcd", PCD.replace(b"WIDTH 4", b"WIDTH 1000000000"), "4 points in 1 rows of 1000000000"),
        ("cloud__pcd", PCD.replace(b"POINTS 4", b"POINTS 1000000000"), "1000000000 points"),
        ("cloud__pcd", PCD.replace(b"COUNT 2", b"COUNT 99999"), "99999|100003"),
        ("cloud__pcd", PCD.replace(b"SIZE 1 4", b"SIZE 1 3"), "SIZE 3"),
        ("cloud__pcd", PCD.replace(b"DATA ascii", b"DATA brotli"), "brotli"),
        ("cloud__pcd", PCD[:-20], "row 3"),
        ("cloud__pcd", BINARY[:-1], "of 72 bytes"),
        ("cloud__pcd", PACKED[:-1], "promises"),
        ("cloud__pcd", PACKED.replace(struct.pack("<I", 72), struct.pack("<I", 2**32 - 1)), "promises"),
        ("cloud__npy", b"", "not a readable array"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_malformed_cloud_is_named(tmp_path: Path, truth: Truth, name: str, content: bytes, word: str) -> None:
    with pytest.raises(InputError, match=f"cloud.*({word})"):
        read_scene(scene(tmp_path, truth, content, name))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e38])
def test_points_that_are_none_are_named(tmp_path: Path, truth: Truth, value: float) -> None:
    with pytest.raises(InputError, match=r"cloud.npy"):
        read_scene(scene(tmp_path, truth, npy_of(np.full((500, 3), value), tmp_path)))


@given(data=st.binary(max_size=400), repeat=st.integers(1, 30))
def test_what_was_packed_is_unpacked(data: bytes, repeat: int) -> None:
    assert decompress_lzf(lzf_packed(data * repeat), len(data) * repeat, "x") == data * repeat


@given(data=st.binary(max_size=60), size=st.integers(0, 500))
def test_what_nobody_packed_is_refused_or_of_the_promised_size(data: bytes, size: int) -> None:
    with contextlib.suppress(InputError):
        assert len(decompress_lzf(data, size, "x")) == size
