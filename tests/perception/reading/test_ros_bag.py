"""ROS bags: the first frame with colour, depth and camera, of every version, whatever else they hold."""

import contextlib
import os
import sqlite3
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.foreign_scene import read_foreign_scene
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene, short_scene_name
from tests.needs import needs
from tests.perception.reading.conftest import CX, CY, FX, FY, HEIGHT, WIDTH, Truth, png
from tests.perception.reading.recordings import (
    Form,
    Message,
    camera_info,
    compressed,
    image,
    transform,
    write_recording,
)

pytestmark = needs("rosbags")
COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
SUFFIX = {"bag": ".bag", "db3": "", "mcap": ""}


def millimetres(truth: Truth) -> npt.NDArray[np.uint16]:
    return np.rint(truth.depth * 1000).astype(np.uint16)


def usual(truth: Truth, **changes: Message | Sequence[Message]) -> list[Message]:
    """Colour, depth on its grid, and their camera, at one time; changes by name replace them."""
    messages: dict[str, Message | Sequence[Message]] = {
        "color": image(COLOR, truth.rgb, "rgb8"),
        "info": camera_info("/camera/color/camera_info"),
        "depth": image(DEPTH, millimetres(truth), "16UC1"),
        "depth_info": camera_info("/camera/aligned_depth_to_color/camera_info"),
    }
    parts = (messages | changes).values()
    return [message for part in parts for message in ([part] if isinstance(part, Message) else part)]


def recorded(folder: Path, truth: Truth, form: Form = "bag", **changes: Message | Sequence[Message]) -> Path:
    return write_recording(folder / f"desk{SUFFIX[form]}", form, usual(truth, **changes))


def assert_read(source: Path, truth: Truth) -> None:
    frame = read_scene(source)
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    assert (frame.rgb == truth.rgb).all()
    assert (frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy) == (FX, FY, CX, CY)


@pytest.mark.parametrize("form", get_args(Form))
def test_every_form_is_read_also_by_the_worker(tmp_path: Path, truth: Truth, form: Form) -> None:
    source = recorded(tmp_path, truth, form)
    check_scene_source(source)
    assert_read(source, truth)
    frame = read_foreign_scene(source)
    assert (frame.rgb == truth.rgb).all() and np.abs(frame.depth - truth.depth).max() < 1e-6
    assert [COLOR in note and DEPTH in note for note in frame.notes] == [True]
    assert short_scene_name(source) in ("desk", "desk-0")
    assert short_scene_name(Path(f"{source}:0")) in ("desk", "desk-0")


@pytest.mark.parametrize("form", ["db3", "mcap"])
def test_a_folder_without_its_metadata_and_the_file_alone_are_read(tmp_path: Path, truth: Truth, form: Form) -> None:
    folder = recorded(tmp_path, truth, form)
    (folder / "metadata.yaml").unlink()
    assert_read(folder, truth)
    assert_read(folder / f"desk.{form}", truth)


ENCODINGS: dict[str, tuple[str, Any]] = {
    "bgr8": ("bgr8", lambda rgb: rgb[..., ::-1]),
    "rgba8": ("rgba8", lambda rgb: np.dstack([rgb, rgb[..., 0]])),
    "bgra8": ("BGRA8", lambda rgb: np.dstack([rgb[..., ::-1], rgb[..., 0]])),
    "8UC3": ("8UC3", lambda rgb: rgb[..., ::-1]),
}


@pytest.mark.parametrize("name", ENCODINGS)
def test_orders_of_colours_are_told_apart(tmp_path: Path, truth: Truth, name: str) -> None:
    encoding, turn = ENCODINGS[name]
    assert_read(recorded(tmp_path, truth, color=image(COLOR, turn(truth.rgb), encoding)), truth)


def test_grey_and_padded_rows_are_read(tmp_path: Path, truth: Truth) -> None:
    padded = np.pad(truth.rgb[..., 0], ((0, 0), (0, 5)))
    message = image(COLOR, padded, "mono8")
    source = recorded(tmp_path, truth, color=replace(message, fields=message.fields | {"width": WIDTH}))
    assert (read_scene(source).rgb == truth.rgb[..., :1]).all()


@pytest.mark.parametrize("encoding", ["yuv422", "yuv422_yuy2"])
def test_yuv_is_read(tmp_path: Path, truth: Truth, encoding: str) -> None:
    grey = np.full((HEIGHT, WIDTH, 2), 128, np.uint8)
    grey[..., 1 if encoding == "yuv422" else 0] = 100
    rgb = read_scene(recorded(tmp_path, truth, color=image(COLOR, grey, encoding))).rgb
    assert np.ptp(rgb) <= 2 and abs(int(rgb[0, 0, 0]) - 98) <= 2  # BT.601: (100 - 16) * 255 / 219


@pytest.mark.parametrize(
    ("encoding", "sites"),
    [("bayer_rggb8", "RGGB"), ("bayer_bggr8", "BGGR"), ("bayer_gbrg8", "GBRG"), ("bayer_grbg8", "GRBG")],
)
def test_bayer_patterns_are_told_apart(tmp_path: Path, truth: Truth, encoding: str, sites: str) -> None:
    mosaic = np.array([{"R": 200, "G": 120, "B": 40}[site] for site in sites], np.uint8).reshape(2, 2)
    pixels = np.tile(mosaic, (HEIGHT // 2, WIDTH // 2))
    frame = read_scene(recorded(tmp_path, truth, color=image(COLOR, pixels, encoding)))
    assert frame.rgb[10, 10].tolist() == [200, 120, 40]


def test_floats_are_metres_and_bytes_may_be_swapped(tmp_path: Path, truth: Truth) -> None:
    metres = np.where(truth.depth > 0, truth.depth, np.nan).astype(np.float32)
    assert_read(recorded(tmp_path / "a", truth, depth=image(DEPTH, metres, "32FC1")), truth)
    assert_read(recorded(tmp_path / "b", truth, depth=image(DEPTH, millimetres(truth).astype(">u2"), "16UC1")), truth)


def test_compressed_topics_are_read(tmp_path: Path, truth: Truth) -> None:
    color = compressed(f"{COLOR}/compressed", png(truth.rgb), "rgb8; png compressed bgr8")
    depth = compressed(f"{DEPTH}/compressedDepth", bytes(12) + png(millimetres(truth)), "16UC1; compressedDepth png")
    assert_read(recorded(tmp_path, truth, "mcap", color=color, depth=depth), truth)


def test_jpeg_is_read_and_raw_pictures_go_first(tmp_path: Path, truth: Truth) -> None:
    smooth = cv2.resize(truth.rgb, (WIDTH, HEIGHT)) // 4 * 0 + np.uint8(90)
    jpeg = cv2.imencode(".jpg", np.asarray(smooth, np.uint8))[1].tobytes()
    packed = compressed(f"{COLOR}/compressed", jpeg, "jpeg")
    assert np.abs(read_scene(recorded(tmp_path / "a", truth, color=packed)).rgb.astype(int) - 90).max() <= 2
    assert_read(recorded(tmp_path / "b", truth, packed=packed), truth)


def test_quantised_inverse_depth_is_read(tmp_path: Path, truth: Truth) -> None:
    factor, offset = 500.0, -40.0
    quantised = np.where(truth.depth > 0, np.rint(factor / np.maximum(truth.depth, 0.1) + offset), 0).astype(np.uint16)
    header = np.array([0], "<i4").tobytes() + np.array([factor, offset], "<f4").tobytes()
    depth = compressed(f"{DEPTH}/compressedDepth", header + png(quantised), "32FC1; compressedDepth")
    frame = read_scene(recorded(tmp_path, truth, depth=depth))
    assert np.abs(frame.depth - truth.depth).max() < 2e-3


def test_the_nearest_picture_in_time_is_taken(tmp_path: Path, truth: Truth) -> None:
    other = 255 - truth.rgb
    color = [image(COLOR, other, "rgb8", stamp=100.0), image(COLOR, truth.rgb, "rgb8", stamp=100.04)]
    depth = image(DEPTH, millimetres(truth), "16UC1", stamp=100.03)
    assert_read(recorded(tmp_path, truth, color=color, depth=depth), truth)


def test_a_frame_is_chosen_by_its_number(tmp_path: Path, truth: Truth) -> None:
    color = [image(COLOR, truth.rgb // (3 - number), "rgb8", stamp=100 + number) for number in range(3)]
    depth = [image(DEPTH, millimetres(truth) + 100 * (2 - number), "16UC1", stamp=100 + number) for number in range(3)]
    source = recorded(tmp_path, truth, "mcap", color=color, depth=depth)
    assert_read(Path(f"{source}:2"), truth)
    assert (read_foreign_scene(Path(f"{source}:1")).rgb == truth.rgb // 2).all()
    with pytest.raises(InputError, match=r"no frame 3: .*/image_raw has 3; frames count from 0"):
        read_scene(Path(f"{source}:3"))
    with pytest.raises(InputError, match=r"desk:first names no frame"):
        read_scene(Path(f"{source}:first"))


def test_colours_far_from_depth_in_time_are_refused(tmp_path: Path, truth: Truth) -> None:
    depth = image(DEPTH, millimetres(truth), "16UC1", stamp=100.4)
    with pytest.raises(InputError, match=r"within 0\.05 s .* the nearest are 0\.4 s apart"):
        read_scene(recorded(tmp_path, truth, depth=depth))


def test_several_cameras_are_asked_about_by_name(tmp_path: Path, truth: Truth) -> None:
    messages = [
        replace(message, topic=message.topic.replace("/camera/", f"/{name}/"))
        for name in ("left", "right")
        for message in usual(truth, color=image(COLOR, truth.rgb if name == "right" else 255 - truth.rgb, "rgb8"))
    ]
    source = write_recording(tmp_path / "desk.bag", "bag", messages)
    with pytest.raises(InputError, match=r"2 topics with depth: /left/.*, /right/.*; choose .*desk\.bag:/left/"):
        read_scene(source)
    assert_read(Path(f"{source}:/right"), truth)
    assert_read(Path(f"{source}:/right:0"), truth)
    assert_read(Path(f"{source}:/right/color,/right/aligned"), truth)
    with pytest.raises(InputError, match=r"no topic of pictures that begins with /middle; it has /left/"):
        read_scene(Path(f"{source}:/middle"))


def test_infrared_and_other_cameras_are_passed_over(tmp_path: Path, truth: Truth) -> None:
    more = [
        image("/camera/infra1/image_rect_raw", truth.rgb[..., 0], "mono8"),
        image("/camera/confidence/image_raw", millimetres(truth), "mono16"),
        image("/webcam/image_raw", 255 - truth.rgb, "rgb8"),
        image("/camera/depth/image_rect_raw", millimetres(truth) + 50, "16UC1", "depth"),
    ]
    assert_read(recorded(tmp_path, truth, more=more), truth)


def test_rectified_pictures_have_the_camera_of_the_projection(tmp_path: Path, truth: Truth) -> None:
    info = camera_info(
        "/camera/color/camera_info",
        matrix=(70, 0, CX, 0, 70, CY, 0, 0, 1),
        distortion=(0.1, 0.01, 0, 0, 0),
        projection=(FX, 0, CX, 0, 0, FY, CY, 0, 0, 0, 1, 0),
    )
    rectified: dict[str, Any] = {
        "color": image("/camera/color/image_rect_color", truth.rgb, "rgb8"),
        "depth": image("/camera/depth_registered/image_rect", millimetres(truth), "16UC1"),
        "depth_info": replace(info, topic="/camera/depth_registered/camera_info"),
    }
    assert_read(recorded(tmp_path, truth, info=info, **rectified), truth)


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "equidistant", "Inverse Brown Conrady"])
def test_lens_distortion_is_removed_from_both(tmp_path: Path, truth: Truth, model: str) -> None:
    """A step of colour and of depth at one column stays at one column, and moves as the model says."""
    lens = (0.3, 0.0, 0.0, 0.0) + ((0.0,) * 4 if model == "rational_polynomial" else (0.0,) * (model[0] in "pI"))
    info = [
        camera_info(f"/camera/{name}/camera_info", distortion=lens, model=model)
        for name in ("color", "aligned_depth_to_color")
    ]
    column = 42
    depth = np.full((HEIGHT, WIDTH), 800, np.uint16)
    rgb = np.full((HEIGHT, WIDTH, 3), 20, np.uint8)
    depth[:, column:], rgb[:, column:] = 600, 220
    changes: dict[str, Any] = {
        "color": image(COLOR, rgb, "rgb8"),
        "depth": image(DEPTH, depth, "16UC1"),
        "info": info,
        "depth_info": [],
    }
    frame = read_scene(recorded(tmp_path, truth, **changes))
    row = round(CY)
    edges = [int(np.argmax(values)) for values in (frame.rgb[row, :, 0] > 120, abs(frame.depth[row] - 0.6) < 0.1)]
    radius = (column - 0.5 - CX) / FX
    known = {"equidistant": None, "Inverse Brown Conrady": radius * (1 + 0.3 * radius**2)}
    moved = known.get(model, _undistorted(radius))
    if moved is None:  # a fisheye of r = theta + 0.3 theta^3
        theta = _undistorted(radius)
        moved = float(np.tan(theta))
    assert edges == pytest.approx([CX + FX * moved + 0.5] * 2, abs=1.0)
    assert any("lens distortion was removed" in note for note in frame.notes)


def _undistorted(radius: float) -> float:
    """The r of r (1 + 0.3 r^2) = ``radius``."""
    found = radius
    for _ in range(50):
        found = radius / (1 + 0.3 * found**2)
    return found


def test_an_unknown_distortion_is_refused(tmp_path: Path, truth: Truth) -> None:
    info = camera_info("/camera/color/camera_info", distortion=(1, 2), model="omnidirectional")
    with pytest.raises(InputError, match="'omnidirectional' with 2 coefficients"):
        read_scene(recorded(tmp_path, truth, info=info))


SHIFT = (0.02, 0.0, 0.0)  # from the depth camera's to the colour camera's frame, m


def plane_seen_twice() -> dict[str, Any]:
    """Depth of a plane with a step by a camera to the right of the colour camera, with longer focal lengths."""
    depth = np.full((HEIGHT, WIDTH), 800, np.uint16)
    depth[:, 20:] = 600
    matrix = (90.0, 0, CX, 0, 90.0, CY, 0, 0, 1)
    return {
        "depth": image("/camera/depth/image_rect_raw", depth, "16UC1", "depth"),
        "depth_info": camera_info("/camera/depth/camera_info", "depth", matrix=matrix),
    }


def assert_reprojected(source: Path) -> None:
    frame = read_scene(source)
    row = frame.depth[round(CY)]
    edge = int(np.argmax((row > 0.5) & (row < 0.7)))
    x = (20 - 0.5 - CX) / 90 * 0.6 + SHIFT[0]
    assert edge == pytest.approx(CX + FX * x / 0.6 + 0.5, abs=1.0)
    assert any("reprojected over 20 mm" in note for note in frame.notes)


def test_depth_of_another_camera_is_reprojected_by_tf(tmp_path: Path, truth: Truth) -> None:
    links = [("base", "depth", (0.1 + SHIFT[0], 0.2, 0.3)), ("base", "color", (0.1, 0.2, 0.3))]
    items = [
        (
            "geometry_msgs/TransformStamped",
            {"header": _header(parent), "child_frame_id": child, "transform": transform(shift)},
        )
        for parent, child, shift in links
    ]
    tree = Message("/tf_static", "tf2_msgs/TFMessage", {"transforms": items})
    assert_reprojected(recorded(tmp_path, truth, "mcap", **plane_seen_twice(), tree=tree))


def _header(frame_id: str) -> tuple[str, dict[str, Any]]:
    time = ("builtin_interfaces/Time", {"sec": 0, "nanosec": 0})
    return "std_msgs/Header", {"stamp": time, "frame_id": frame_id}


def test_depth_of_an_unknown_place_is_refused_with_both_frames(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(InputError, match=r"in the frame 'depth', colours of .* in 'color', .* no transform between"):
        read_scene(recorded(tmp_path / "a", truth, **plane_seen_twice()))
    changes: dict[str, Any] = plane_seen_twice() | {"depth_info": []}
    with pytest.raises(InputError, match=r"in the frame 'depth', .* no camera_info for depth"):
        read_scene(recorded(tmp_path / "b", truth, **changes))


def test_a_recording_of_librealsense_is_read(tmp_path: Path, truth: Truth) -> None:
    depth, color = "/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"
    moved = plane_seen_twice()
    pixels, info = moved["depth"], moved["depth_info"]
    tenths = pixels.fields | {"data": (pixels.fields["data"].view(np.uint16) * 10).view(np.uint8), "encoding": "mono16"}
    messages = [
        image(f"{color}/image/data", truth.rgb, "rgb8", ""),
        replace(pixels, topic=f"{depth}/image/data", fields=tenths, frame_id=""),
        camera_info(f"{color}/info/camera_info", "", model="Inverse Brown Conrady"),
        replace(info, topic=f"{depth}/info/camera_info", frame_id=""),
        Message(f"{depth}/tf/0", *transform((0, 0, 0))),
        Message(f"{color}/tf/0", *transform(SHIFT)),
        Message("/device_0/sensor_0/option/Depth Units/value", "std_msgs/Float32", {"data": 0.0001}),
    ]
    source = write_recording(tmp_path / "20260101_120000.bag", "bag", messages)
    assert_reprojected(source)
    assert (read_scene(source).rgb == truth.rgb).all()


@pytest.mark.parametrize(
    ("name", "change", "word"),
    [
        ("color", lambda message: [], r"no topic with colour; it has .*\(depth\)"),
        ("depth", lambda message: [], r"no topic with depth; it has .*\(color\)"),
        ("info", lambda message: [], r"no camera_info for /camera/color/image_raw"),
        ("color", lambda message: replace(message, fields=message.fields | {"encoding": "rgb16"}), r"\(unknown\)"),
        ("color", lambda message: replace(message, fields=message.fields | {"step": 10}), "in rows of 10 bytes"),
        ("color", lambda message: replace(message, fields=message.fields | {"height": 1 << 30}), "1073741824 pixels"),
        ("depth", lambda message: replace(message, fields=message.fields | {"data": bytes(9)}), "with 9 bytes"),
        (
            "info",
            lambda message: replace(message, fields=message.fields | {"width": 96}),
            r"of 96x36 pixels, but .* of 48x36",
        ),
        ("info", lambda message: replace(message, fields=message.fields | {"K": np.full(9, np.nan)}), "fx = nan"),
    ],
)
def test_a_message_that_does_not_fit_is_named(tmp_path: Path, truth: Truth, name: str, change: Any, word: str) -> None:
    changes: dict[str, Any] = {"depth_info": []}
    changes[name] = change(next(message for message in usual(truth) if message.topic == NAMES[name]))
    for message in [changes[name]] if isinstance(changes[name], Message) else []:
        if isinstance(message.fields.get("data"), bytes):
            message.fields["data"] = np.frombuffer(message.fields["data"], np.uint8)
    with pytest.raises(InputError, match=word):
        read_scene(recorded(tmp_path, truth, "mcap", **changes))


NAMES = {"color": COLOR, "depth": DEPTH, "info": "/camera/color/camera_info"}


@pytest.mark.parametrize("form", get_args(Form))
def test_a_torn_bag_is_refused_in_one_line(tmp_path: Path, truth: Truth, form: Form) -> None:
    source = recorded(tmp_path, truth, form)
    file = source if form == "bag" else source / f"desk.{form}"
    whole = file.read_bytes()
    rng = np.random.default_rng(0)
    flipped = bytearray(whole)
    for place in rng.integers(0, len(whole), 40):
        flipped[place] ^= 255
    cuts = [whole[: int(share * len(whole))] for share in (0, 0.01, 0.3, 0.7)]
    for content in (*cuts, bytes(len(whole)), b"#ROSBAG V2.0\n" + bytes(60)):
        file.write_bytes(content)
        with pytest.raises(InputError, match="desk") as caught:
            read_scene(source)
        assert "\n" not in str(caught.value) and caught.value.remedy
    file.write_bytes(flipped)
    with contextlib.suppress(InputError):  # a picture is as good with another colour
        read_foreign_scene(source)


def test_a_database_of_many_messages_needs_no_room_on_the_disk(tmp_path: Path, truth: Truth) -> None:
    source = recorded(tmp_path, truth, "db3")
    with contextlib.closing(sqlite3.connect(source / "desk.db3")) as database, database:
        database.execute("INSERT INTO topics SELECT 99, '/imu', type, 'cdr', '', '' FROM topics LIMIT 1")
        rows = ((99, number, b"") for number in range(600_000))
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    assert (read_foreign_scene(source).rgb == truth.rgb).all()


@pytest.mark.parametrize("content", [b"", b"[]", b"rosbag2_bagfile_information: 3", b"a: &a [*a]", b"\xff", b"a: b: c"])
def test_broken_metadata_is_named(tmp_path: Path, truth: Truth, content: bytes) -> None:
    source = recorded(tmp_path, truth, "mcap")
    (source / "metadata.yaml").write_bytes(content)
    with pytest.raises(InputError, match="desk"):
        read_scene(source)


def test_definitions_of_messages_in_a_bag_are_not_used(tmp_path: Path, truth: Truth) -> None:
    source = recorded(tmp_path, truth, "mcap")
    file = source / "desk.mcap"
    whole = file.read_bytes()
    assert whole.count(b"sensor_msgs/RegionOfInterest roi") >= 1
    file.write_bytes(whole.replace(b"sensor_msgs/RegionOfInterest roi", b"sensor_msgs/RegionOfInterest __x"))
    assert_read(source, truth)


@needs("sparse files")
@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
def test_a_file_of_a_thousand_gigabytes(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"desk{suffix}"
    file.write_bytes(b"#ROSBAG V2.0\n")
    os.truncate(file, 1 << 40)
    with pytest.raises(InputError, match="desk"):
        read_foreign_scene(file)


def test_without_the_package_the_error_says_how_to_install_it(
    tmp_path: Path, truth: Truth, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = recorded(tmp_path, truth)
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(InputError, match=r'rosbags is not installed; pip install "grs-agents\[rosbags\]"'):
        read_scene(source)
