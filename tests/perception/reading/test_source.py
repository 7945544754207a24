"""Scenes by their name: every form tells the same, and every bad scene folder is one named error."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.camera import CameraFile, read_camera_file
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene, short_scene_name
from grs_agents.perception.types import Camera
from tests.perception.reading.conftest import FORMS, Truth

Folder = Callable[..., Path]


def test_a_scene_is_read_in_metres(scene_folder: Folder) -> None:
    frame = read_scene(scene_folder())
    assert frame.rgb.shape == (24, 32, 3)
    assert frame.depth == pytest.approx(np.full((24, 32), 0.8), abs=1e-6)


def test_the_sample_scene_is_calibrated(sample_scene: Path) -> None:
    assert read_scene(sample_scene).camera.T_robot_cam is not None


@pytest.mark.parametrize("form", FORMS)
def test_every_form_tells_the_same(tmp_path: Path, truth: Truth, form: str) -> None:
    source = FORMS[form](tmp_path / "data", truth)
    check_scene_source(source)
    frame = read_scene(source)
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    assert (frame.rgb == truth.rgb).all()
    assert (frame.camera.fx, frame.camera.cy, frame.source) == (60.0, 18.5, source)
    seen = truth.depth > 0
    assert np.abs(frame.camera_frame_point_map()[seen] - truth.points[seen]).max() < 1e-5


def test_a_scene_has_a_short_name(tmp_path: Path, truth: Truth) -> None:
    assert short_scene_name(Path("bop:/data/ycbv/test/000048/12")) == "ycbv-test-000048-12"
    assert short_scene_name(FORMS["npz"](tmp_path / "npz", truth)) == "scene"
    assert short_scene_name(FORMS["folder"](tmp_path / "kitchen", truth)) == "kitchen"


@pytest.mark.parametrize("name", ["cloud.ply", "scene.txt", "nothing"])
def test_what_is_no_scene_is_refused_before_it_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "cloud.ply").write_bytes(b"")
    (tmp_path / "scene.txt").write_bytes(b"")
    with pytest.raises(InputError, match=name):
        check_scene_source(tmp_path / name)


@pytest.mark.parametrize("name", ["rgb.png", "depth.png", "camera.json"])
def test_a_missing_file_is_named(scene_folder: Folder, name: str) -> None:
    folder = scene_folder()
    (folder / name).unlink()
    with pytest.raises(InputError, match=name):
        read_scene(folder)


@pytest.mark.parametrize("name", ["rgb.png", "depth.png", "camera.json"])
@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\nbroken", b"\xff\xfe\x00"])
def test_an_unreadable_file_is_named(scene_folder: Folder, name: str, content: bytes) -> None:
    folder = scene_folder()
    (folder / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_scene(folder)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        read_scene(tmp_path / "nowhere")


def test_depth_of_another_shape_is_refused_with_both_sizes(scene_folder: Folder) -> None:
    with pytest.raises(InputError, match=r"depth.png is 16x16 .* 32x24"):
        read_scene(scene_folder(depth=np.full((16, 16), 800, np.uint16)))


def test_pictures_are_told_apart(scene_folder: Folder) -> None:
    folder = scene_folder()
    (folder / "depth.npy").write_bytes(b"")
    with pytest.raises(InputError, match=r"depth.npy and depth.png"):
        read_scene(folder)


def test_a_translation_in_millimetres_is_noticed(scene_folder: Folder) -> None:
    with pytest.raises(InputError, match=r"T_robot_cam.* 500 m .*metres"):
        read_scene(scene_folder(T_robot_cam=[[1, 0, 0, 300.0], [0, 1, 0, 0], [0, 0, 1, 400.0], [0, 0, 0, 1]]))


def test_depth_of_eight_bits_is_refused(scene_folder: Folder) -> None:
    with pytest.raises(InputError, match="uint8"):
        read_scene(scene_folder(depth=np.full((24, 32), 80, np.uint8)))


def test_no_depth_at_all_is_refused(scene_folder: Folder) -> None:
    with pytest.raises(InputError, match="0 of 768 pixels"):
        read_scene(scene_folder(depth=np.zeros((24, 32), np.uint16)))


@pytest.mark.parametrize(("scale", "other"), [(1.0, "0.001"), (1e-6, "0.001")])
def test_depth_in_the_wrong_unit_names_both_readings(scene_folder: Folder, scale: float, other: str) -> None:
    with pytest.raises(InputError, match=f"depth_scale {scale:g} gives") as caught:
        read_scene(scene_folder(depth_scale=scale))
    assert f"with depth_scale {other} it would be 0.8 m" in str(caught.value) + caught.value.remedy


@pytest.mark.parametrize("key", ["fx", "fy", "cx", "cy", "width", "height", "depth_scale"])
@pytest.mark.parametrize("value", [..., float("nan"), float("inf"), "wide", None])
def test_a_camera_value_that_is_missing_or_not_finite_is_named(scene_folder: Folder, key: str, value: object) -> None:
    if key == "depth_scale" and value is ...:
        pytest.skip("may be inferred: see test_camera")
    with pytest.raises(InputError, match=f"camera.json: {key}"):
        read_scene(scene_folder(**{key: value}))


@pytest.mark.parametrize(
    "matrix", [[[1.0]], "none", [[2.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], [[float("nan")] * 4] * 4]
)
def test_a_transform_that_is_not_rigid_is_named(scene_folder: Folder, matrix: object) -> None:
    with pytest.raises(InputError, match="T_robot_cam"):
        read_scene(scene_folder(T_robot_cam=matrix))


def test_grey_and_sixteen_bit_pictures_become_rgb(scene_folder: Folder) -> None:
    assert read_scene(scene_folder(rgb=np.full((24, 32), 7, np.uint8))).rgb[0, 0].tolist() == [7, 7, 7]
    assert read_scene(scene_folder(rgb=np.full((24, 32, 3), 65535, np.uint16))).rgb[0, 0].tolist() == [255] * 3


@given(text=st.one_of(st.text(max_size=60), st.recursive(st.none() | st.floats() | st.text(), st.lists).map(repr)))
def test_any_other_text_is_a_named_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = tmp_path_factory.mktemp("camera") / "camera.json"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(InputError, match=r"camera\.json"):
        read_camera_file(file)


@given(
    values=st.fixed_dictionaries(
        {key: st.floats(500, 10_000) for key in ("fx", "fy")}
        | {key: st.floats(200, 300) for key in ("cx", "cy")}
        | {key: st.integers(500, 600) for key in ("width", "height")}
        | {"depth_scale": st.floats(1e-5, 1)}
    )
)
def test_a_camera_survives_its_own_json(tmp_path_factory: pytest.TempPathFactory, values: dict[str, float]) -> None:
    file = tmp_path_factory.mktemp("camera") / "camera.json"
    camera = Camera.model_validate(values)
    file.write_text(camera.model_dump_json())
    assert read_camera_file(file) == CameraFile(camera, states_scale=True)
