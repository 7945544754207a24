"""Colour, depth and camera come to one grid: invalid pixels, other sizes, portrait and very large photos."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.frame_assembly import have_same_aspect_ratio, resize_depth
from grs_agents.perception.reading.scene_source import read_scene
from tests.perception.reading.conftest import CAMERA, Truth, npy_of, png, write


def plane(rows: int, columns: int, focal: float) -> Any:
    """Depth of a slanted plane, seen by a camera whose picture is ``columns`` wide and ``focal`` times that long."""
    v, u = np.indices((rows, columns))
    x, y = ((u + 0.5) / columns - 0.5) / focal, ((v + 0.5) / rows - 0.5) / focal
    return (1 / (1.2 + 0.3 * x + 0.8 * y)).astype(np.float32)


def scene(folder: Path, rgb: Any, depth: Any, **camera: Any) -> Path:
    return write(folder, CAMERA | camera, rgb__png=png(rgb), depth__npy=npy_of(depth, folder))


@pytest.mark.parametrize("bad", [0, -1, np.nan, np.inf, -np.inf, 1e30, 65.535])
def test_what_is_no_depth_becomes_nought(tmp_path: Path, truth: Truth, bad: float) -> None:
    depth = truth.depth.copy()
    depth[0, :5] = bad
    assert not read_scene(scene(tmp_path, truth.rgb, depth)).depth[0, :5].any()


def test_saturated_pixels_become_nought(tmp_path: Path, truth: Truth) -> None:
    units = np.rint(truth.depth * 1000).astype(np.uint16)
    units[0, :5] = 65535
    frame = read_scene(scene(tmp_path, truth.rgb, units, depth_scale=0.001))
    assert not frame.depth[0, :5].any() and frame.depth[1, 0] > 0


@pytest.mark.parametrize("scale", [2, 3, 4.5])
def test_small_depth_is_brought_to_the_photo(tmp_path: Path, truth: Truth, scale: float) -> None:
    rows, columns = int(36 * scale), int(48 * scale)
    rgb = np.zeros((rows, columns, 3), np.uint8)
    frame = read_scene(scene(tmp_path, rgb, plane(36, 48, 1.25)))
    assert frame.depth.shape == (rows, columns)
    inside = np.s_[8:-8, 8:-8]
    assert np.abs(frame.depth - plane(rows, columns, 1.25))[inside].max() < 1e-4
    assert frame.camera.fx == pytest.approx(60 * scale)
    assert frame.camera.cx == pytest.approx(23.5 * scale - 0.5)
    assert any("brought to" in note for note in frame.notes)


def test_the_camera_may_be_the_photos_own(tmp_path: Path) -> None:
    rgb = np.zeros((72, 96, 3), np.uint8)
    frame = read_scene(scene(tmp_path, rgb, plane(36, 48, 1.25), width=96, height=72))
    assert (frame.camera.fx, frame.camera.cx) == (60.0, 23.0)
    assert np.abs(frame.depth - plane(72, 96, 1.25))[4:-4, 4:-4].max() < 1e-4


def test_large_depth_comes_down_to_the_photo(tmp_path: Path) -> None:
    frame = read_scene(scene(tmp_path, np.zeros((36, 48, 3), np.uint8), plane(144, 192, 1.25)))
    assert np.abs(frame.depth - plane(36, 48, 1.25)).max() < 0.01


def test_the_camera_must_be_of_one_of_the_pictures(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(InputError, match=r"48x36 but camera.json says 96x72"):
        read_scene(scene(tmp_path, truth.rgb, truth.depth, width=96, height=72))


def test_a_portrait_photo_is_read(tmp_path: Path, truth: Truth) -> None:
    apply_orientation = {"width": 36, "height": 48, "cx": 18.0, "cy": 23.0}
    frame = read_scene(scene(tmp_path, truth.rgb.transpose(1, 0, 2), truth.depth.T, **apply_orientation))
    assert frame.depth.shape == (48, 36)


def test_a_photo_above_4k_is_made_smaller(tmp_path: Path) -> None:
    rgb = np.zeros((3000, 4000, 3), np.uint8)
    frame = read_scene(scene(tmp_path, rgb, plane(36, 48, 1.25)))
    rows, columns = frame.depth.shape
    assert 8_900_000 < rows * columns <= 9_000_000
    assert frame.rgb.shape == (rows, columns, 3)
    assert frame.camera.fx == pytest.approx(60 * columns / 48)
    assert any("smaller" in note for note in frame.notes)


def test_nothing_is_made_up_between_surfaces() -> None:
    depth = np.full((20, 20), 1.0, np.float32)
    depth[:, 10:] = 0.5
    depth[:5] = 0
    assert set(np.unique(resize_depth(depth, 60, 60).round(5))) == {0.0, 0.5, 1.0}


@given(width=st.integers(8, 5000), height=st.integers(8, 5000), times=st.integers(1, 9))
def test_a_multiple_has_the_same_shape(width: int, height: int, times: int) -> None:
    assert have_same_aspect_ratio((width, height), (width * times, height * times))
    assert have_same_aspect_ratio((width * times, height * times), (width, height))
    assert not have_same_aspect_ratio((width, height), (width * times, height * times + 2 * times))


@given(
    rows=st.integers(8, 40),
    columns=st.integers(8, 40),
    to=st.tuples(st.integers(8, 90), st.integers(8, 90)),
    seed=st.integers(0, 99),
)
def test_resizing_stays_within_what_was_measured(rows: int, columns: int, to: tuple[int, int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random((rows, columns)) < 0.3, 0, rng.uniform(0.5, 0.52, (rows, columns))).astype(np.float32)
    out = resize_depth(depth, *to)
    assert out.shape == (to[1], to[0])
    assert out.max() <= depth.max() + 1e-6
    assert out[out > 0].min(initial=9) >= depth[depth > 0].min(initial=9) - 1e-6
