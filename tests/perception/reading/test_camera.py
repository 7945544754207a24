"""``camera.json`` as other tools write it: understood, told in the notes, or refused with the likely meaning."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.types import RGBDFrame
from tests.perception.reading.conftest import FORMS, Truth, png

POSE = [[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1]]


@pytest.fixture
def folder(tmp_path: Path, truth: Truth) -> Path:
    """A scene folder with a complete ``camera.json``."""
    return FORMS["folder"](tmp_path, truth)


def camera_in(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "camera.json").read_text())


def read_with(folder: Path, *without: str, **values: object) -> RGBDFrame:
    """The scene after a change of its ``camera.json``."""
    told = {key: value for key, value in camera_in(folder).items() if key not in without}
    (folder / "camera.json").write_text(json.dumps(told | values))
    return read_scene(folder)


def matrix_of(folder: Path) -> list[list[float]]:
    told = camera_in(folder)
    return [[told["fx"], 0, told["cx"]], [0, told["fy"], told["cy"]], [0, 0, 1]]


@pytest.mark.parametrize("key", ["K", "k"])
@pytest.mark.parametrize("flat", [True, False])
def test_the_intrinsic_matrix_stands_for_its_numbers(folder: Path, key: str, flat: bool) -> None:
    plain, matrix = read_scene(folder), matrix_of(folder)
    value = [number for row in matrix for number in row] if flat else matrix
    found = read_with(folder, "fx", "fy", "cx", "cy", **{key: value})
    assert found.camera == plain.camera
    assert not found.notes


def test_a_matrix_and_numbers_that_disagree_are_refused(folder: Path) -> None:
    matrix = matrix_of(folder)
    assert read_with(folder, K=matrix).camera.fx == matrix[0][0]
    matrix[0][0] += 1
    with pytest.raises(InputError, match="K says fx = 61, but fx = 60"):
        read_with(folder, K=matrix)


@pytest.mark.parametrize("matrix", [[1, 2], "wide", [[60, 0, 0], [0, 60, 0], [30, 20, 1]], [[[60.0]]] * 9])
def test_what_is_no_matrix_is_refused(folder: Path, matrix: object) -> None:
    with pytest.raises(InputError, match=r"camera\.json: K = "):
        read_with(folder, "fx", "fy", "cx", "cy", K=matrix)


@pytest.mark.parametrize("key", ["D", "d", "distortion", "distortion_coefficients"])
def test_a_lens_without_distortion_needs_no_note(folder: Path, key: str) -> None:
    plain = read_scene(folder)
    for zero in ([0.0] * 5, [], [[0, 0, 0, 0]]):
        frame = read_with(folder, **{key: zero})
        assert (frame.camera, frame.notes) == (plain.camera, ())
    for wrong in ("strong", [1, "a"], [0.1] * 20, [float("inf")]):
        with pytest.raises(InputError, match=f"{key} = .*no distortion coefficients"):
            read_with(folder, **{key: wrong})


def test_a_fisheye_lens_is_rectified_and_an_unknown_lens_refused(folder: Path) -> None:
    assert any(
        "rectified" in note for note in read_with(folder, distortion_model="equidistant", D=[1.5, 0, 0, 0]).notes
    )
    with pytest.raises(InputError, match="distortion model 'mirror ball'") as caught:
        read_with(folder, distortion_model="mirror_ball", D=[0.1, 0, 0, 0])
    assert "rectify" in caught.value.remedy


def test_a_convention_other_than_opencvs_is_refused_with_a_calibration(folder: Path) -> None:
    assert not read_with(folder, T_robot_cam=POSE, convention="OpenCV").notes
    with pytest.raises(InputError, match="convention = 'opengl'") as caught:
        read_with(folder, T_robot_cam=POSE, convention="opengl")
    assert "second and third columns" in caught.value.remedy
    assert "'convention'" in str(read_with(folder, "T_robot_cam", convention="opengl").notes)


def test_keys_that_say_nothing_are_told(folder: Path) -> None:
    plain = read_scene(folder)
    found = read_with(folder, serial="0815", **{"fps\x1b[31m": 30})
    assert found.camera == plain.camera
    (note,) = found.notes
    assert "'serial'" in note
    assert "\x1b" not in note


@pytest.mark.parametrize(
    ("missing", "key"),
    [
        ("T_robot_cam", "T_robot_camera"),
        ("T_robot_cam", "extrinsics"),
    ],
)
def test_another_name_of_a_missing_key_is_refused_with_its_own(folder: Path, missing: str, key: str) -> None:
    value = (camera_in(folder) | {"T_robot_cam": POSE})[missing]
    with pytest.raises(InputError, match=f"'{key}', and {missing} is missing") as caught:
        read_with(folder, missing, **{key: value})
    assert f"give {missing}: " in caught.value.remedy
    assert read_with(folder, key, **{missing: value, "serial": 1})


@pytest.mark.parametrize(
    ("missing", "key"),
    [("width", "image_width"), ("height", "yres"), ("cx", "ppx"), ("cy", "ppy"), ("fx", "fl_x"), ("fy", "fl_y")],
)
def test_other_names_of_intrinsics_are_understood(folder: Path, missing: str, key: str) -> None:
    plain = read_scene(folder)
    assert read_with(folder, missing, **{key: camera_in(folder)[missing]}).camera == plain.camera


@pytest.mark.parametrize(
    ("key", "value"), [("depth_factor", 1000), ("factor_depth", 1000.0), ("depthscale", 0.001), ("depth_units", 1.0)]
)
def test_a_scale_of_other_programs_is_metres_or_millimetres_a_unit_or_units_a_metre(
    folder: Path, key: str, value: float
) -> None:
    plain = read_scene(folder)
    assert np.array_equal(read_with(folder, "depth_scale", **{key: value}).depth, plain.depth)


def test_the_size_is_by_default_the_photos(folder: Path) -> None:
    plain = read_scene(folder)
    assert read_with(folder, "width", "height").camera == plain.camera


def test_millimetres_are_inferred_where_they_are_plausible_and_told(folder: Path) -> None:
    plain = read_scene(folder)
    found = read_with(folder, "depth_scale")
    assert np.array_equal(found.depth, plain.depth)
    (note,) = found.notes
    assert "no depth_scale" in note and "0.001" in note


@pytest.mark.parametrize("units_per_metre", [4000, 8000])
def test_a_unit_that_is_not_plausible_must_be_given(folder: Path, truth: Truth, units_per_metre: int) -> None:
    units = np.rint(truth.depth * units_per_metre) + (truth.depth > 0) * (np.indices(truth.depth.shape).sum(0) % 3)
    (folder / "depth.png").write_bytes(png(units.astype(np.uint16)))
    with pytest.raises(InputError, match="depth_scale is missing, and with millimetres") as caught:
        read_with(folder, "depth_scale")
    assert "depth_scale" in caught.value.remedy
    assert np.abs(read_with(folder, depth_scale=1 / units_per_metre).depth - truth.depth).max() < 1e-3


def test_integers_beyond_16_bits_have_no_usual_unit(folder: Path, truth: Truth) -> None:
    plain = read_scene(folder)
    (folder / "depth.png").unlink()
    np.save(folder / "depth.npy", np.rint(truth.depth * 1000).astype(np.int32))
    assert np.array_equal(read_with(folder, "depth_scale").depth, plain.depth)
    np.save(folder / "depth.npy", np.rint(truth.depth * 1e6).astype(np.int32))
    with pytest.raises(InputError, match="depth_scale is missing, and integers of type int32"):
        read_with(folder, "depth_scale")


def test_a_folder_without_a_photo_is_refused(folder: Path) -> None:
    (folder / "rgb.png").unlink()
    with pytest.raises(InputError, match=r"rgb\.png does not exist; put"):
        read_scene(folder)


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
def test_intrinsics_of_a_picture_of_another_size_are_refused(folder: Path, factor: float) -> None:
    camera = camera_in(folder)
    center = {"cx": camera["width"] * factor / 2 - 0.5, "cy": camera["height"] * factor / 2 - 0.5}
    fits = f"{camera['width'] * factor:.0f}x{camera['height'] * factor:.0f}"
    with pytest.raises(InputError, match=f"the centre of a picture of {fits}"):
        read_with(folder, **center)


def test_a_crop_may_have_its_principal_point_off_the_centre(folder: Path) -> None:
    camera = camera_in(folder)
    moved = read_with(folder, cx=camera["cx"] * 1.6, cy=camera["cy"] * 0.8).camera
    assert (moved.cx, moved.cy) == (camera["cx"] * 1.6, camera["cy"] * 0.8)


def test_a_principal_point_in_shares_of_the_picture_is_refused_with_its_pixels(folder: Path) -> None:
    camera = camera_in(folder)
    pixels = f"({camera['width'] / 2:g}, {camera['height'] / 2:g})"
    with pytest.raises(InputError) as refusal:
        read_with(folder, cx=0.5, cy=0.5, fx=1.2, fy=1.6)
    assert "shares of the picture" in refusal.value.message
    assert pixels in refusal.value.remedy and f"fx = {1.2 * camera['width']:g}" in refusal.value.remedy


@pytest.mark.parametrize(
    ("scale", "meant"), [(1000.0, "0.001 (1 / 1000)"), (5000.0, "0.0002 (1 / 5000)"), (1.0, "0.001")]
)
def test_units_per_metre_are_named_as_the_reciprocal(folder: Path, scale: float, meant: str) -> None:
    with pytest.raises(InputError) as refusal:
        read_with(folder, depth_scale=scale)
    assert f"with depth_scale {meant} it would be" in refusal.value.remedy


def test_a_z_buffer_is_named(folder: Path, truth: Truth) -> None:
    near, far = 0.005, 10.0
    (folder / "depth.png").unlink()
    np.save(
        folder / "depth.npy", ((1 / near - 1 / np.maximum(truth.depth, 0.7)) / (1 / near - 1 / far)).astype(np.float32)
    )
    with pytest.raises(InputError, match=r"hardly varies \(0\.99.*z-buffer"):
        read_with(folder, depth_scale=1.0)
