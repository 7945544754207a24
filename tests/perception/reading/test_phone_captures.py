"""Captures of phone apps: photo, smaller depth with its confidence, camera, and the direction of gravity."""

import json
import os
import sys
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.foreign_scene import read_foreign_scene
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene
from tests.needs import needs
from tests.perception.reading.conftest import png

WIDTH, HEIGHT, FACTOR = 96, 72, 3
FX, FY, CX, CY = 80.0, 82.0, 46.0, 37.5
TILT = np.deg2rad(30)
ARKIT = [-np.sin(TILT / 2), 0.0, 0.0, np.cos(TILT / 2), 0.1, 1.4, 0.2]
"""Pose (x, y, z, w, position) of a camera that looks 30 degrees down, with OpenGL's axes."""
UP = (0.0, -np.cos(TILT), -np.sin(TILT))
"""Away from gravity in that camera's frame, with OpenCV's axes."""


def photo(number: int = 0) -> npt.NDArray[np.uint8]:
    smooth = np.random.default_rng(number).integers(0, 255, (4, 4, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(smooth, (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR), np.uint8)


def metres(number: int = 0) -> npt.NDArray[np.float32]:
    rows, columns = np.indices((HEIGHT // FACTOR, WIDTH // FACTOR))
    return (0.9 + 0.1 * number - 0.004 * rows + 0.002 * columns).astype(np.float32)


def confidence() -> npt.NDArray[np.uint8]:
    levels = np.full((HEIGHT // FACTOR, WIDTH // FACTOR), 2, np.uint8)
    levels[:4], levels[4:8] = 0, 1
    return levels


def jpeg(number: int = 0) -> bytes:
    return cv2.imencode(".jpg", photo(number)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()


def assert_read(source: Path, number: int = 0, up: tuple[float, ...] | None = UP, dropped: bool = True) -> None:
    check_scene_source(source)
    for frame in [read_scene(source), *([read_foreign_scene(source)] if ":" in source.name else [])]:
        assert frame.rgb.shape == (HEIGHT, WIDTH, 3)
        assert np.abs(frame.rgb.astype(int) - photo(number)).mean() < 6
        camera = frame.camera
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((FX, FY, CX, CY))
        truth = cv2.resize(metres(number), (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
        inside = np.s_[6 * FACTOR :] if dropped else np.s_[:]
        assert np.abs(frame.depth[inside] - truth[inside]).max() < 5e-3
        assert not dropped or not frame.depth[: 3 * FACTOR].any()
        assert camera.up == (None if up is None else pytest.approx(up, abs=1e-6))


def members(frames: int = 2, **changes: Any) -> dict[str, bytes]:
    """The files of a capture of Record3D."""
    compress = import_module("lzfse").compress
    metadata: dict[str, Any] = {
        "K": [FX, 0, 0, 0, FY, 0, CX, CY, 1],
        "w": WIDTH,
        "h": HEIGHT,
        "dw": WIDTH // FACTOR,
        "dh": HEIGHT // FACTOR,
        "fps": 30,
        "poses": [ARKIT] * frames,
    }
    metadata = {key: value for key, value in (metadata | changes).items() if value is not None}
    files = {"metadata": json.dumps(metadata).encode()}
    for number in range(frames):
        files[f"rgbd/{number}.jpg"] = jpeg(number)
        files[f"rgbd/{number}.depth"] = compress(metres(number).astype("<f4").tobytes())
        files[f"rgbd/{number}.conf"] = compress(confidence().tobytes())
    return files


def packed(file: Path, content: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return file


def unpacked(folder: Path, content: dict[str, bytes]) -> Path:
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


@needs("lzfse")
def test_record3d_is_read_packed_and_unpacked(tmp_path: Path) -> None:
    assert_read(packed(tmp_path / "desk.r3d", members()))
    assert_read(Path(f"{packed(tmp_path / 'deflated.r3d', members(), zipfile.ZIP_DEFLATED)}:1"), 1)
    assert_read(unpacked(tmp_path / "folder", members()))


@needs("lzfse")
def test_record3d_without_what_old_versions_lack(tmp_path: Path) -> None:
    content = members(dw=None, dh=None, poses=None)
    content = {name: data for name, data in content.items() if not name.endswith(".conf")}
    assert_read(packed(tmp_path / "desk.r3d", content), up=None, dropped=False)


@needs("lzfse")
def test_record3d_with_a_camera_for_each_frame(tmp_path: Path) -> None:
    coefficients = [[70.0, 70.0, CX, CY], [FX, FY, CX, CY]]
    assert_read(Path(f"{packed(tmp_path / 'desk.r3d', members(perFrameIntrinsicCoeffs=coefficients))}:1"), 1)


@needs("lzfse")
def test_a_session_that_begins_at_the_identity_says_nothing_of_gravity(tmp_path: Path) -> None:
    poses = [[0, 0, 0, 1, 0, 0, 0], ARKIT]
    assert_read(Path(f"{packed(tmp_path / 'desk.r3d', members(poses=poses))}:1"), 1, up=None)


@needs("lzfse")
@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"K": None}, "K = "),
        ({"K": [FX, 0, CX, 0, FY, CY, 0, 0, 1]}, "K = "),
        ({"w": 0}, "width"),
        ({"w": WIDTH // 2}, "its camera of"),
        ({"dw": 31}, "unpacks to 768 depths, not to 31 x 24"),
        ({"dw": 10**9, "dh": 10**9}, "unpacks to 768 depths"),
    ],
    ids=str,
)
def test_metadata_that_does_not_fit_is_named(tmp_path: Path, change: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_scene(packed(tmp_path / "desk.r3d", members(**change)))


@needs("lzfse")
@pytest.mark.parametrize("name", ["metadata", "rgbd/0.jpg", "rgbd/0.depth", "rgbd/0.conf"])
@pytest.mark.parametrize(
    "content", [b"", b"[]", b"bvx2" + b"\xff" * 60, b"bvxn\xff\xff\xff\xff\xff\xff\xff\xff", b"\0" * 99]
)
def test_a_torn_member_is_named(tmp_path: Path, name: str, content: bytes) -> None:
    with pytest.raises(InputError, match=r"desk\.r3d") as caught:
        read_scene(packed(tmp_path / "desk.r3d", members() | {name: content}))
    assert "\n" not in str(caught.value)


@needs("lzfse")
def test_a_missing_frame_and_a_torn_archive_are_named(tmp_path: Path) -> None:
    file = packed(tmp_path / "desk.r3d", members())
    with pytest.raises(InputError, match=r"desk\.r3d has no .*2\.jpg.*frames count from 0"):
        read_scene(Path(f"{file}:2"))
    with pytest.raises(InputError, match=r"desk\.r3d:/depth names no frame"):
        read_scene(Path(f"{file}:/depth"))
    file.write_bytes(file.read_bytes()[:-30])
    with pytest.raises(InputError, match=r"desk\.r3d is not a readable capture"):
        read_scene(file)


@needs("lzfse")
def test_depth_that_unpacks_to_a_gigabyte_is_refused(tmp_path: Path) -> None:
    blocks = import_module("lzfse").compress(bytes(1 << 20)).removesuffix(b"bvx$")
    bomb = blocks * 1024 + b"bvx$"
    assert len(bomb) < 1 << 20
    with pytest.raises(InputError, match=r"desk\.r3d"):
        read_foreign_scene(packed(tmp_path / "desk.r3d", members() | {"rgbd/0.depth": bomb}))


@needs("lzfse")
def test_a_photo_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    content = members() | {"rgbd/0.jpg": bytes(1 << 27)}
    with pytest.raises(InputError, match=r"rgbd/0\.jpg unpacks to more than"):
        read_scene(packed(tmp_path / "desk.r3d", content, zipfile.ZIP_DEFLATED))


def test_without_the_package_the_error_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lzfse", None)
    content = {"metadata": json.dumps({"K": [FX, 0, 0, 0, FY, 0, CX, CY, 1], "w": WIDTH, "h": HEIGHT}).encode()}
    content |= {"rgbd/0.jpg": jpeg(), "rgbd/0.depth": b"bvx2"}
    with pytest.raises(InputError, match=r'lzfse is not installed; pip install "grs-agents\[record3d\]"'):
        read_scene(packed(tmp_path / "desk.r3d", content))


def stray(folder: Path, frames: int = 3) -> Path:
    """A folder of Stray Scanner."""
    for name in ("depth", "confidence"):
        (folder / name).mkdir(parents=True)
    video = cv2.VideoWriter(str(folder / "rgb.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30, (WIDTH, HEIGHT))
    # Poses of a camera that looks along z with y down: half a turn about x from ARKit's.
    angle = TILT + np.pi
    pose = f"0.1, 1.4, 0.2, {-np.sin(angle / 2)}, 0.0, 0.0, {np.cos(angle / 2)}"
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for number in range(frames):
        video.write(photo(number)[..., ::-1])
        (folder / f"depth/{number:06d}.png").write_bytes(png(np.rint(metres(number) * 1000).astype(np.uint16)))
        (folder / f"confidence/{number:06d}.png").write_bytes(png(confidence()))
        lines.append(f"{number / 60}, {number:06d}, {pose}")
    video.release()
    (folder / "camera_matrix.csv").write_text(f"{FX}, 0.0, {CX}\n0.0, {FY}, {CY}\n0.0, 0.0, 1.0\n")
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_a_folder_of_stray_scanner_is_read(tmp_path: Path) -> None:
    folder = stray(tmp_path / "1f2e3d4c5b")
    assert_read(folder)
    assert_read(Path(f"{folder}:2"), 2)


def test_a_folder_of_stray_scanner_without_poses_and_confidence(tmp_path: Path) -> None:
    folder = stray(tmp_path / "1f2e3d4c5b")
    (folder / "odometry.csv").unlink()
    for file in (folder / "confidence").iterdir():
        file.unlink()
    assert_read(folder, up=None, dropped=False)


def test_columns_of_odometry_override_the_camera(tmp_path: Path) -> None:
    folder = stray(tmp_path / "1f2e3d4c5b")
    (folder / "camera_matrix.csv").write_text(f"70, 0, {CX}\n0, 70, {CY}\n0, 0, 1\n")
    (folder / "odometry.csv").write_text(f"timestamp, frame, fx, fy, cx, cy\n0.0, 000000, {FX}, {FY}, {CX}, {CY}\n")
    assert_read(folder, up=None)


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("rgb.mp4", b"", r"rgb\.mp4 has no readable frame 0"),
        ("rgb.mp4", b"\0\0\0\x18ftypmp42" + bytes(100), r"rgb\.mp4 has no readable frame 0"),
        ("camera_matrix.csv", b"", r"camera_matrix\.csv"),
        ("camera_matrix.csv", b"1,2\n", r"camera_matrix\.csv"),
        ("camera_matrix.csv", b"\xff" * 9, r"camera_matrix\.csv"),
        ("odometry.csv", b"\xff" * 9, r"odometry\.csv"),
        ("depth/000000.png", b"", r"000000\.png"),
        ("confidence/000000.png", b"", r"000000\.png"),
    ],
)
def test_a_torn_file_of_stray_scanner_is_named(tmp_path: Path, name: str, content: bytes, word: str) -> None:
    folder = stray(tmp_path / "1f2e3d4c5b")
    (folder / name).write_bytes(content)
    with pytest.raises(InputError, match=word):
        read_scene(folder)


def test_odd_odometry_is_passed_over(tmp_path: Path) -> None:
    folder = stray(tmp_path / "1f2e3d4c5b")
    for text in (
        "",
        "frame\nx\n",
        "timestamp, frame, qx\n0, 0\n",
        f"frame, qx, qy, qz, qw\n{'9' * 5000}, 0, 0, 0, 1\n",
    ):
        (folder / "odometry.csv").write_text(text)
        assert read_scene(folder).camera.up is None


def test_frames_beyond_the_end_are_named(tmp_path: Path) -> None:
    folder = stray(tmp_path / "1f2e3d4c5b")
    with pytest.raises(InputError, match="no frame 3: depth has 3"):
        read_scene(Path(f"{folder}:3"))
    (folder / "depth/000009.png").write_bytes((folder / "depth/000000.png").read_bytes())
    with pytest.raises(InputError, match=r"rgb\.mp4 has no readable frame 9"):
        read_scene(Path(f"{folder}:3"))


def polycam(folder: Path, corrected: bool = True) -> Path:
    """A raw folder of Polycam with two key frames, and one without depth before them."""
    keyframes = folder / "keyframes"
    prefix = "corrected_" if corrected else ""
    for name in (f"{prefix}images", f"{prefix}cameras", "depth", "confidence"):
        (keyframes / name).mkdir(parents=True)
    cosine, sine = np.cos(TILT), np.sin(TILT)
    matrix = {"t_00": 1.0, "t_01": 0.0, "t_02": 0.0, "t_10": 0.0, "t_11": cosine, "t_12": sine}
    matrix |= {"t_20": 0.0, "t_21": -sine, "t_22": cosine, "t_03": 0.1, "t_13": 1.4, "t_23": 0.2}
    camera = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH, "height": HEIGHT, "blur_score": 3.0}
    for number, stem in enumerate(("99", "1000", "1033"), start=-1):
        (keyframes / f"{prefix}cameras/{stem}.json").write_text(json.dumps(camera | matrix))
        (keyframes / f"{prefix}images/{stem}.jpg").write_bytes(jpeg(max(number, 0)))
        if number >= 0:
            depth = np.rint(metres(number) * 1000).astype(np.uint16)
            (keyframes / f"depth/{stem}.png").write_bytes(png(depth))
            (keyframes / f"confidence/{stem}.png").write_bytes(png((confidence() * 127.5).astype(np.uint8)))
    return folder


def test_a_raw_folder_of_polycam_is_read(tmp_path: Path) -> None:
    folder = polycam(tmp_path / "scan")
    assert_read(folder)
    assert_read(Path(f"{folder}:1"), 1)
    assert_read(folder / "keyframes")
    with pytest.raises(InputError, match="2 frames with photo, camera and depth, no frame 2"):
        read_scene(Path(f"{folder}:2"))


def test_photos_of_polycam_that_are_not_rectified_are_noted(tmp_path: Path) -> None:
    frame = read_scene(polycam(tmp_path / "scan", corrected=False))
    assert any("not rectified" in note for note in frame.notes)


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b'{"fx": 80, "t_10": 1e999}'])
def test_a_broken_camera_of_polycam_is_named(tmp_path: Path, content: bytes) -> None:
    folder = polycam(tmp_path / "scan")
    (folder / "keyframes/corrected_cameras/1000.json").write_bytes(content)
    with pytest.raises(InputError, match=r"1000\.json"):
        read_scene(folder)


def test_a_direction_of_gravity_in_the_camera_file_is_kept(tmp_path: Path) -> None:
    camera = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH, "height": HEIGHT, "depth_scale": 0.001}
    depth = png(np.rint(metres() * 1000).astype(np.uint16))
    content = {"rgb.png": png(photo()), "depth.png": depth}
    folder = unpacked(tmp_path, content | {"camera.json": json.dumps(camera | {"up": [0, -4, -3]}).encode()})
    assert read_scene(folder).camera.up == pytest.approx((0, -0.8, -0.6))
    (folder / "camera.json").write_text(json.dumps(camera | {"up": [0, 0, 0]}))
    with pytest.raises(InputError, match=r"camera\.json: up"):
        read_scene(folder)


def test_a_pipe_in_place_of_a_capture_is_named(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "desk.r3d")
    with pytest.raises(InputError, match="no regular file"):
        read_scene(tmp_path / "desk.r3d")
