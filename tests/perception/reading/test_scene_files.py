"""Captures as people keep them: the same picture under other names, in other files and units, gives the same frame."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest

from grs_agents.base.config.schema import CameraConfig
from grs_agents.base.errors import InputError
from grs_agents.perception.reading.calibration_files import SENSORS
from grs_agents.perception.reading.foreign_scene import read_foreign_scene
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene, short_scene_name
from tests.perception.reading.conftest import CX, CY, FX, FY, HEIGHT, WIDTH, Truth, png, write_npz

MATRIX = [[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]]
ROWS = [number for row in MATRIX for number in row]
COLUMNS = [number for column in zip(*MATRIX, strict=True) for number in column]


def millimetres(truth: Truth) -> npt.NDArray[np.uint16]:
    return np.rint(truth.depth * 1000).astype(np.uint16)


def write_capture(folder: Path, truth: Truth, photo: str, depth: str, camera: tuple[str, str] | None = None) -> Path:
    """A photo and its depth in millimetres under these names, and a text file with the camera."""
    for name, content in ((photo, png(truth.rgb)), (depth, png(millimetres(truth)))):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    if camera is not None:
        (folder / camera[0]).parent.mkdir(parents=True, exist_ok=True)
        (folder / camera[0]).write_text(camera[1])
    return folder


JSON_MATRIX = ("camera.json", json.dumps({"K": MATRIX}))

NAMES = [
    ("color.png", "depth.png"),
    ("image.png", "depth.png"),
    ("color_000.png", "depth_000.png"),
    ("scene.color.png", "scene.depth.png"),
    ("frame-000007.color.png", "frame-000007.depth.png"),
    ("0001-rgb.png", "0001-depth.png"),
    ("colorImage.png", "depthImage.png"),
    ("RGB_12.png", "Depth_12.png"),
    ("IMG_0412.png", "IMG_0412_depth.png"),
    ("rgb/000017.png", "depth/000017.png"),
    ("color/17.png", "depth/000017.png"),
    ("images/a.png", "depth_maps/a.png"),
    ("rgb/1305031102.175304.png", "depth/1305031102.160407.png"),
    ("desk.png", "desk_d.png"),
    ("left.png", "aligned_depth_to_color.png"),
]


@pytest.mark.parametrize(("photo", "depth"), NAMES)
def test_colour_and_depth_are_found_by_usual_names(tmp_path: Path, truth: Truth, photo: str, depth: str) -> None:
    frame = read_scene(write_capture(tmp_path, truth, photo, depth, JSON_MATRIX))
    assert (frame.rgb == truth.rgb).all()
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    if photo != "color.png":
        assert any(photo in note and depth in note for note in frame.notes)


@pytest.mark.parametrize(
    "extra", ["depth_colormap.png", "rgb_mask.png", "normals.png", "ir_image.png", "depth_vis.jpg"]
)
def test_derived_pictures_are_neither_photo_nor_depth(tmp_path: Path, truth: Truth, extra: str) -> None:
    folder = write_capture(tmp_path, truth, "image.png", "depth.png", JSON_MATRIX)
    cv2.imwrite(str(folder / extra), 255 - truth.rgb)
    frame = read_scene(folder)
    assert (frame.rgb == truth.rgb).all()
    assert np.abs(frame.depth - truth.depth).max() < 1e-6


CAMERAS: dict[str, tuple[str, str]] = {
    "BOP": ("camera.json", json.dumps({"cam_K": ROWS, "depth_scale": 1.0})),
    "Open3D": (
        "intrinsic.json",
        json.dumps({"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": COLUMNS}),
    ),
    "ROS camera_info": (
        "camera_info.yaml",
        f"header:\n  frame_id: camera\nheight: {HEIGHT}\nwidth: {WIDTH}\ndistortion_model: plumb_bob\n"
        f"D: [0.0, 0.0, 0.0, 0.0, 0.0]\nK: {ROWS}\nP: {[*MATRIX[0], 0.0, *MATRIX[1], 0.0, *MATRIX[2], 0.0]}\n",
    ),
    "ROS calibration": (
        "calibration.yaml",
        f"image_width: {WIDTH}\nimage_height: {HEIGHT}\ncamera_name: head\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: {ROWS}\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.0, 0.0, 0.0, 0.0, 0.0]\n",
    ),
    "OpenCV": (
        "calib.yml",
        f"%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {ROWS}\n",
    ),
    "RealSense": (
        "intrinsics.json",
        json.dumps(
            {"color": {"width": WIDTH, "height": HEIGHT, "fx": FX, "fy": FY, "ppx": CX, "ppy": CY, "coeffs": [0] * 5}}
        ),
    ),
    "RealSense Viewer": (
        "shot_Color_metadata.csv",
        f"Frame Info:\nType,Color\nResolution x,{WIDTH}\nResolution y,{HEIGHT}\n\nIntrinsic:\nFx,{FX}\nFy,{FY}\n"
        f"PPx,{CX}\nPPy,{CY}\nDistorsion,Inverse Brown Conrady\n",
    ),
    "Azure Kinect": (
        "calibration.json",
        json.dumps(
            {
                "CalibrationInformation": {
                    "Cameras": [
                        {
                            "Purpose": "CALIBRATION_CameraPurposePhotoVideo",
                            "SensorWidth": WIDTH,
                            "SensorHeight": HEIGHT,
                            "Intrinsics": {
                                "ModelParameters": [
                                    (CX + 0.5) / WIDTH,
                                    (CY + 0.5) / HEIGHT,
                                    FX / WIDTH,
                                    FY / HEIGHT,
                                    *[0.0] * 10,
                                ]
                            },
                        }
                    ]
                }
            }
        ),
    ),
    "text matrix": ("camera_intrinsics.txt", "\n".join(" ".join(map(str, row)) for row in MATRIX)),
    "ScanNet": (
        "intrinsic/intrinsic_color.txt",
        "\n".join(" ".join(map(str, (*row, 0.0))) for row in MATRIX) + "\n0 0 0 1\n",
    ),
    "four numbers": ("intrinsics.txt", f"# fx fy cx cy\n{FX} {FY} {CX} {CY}\n"),
    "assignments": ("info.txt", f"fx_color = {FX}\nfy_color = {FY}\nmx_color = {CX}\nmy_color = {CY}\n"),
    "keys": ("cam.yaml", f"name: 'D435'\nxres: {WIDTH}\nyres: {HEIGHT}\nfx: {FX}\nfy: {FY}\ncx: {CX}\ncy: {CY}\n"),
    "nested": ("meta.json", json.dumps({"frames": [{"camera": {"intrinsics": MATRIX}}]})),
    "transforms": (
        "transforms.json",
        json.dumps({"fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY, "w": WIDTH, "h": HEIGHT, "frames": []}),
    ),
}


@pytest.mark.parametrize("form", CAMERAS)
def test_intrinsics_of_other_programs_are_read(tmp_path: Path, truth: Truth, form: str) -> None:
    frame = read_scene(write_capture(tmp_path, truth, "rgb.png", "depth.png", CAMERAS[form]))
    camera = frame.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((FX, FY, CX, CY))
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert np.abs(frame.depth - truth.depth).max() < 1e-6


def test_intrinsics_in_arrays_are_read(tmp_path: Path, truth: Truth) -> None:
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png")
    np.save(folder / "K.npy", np.array(MATRIX))
    assert read_scene(folder).camera.fx == FX


def test_a_matlab_file_is_read_with_its_scale(tmp_path: Path, truth: Truth) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png")
    scipy_io.savemat(folder / "meta.mat", {"intrinsic_matrix": np.array(MATRIX), "factor_depth": np.array([[1000]])})
    frame = read_scene(folder)
    assert frame.camera.cy == CY
    assert np.abs(frame.depth - truth.depth).max() < 1e-6


def test_the_colour_camera_is_chosen_of_several(tmp_path: Path, truth: Truth) -> None:
    other = [[2 * FX, 0, CX], [0, 2 * FY, CY], [0, 0, 1]]
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png")
    (folder / "cameras.json").write_text(json.dumps({"depth": {"K": other}, "color": {"K": MATRIX}}))
    assert read_scene(folder).camera.fx == FX
    (folder / "cameras.json").write_text(json.dumps({"one": {"K": other}, "two": {"K": MATRIX}}))
    with pytest.raises(InputError, match="holds 2 cameras"):
        read_scene(folder)


def test_depth_of_its_own_camera_is_resampled_to_the_photo(tmp_path: Path, truth: Truth) -> None:
    def matrix(fx: float, fy: float, cx: float, cy: float) -> str:
        return f"{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0\n0 0 0 1\n"

    folder = write_capture(tmp_path, truth, "color/0.png", "depth/0.png")
    photo = cv2.resize(truth.rgb, (3 * WIDTH, 3 * HEIGHT + 3), interpolation=cv2.INTER_NEAREST)
    (folder / "color" / "0.png").write_bytes(png(photo))
    (folder / "intrinsic").mkdir()
    (folder / "intrinsic" / "intrinsic_color.txt").write_text(matrix(3 * FX, 3 * FY, 3 * CX + 1, 3 * CY + 1))
    with pytest.raises(InputError, match="of another shape"):
        read_scene(folder)
    (folder / "intrinsic" / "intrinsic_depth.txt").write_text(matrix(FX, FY, CX, CY))
    frame = read_scene(folder)
    assert frame.depth.shape == (3 * HEIGHT + 3, 3 * WIDTH)
    assert np.abs(frame.depth[1::3, 1::3][:HEIGHT] - truth.depth).max() < 1e-6
    assert any("intrinsic_depth.txt" in note for note in frame.notes)


def test_missing_intrinsics_are_asked_for_and_taken_from_the_command_line(tmp_path: Path, truth: Truth) -> None:
    folder = write_capture(tmp_path, truth, "color.png", "depth.png")
    (folder / "notes.txt").write_text("taken on a Monday")
    with pytest.raises(InputError, match="intrinsics") as refusal:
        read_scene(folder)
    assert "--camera FX,FY,CX,CY" in refusal.value.remedy
    for option in (f"{FX},{FY},{CX},{CY}", f"{FX},{FY},{CX},{CY},{WIDTH},{HEIGHT}"):
        frame = read_scene(folder, camera=CameraConfig(intrinsics=option))
        assert frame.camera.intrinsics.model_dump() == pytest.approx(
            {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH, "height": HEIGHT}
        )
    with pytest.raises(InputError, match="--camera realsense-d453") as refusal:
        read_scene(folder, camera=CameraConfig(intrinsics="realsense-d453"))
    assert "did you mean realsense-d4" in refusal.value.remedy


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_sensor_gives_its_published_field_of_view(tmp_path: Path, truth: Truth, sensor: str) -> None:
    folder = write_capture(tmp_path, truth, "color.png", "depth.png")
    frame = read_scene(folder, camera=CameraConfig(intrinsics=sensor))
    horizontal = 2 * np.degrees(np.arctan(WIDTH / 2 / frame.camera.fx))
    vertical = 2 * np.degrees(np.arctan(HEIGHT / 2 / frame.camera.fy))
    published = SENSORS[sensor]
    assert horizontal <= published[0] + 1e-6 and vertical <= published[1] + 1e-6
    assert horizontal == pytest.approx(published[0]) or vertical == pytest.approx(published[1])
    assert any("approximate" in note for note in frame.notes)


def test_the_users_statements_prevail_over_the_folders(tmp_path: Path, truth: Truth) -> None:
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", ("camera.json", json.dumps({"K": [[1, 2]]})))
    frame = read_scene(folder, camera=CameraConfig(intrinsics=f"{FX},{FY},{CX},{CY}", depth_scale=0.002))
    assert np.abs(frame.depth - 2 * truth.depth).max() < 1e-6


Encoder = Callable[[npt.NDArray[np.float64]], npt.NDArray[Any]]


def as_raw_disparity(depth: npt.NDArray[np.float64]) -> npt.NDArray[np.uint16]:
    return np.where(depth > 0, np.rint(1092.5 - 351.3 / np.maximum(depth, 0.4)), 2047).astype(np.uint16)


def rotate_bits(depth: npt.NDArray[np.float64]) -> npt.NDArray[np.uint16]:
    units = np.rint(depth * 1000).astype(np.uint16)
    return ((units << 3) | (units >> 13)).astype(np.uint16)


ENCODINGS: dict[str, tuple[Encoder, float]] = {
    "5,000 units a metre": (lambda depth: (np.rint(depth * 1000) * 5).astype(np.uint16), 1e-6),
    "10,000 units a metre": (lambda depth: (np.rint(depth * 1000) * 10).astype(np.uint16), 1e-6),
    "rotated by three": (rotate_bits, 1e-6),
    "raw disparity": (as_raw_disparity, 0.003),
    "bytes were swapped": (lambda depth: np.rint(depth * 1000).astype(np.uint16).byteswap(), 1e-6),
}


@pytest.mark.parametrize("form", ENCODINGS)
def test_encodings_of_sensors_are_recognised_and_named(tmp_path: Path, truth: Truth, form: str) -> None:
    encode, tolerance = ENCODINGS[form]
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", ("K.txt", "\n".join(map(str, ROWS))))
    (folder / "depth.png").write_bytes(png(encode(truth.depth)))
    frame = read_scene(folder)
    assert np.abs(frame.depth - truth.depth).max() < tolerance
    assert any(form in note for note in frame.notes)


def test_a_stated_scale_prevails_over_a_sensor_format(tmp_path: Path, truth: Truth) -> None:
    camera = ("camera.json", json.dumps({"K": MATRIX, "depth_scale": 0.001}))
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", camera)
    clipped = np.where(truth.depth > 0, millimetres(truth), 2047).astype(np.uint16)
    (folder / "depth.png").write_bytes(png(clipped))
    assert np.abs(read_scene(folder).depth - clipped / 1000).max() < 1e-6


def test_statements_on_a_camera_that_the_scene_states_are_refused(tmp_path: Path, truth: Truth) -> None:
    source = write_npz(tmp_path / "scene.npz", truth)
    with pytest.raises(InputError, match="states its camera itself") as refusal:
        read_scene(source, camera=CameraConfig(intrinsics="kinect-v1"))
    assert "--camera" in refusal.value.remedy


@pytest.mark.parametrize("swapped", [False, True])
def test_pgm_of_either_byte_order_is_read(tmp_path: Path, truth: Truth, swapped: bool) -> None:
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", JSON_MATRIX)
    (folder / "depth.png").unlink()
    units = millimetres(truth).astype("<u2" if swapped else ">u2")
    (folder / "depth.pgm").write_bytes(f"P5\n{WIDTH} {HEIGHT}\n65535\n".encode() + units.tobytes())
    assert np.abs(read_scene(folder).depth - truth.depth).max() < 1e-6


@pytest.mark.parametrize("name", ["arr_0", "depth"])
def test_depth_in_an_archive_beside_the_photo_is_read(tmp_path: Path, truth: Truth, name: str) -> None:
    folder = write_capture(tmp_path, truth, "image.png", "depth.png", JSON_MATRIX)
    (folder / "depth.png").unlink()
    np.savez_compressed(
        folder / "depth.npz", allow_pickle=False, **{name: millimetres(truth), "camera_pose": np.eye(4)}
    )
    assert np.abs(read_scene(folder).depth - truth.depth).max() < 1e-6


@pytest.mark.parametrize("channels", ["Z", "RGB", "Y"])
def test_openexr_is_read(tmp_path: Path, truth: Truth, channels: str) -> None:
    folder = write_capture(tmp_path, truth, "photo.png", "depth.png", JSON_MATRIX)
    (folder / "depth.png").unlink()
    depth = np.where(truth.depth > 0, truth.depth, np.nan).astype(np.float32)
    pixels = np.repeat(depth[..., None], 3, axis=2) if channels == "RGB" else depth
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {channels: pixels}) as picture:
        picture.write(str(folder / "photo-depth.exr"))
    for read in (read_scene, read_foreign_scene):
        assert np.abs(read(folder).depth - truth.depth).max() < 1e-6
    whole = (folder / "photo-depth.exr").read_bytes()
    (folder / "photo-depth.exr").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"photo-depth\.exr"):
        read_scene(folder)


def test_depth_of_256_steps_or_colours_is_refused_with_the_reason(tmp_path: Path, truth: Truth) -> None:
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", JSON_MATRIX)
    grey = (truth.depth * 200).astype(np.uint8)
    (folder / "depth.png").write_bytes(png(grey))
    with pytest.raises(InputError, match="uint8") as refusal:
        read_scene(folder)
    assert "256 steps" in refusal.value.remedy
    (folder / "depth.png").write_bytes(png(cv2.applyColorMap(grey, cv2.COLORMAP_JET)))
    with pytest.raises(InputError, match="channels of uint8") as refusal:
        read_scene(folder)
    assert "colour-mapped" in refusal.value.remedy


def test_distance_along_the_ray_is_converted_and_disparity_refused(tmp_path: Path, truth: Truth) -> None:
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", JSON_MATRIX)
    (folder / "depth.png").unlink()
    length = np.linalg.norm(np.nan_to_num(truth.points), axis=-1)
    np.save(folder / "depth.npy", length.astype(np.float32))
    frame = read_scene(folder)
    assert np.abs(frame.depth - truth.depth).max() < 1e-5
    assert any("along the ray" in note for note in frame.notes)
    rows, columns = np.indices((HEIGHT, WIDTH))
    disparity = 0.4 + 0.02 * rows + 0.004 * columns  # of a plane from 0.6 to 2.5 m
    np.save(folder / "depth.npy", disparity.astype(np.float32))
    with pytest.raises(InputError, match="disparity") as refusal:
        read_scene(folder)
    assert "baseline" in refusal.value.remedy


@pytest.mark.parametrize("stated", [None, False, True])
def test_a_distorted_picture_is_rectified_unless_it_is_already(
    tmp_path: Path, truth: Truth, stated: bool | None
) -> None:
    lens, height, width = (-0.35, 0.1, 0.0, 0.0, 0.0), 4 * HEIGHT, 4 * WIDTH
    matrix = np.array([[4 * FX, 0, 2 * width / 4], [0, 4 * FY, 2 * height / 4], [0, 0, 1]])
    rows, columns = np.indices((height, width))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    straight = cv2.undistortPoints(pixels, matrix, np.array(lens), P=matrix).reshape(height, width, 2)
    raw = 0.9 - 0.003 * straight[..., 1] + 0.002 * straight[..., 0]  # inverse depth of a plane, as the lens shows it
    camera = ("camera.json", json.dumps({"K": matrix.tolist(), "D": lens}))
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", camera)
    (folder / "depth.png").unlink()
    (folder / "rgb.png").write_bytes(png(cv2.resize(truth.rgb, (width, height))))
    np.save(folder / "depth.npy", (1 / raw).astype(np.float32))
    frame = read_scene(folder, camera=CameraConfig(rectified=stated))
    plane = 1 / (0.9 - 0.003 * rows + 0.002 * columns)
    error = np.abs(frame.depth - plane)[frame.depth > 0]
    verdict = "taken as rectified" if stated else "were rectified"
    assert any(verdict in note for note in frame.notes)
    assert error.max() > 0.05 if stated else np.percentile(error, 99) < 0.01
    np.save(folder / "depth.npy", plane.astype(np.float32))
    if stated is None:
        assert any("taken as rectified" in note for note in read_scene(folder).notes)


def write_two_pictures(folder: Path, truth: Truth) -> Path:
    write_capture(folder, truth, "000080-rgb-img.png", "000080-depth-img.png", JSON_MATRIX)
    shifted = Truth(255 - truth.rgb, truth.depth, truth.labels)
    return write_capture(folder, shifted, "000123-rgb-img.png", "000123-depth-img.png")


@pytest.mark.parametrize("choice", ["80", "000080", "000080-rgb-img.png", "0"])
def test_a_picture_of_several_is_chosen_by_name_or_number(tmp_path: Path, truth: Truth, choice: str) -> None:
    folder = write_two_pictures(tmp_path / "kitchen", truth)
    source = folder.with_name(f"kitchen:{choice}")
    check_scene_source(source)
    assert (read_scene(source).rgb == truth.rgb).all()
    assert short_scene_name(source) == f"kitchen-{choice}"


@pytest.mark.parametrize(("photo", "depth"), [pair for pair in NAMES if "/" not in pair[0]])
def test_a_photo_is_paired_with_the_depth_beside_it(tmp_path: Path, truth: Truth, photo: str, depth: str) -> None:
    folder = write_capture(tmp_path, truth, photo, depth, JSON_MATRIX)
    frame = read_foreign_scene(folder / photo)
    assert frame.source == folder / photo and (frame.rgb == truth.rgb).all()
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    assert any(note.startswith(f"photo {photo}, depth {depth}") for note in frame.notes)


def test_depth_of_another_photo_is_not_taken(tmp_path: Path, truth: Truth) -> None:
    folder = write_two_pictures(tmp_path / "kitchen", truth)
    (folder / "holiday.png").write_bytes(png(truth.rgb))
    assert (read_scene(folder / "000123-rgb-img.png").rgb == 255 - truth.rgb).all()
    with pytest.raises(InputError, match=r"holiday\.png has no depth"):
        read_scene(folder / "holiday.png")


def test_several_pictures_are_asked_about_by_name(tmp_path: Path, truth: Truth) -> None:
    folder = write_two_pictures(tmp_path / "kitchen", truth)
    with pytest.raises(InputError, match="holds 2 pictures") as refusal:
        read_scene(folder)
    assert "kitchen:80 (of 80, 123)" in refusal.value.remedy
    with pytest.raises(InputError, match="'124'") as refusal:
        read_scene(folder.with_name("kitchen:124"))
    assert "did you mean 123" in refusal.value.remedy


def test_a_bop_scene_is_read_as_a_folder(tmp_path: Path, truth: Truth) -> None:
    folder = write_capture(tmp_path / "000048", truth, "rgb/000012.png", "depth/000012.png")
    (folder / "scene_camera.json").write_text(json.dumps({"12": {"cam_K": ROWS, "depth_scale": 1.0}}))
    assert np.abs(read_scene(folder.with_name("000048:12")).depth - truth.depth).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera.yaml", "a: &a [1, 2]\nb: *a\n"),
        ("camera.yaml", "[" * 2_000),
        ("camera.yaml", "K: !!python/object/apply:os.system ['true']\n"),
        ("camera.json", '{"cam_K": [' + "1," * 8 + "1e400]}"),
        ("camera_info.json", '{"K": [' + "9" * 400 + "]}"),
        ("intrinsics.txt", "nan " * 9),
        ("camera.csv", "fx,1\nfy,2\n"),
        ("camera.mat", "MATLAB 5.0 MAT-file" + "\0" * 200),
    ],
)
def test_a_damaged_camera_is_refused_in_one_line(tmp_path: Path, truth: Truth, name: str, text: str) -> None:
    folder = write_capture(tmp_path, truth, "rgb.png", "depth.png", (name, text))
    for read in (read_scene, read_foreign_scene):
        with pytest.raises(InputError) as refusal:
            read(folder)
        assert "\n" not in str(refusal.value)
        assert "camera" in str(refusal.value)
