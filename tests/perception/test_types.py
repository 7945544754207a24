"""Scene descriptions are written and read whole."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.perception.types import Aabb, Camera, SceneDescription, TableFrame, read_scene_description

IDENTITY = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
COORDINATE = st.floats(-2, 2)


@given(low=st.tuples(COORDINATE, COORDINATE, COORDINATE), size=st.tuples(*[st.floats(0, 1)] * 3))
def test_a_box_knows_its_size_and_middle(low: tuple[float, ...], size: tuple[float, ...]) -> None:
    high = tuple(a + b for a, b in zip(low, size, strict=True))
    box = Aabb.model_validate({"low": low, "high": high})
    assert box.size == pytest.approx(size, abs=1e-9)
    assert all(a <= c + 1e-9 and c <= b + 1e-9 for a, c, b in zip(low, box.center, high, strict=True))


def test_a_description_survives_its_file(tmp_path: Path) -> None:
    table = TableFrame(T_robot_cam=IDENTITY, origin="table_plane", residual=0.001, inliers=0.5)
    camera = Camera(fx=40.0, fy=50.0, cx=15.5, cy=11.5, width=32, height=24, depth_scale=0.001, T_robot_cam=IDENTITY)
    scene = SceneDescription(
        source="photo",
        image="scene/rgb.png",
        frame=table,
        objects=(),
        warnings=("dim",),
        camera=camera.intrinsics,
        table_color=(0.5, 0.4, 0.3),
    )
    scene.write(tmp_path / "scene.json")
    assert read_scene_description(tmp_path / "scene.json") == scene


@pytest.mark.parametrize("content", ["", "{}", "[1]"])
def test_a_broken_description_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "scene.json").write_text(content)
    with pytest.raises(InputError, match=r"scene\.json"):
        read_scene_description(tmp_path / "scene.json")


def test_a_missing_description_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_scene_description(tmp_path / "scene.json")
