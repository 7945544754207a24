"""Archives: named arrays, without pickles, and none that is larger unpacked than it may be."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.scene_source import read_scene
from tests.perception.reading.conftest import Truth, npy_of, write_npz


def test_integers_need_their_scale(tmp_path: Path, truth: Truth) -> None:
    units = np.rint(truth.depth * 1000).astype(np.uint16)
    frame = read_scene(write_npz(tmp_path / "a.npz", truth, depth=units, depth_scale=0.001))
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    with pytest.raises(InputError, match="no depth_scale"):
        read_scene(write_npz(tmp_path / "b.npz", truth, depth=units))


def test_a_calibrated_archive_is(tmp_path: Path, truth: Truth) -> None:
    pose = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1.0]])
    assert read_scene(write_npz(tmp_path / "a.npz", truth, T_robot_cam=pose)).camera.T_robot_cam is not None


def test_columns_first_and_big_endian_are_read(tmp_path: Path, truth: Truth) -> None:
    depth = np.asfortranarray(truth.depth).astype(">f8")
    assert np.abs(read_scene(write_npz(tmp_path / "a.npz", truth, depth=depth)).depth - truth.depth).max() < 1e-6


@pytest.mark.parametrize("shape", [(36, 48), (36, 48, 1), (36, 48, 4)])
def test_grey_and_alpha_are_read(tmp_path: Path, truth: Truth, shape: tuple[int, ...]) -> None:
    assert read_scene(write_npz(tmp_path / "a.npz", truth, rgb=np.full(shape, 9, np.uint8))).rgb.shape == (36, 48, 3)


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("rgb", None, r"no rgb \("),
        ("depth", None, r"no depth \("),
        ("K", None, r"no K \("),
        ("rgb", np.zeros((36, 48, 3)), "rgb in"),
        ("rgb", np.zeros((36, 48, 2), np.uint8), "rgb in"),
        ("rgb", np.zeros(3, np.uint8), "rgb in"),
        ("rgb", np.zeros((0, 48, 3), np.uint8), "empty"),
        ("depth", np.zeros((36, 48), np.uint8), "depth in"),
        ("depth", np.zeros((36, 48), bool), "depth in"),
        ("depth", np.zeros((36, 48, 1)), "depth in"),
        ("depth", np.full((36, 48), np.nan), "0 of 1728 pixels"),
        ("depth", np.full((36, 48), -1.0), "0 of 1728 pixels"),
        ("depth", np.array(["far"]), "depth in"),
        ("depth", np.zeros((36, 48), complex), "depth in"),
        ("depth", np.array([{}], dtype=object), "depth in"),
        ("depth_scale", np.array([1.0, 2.0]), "depth_scale in"),
        ("depth_scale", np.nan, "depth_scale in"),
        ("depth_scale", -1, "depth_scale in"),
        ("K", np.eye(4), "K in"),
        ("K", np.zeros((3, 3)), "K in"),
        ("K", np.full((3, 3), np.nan), "K in"),
        ("K", np.array([[-60.0, 0, 23], [0, 60, 18], [0, 0, 1]]), "K in"),
        ("K", np.array([[60.0, 9, 23], [0, 60, 18], [0, 0, 1]]), "K in"),
        ("K", np.array([[60.0, 0, 23], [0, 60, 18], [0, 0, 2]]), "K in"),
        ("T_robot_cam", np.eye(3), "T_robot_cam"),
        ("T_robot_cam", 2 * np.eye(4), "T_robot_cam"),
        ("T_robot_cam", np.full((4, 4), np.inf), "T_robot_cam"),
    ],
    ids=str,
)
def test_a_wrong_array_is_named(tmp_path: Path, truth: Truth, name: str, value: Any, word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_scene(write_npz(tmp_path / "a.npz", truth, **{name: value}))


def rewritten(file: Path, name: str, content: bytes, packing: int = zipfile.ZIP_DEFLATED) -> Path:
    """The archive with one member replaced."""
    with zipfile.ZipFile(file) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    with zipfile.ZipFile(file, "w", packing) as archive:
        for member, data in (members | {f"{name}.npy": content}).items():
            archive.writestr(member, data)
    return file


def header(shape: tuple[int, ...], kind: str = "<f4") -> bytes:
    text = repr({"descr": kind, "fortran_order": False, "shape": shape}).ljust(116) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "depth in"),
        (b"\x93NUMPY", "depth in"),
        (header((36, 48))[:40], "depth in"),
        (header((36, 48)), "after 0 of"),
        (header((36, 48)) + b"\0" * 99, "after 99 of"),
        (header((10**6, 10**6)), "more than"),
        (header((2**40, 2**40)), "more than"),
        (header((-36, -48)), "shape"),
        (header((20_000, 20_000)) + b"\0" * 50_000_000, "more than"),
        (header((9000, 9000)) + b"\0" * 9_000_000, "after 9000000 of"),
        (header((36, 48), "|O"), "object"),
        (header((36, 48), "<U9"), "type <U9"),
        (header((36, 48), "|V9000000000"), "depth in"),
        (header((36, 48)).replace(b"False", b"exit("), "depth in"),
        (header((36, 48)).replace(b"\x01\x00", b"\x03\x00", 1), "version 3.0"),
        (b"\x80\x04\x95\x1a\x00\x00\x00\x00\x00\x00\x00\x8c\x05posix\x94\x8c\x06system\x94\x93\x94", "depth in"),
    ],
    ids=lambda value: str(value[:60])[:60],  # one has 50 MB
)
def test_a_forged_array_is_named(tmp_path: Path, truth: Truth, content: bytes, word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_scene(rewritten(write_npz(tmp_path / "a.npz", truth), "depth", content))


def test_what_a_scene_does_not_use_is_not_unpacked(tmp_path: Path, truth: Truth) -> None:
    file = rewritten(write_npz(tmp_path / "a.npz", truth), "bomb", header((10**6, 10**6)) + b"\0" * 90_000_000)
    assert file.stat().st_size < 200_000
    read_scene(file)


def test_an_archive_of_too_many_members_is_refused(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(InputError, match="holds 104 arrays"):
        read_scene(write_npz(tmp_path / "a.npz", truth, **{f"more{number}": 0 for number in range(100)}))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"PK\x05\x06" + b"\0" * 18, b"\0" * 100])
def test_what_is_no_archive_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.npz"):
        read_scene(tmp_path / "a.npz")


def test_an_array_under_the_name_of_an_archive_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(npy_of(np.zeros((4, 4)), tmp_path))
    with pytest.raises(InputError, match=r"not a readable \.npz"):
        read_scene(tmp_path / "a.npz")
