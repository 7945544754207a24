"""BOP data sets: numbers with and without zeros, depth in their unit, and what is missing is named."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene
from tests.perception.reading.conftest import FX, Truth, png, write_bop


@pytest.fixture
def bop(tmp_path: Path, truth: Truth) -> Path:
    return write_bop(tmp_path / "set", truth)


def scene_of(bop: Path) -> Path:
    return Path(str(bop).removeprefix("bop:")).parent.with_name("000048")


def change(bop: Path, **values: Any) -> None:
    file = scene_of(bop) / "scene_camera.json"
    entries = json.loads(file.read_text())
    entries["12"] |= values
    file.write_text(json.dumps(entries))


@pytest.mark.parametrize("name", ["48/12", "000048/000012", "48/000012"])
def test_zeros_may_be_left_out(bop: Path, truth: Truth, name: str) -> None:
    frame = read_scene(Path(f"bop:{scene_of(bop).parent}/{name}"))
    assert np.abs(frame.depth - truth.depth).max() < 1e-6
    assert frame.camera.fx == FX and frame.camera.depth_scale == pytest.approx(1e-4)


def test_grey_images_serve(bop: Path, truth: Truth) -> None:
    (scene_of(bop) / "gray").mkdir()
    (scene_of(bop) / "rgb/000012.png").unlink()
    (scene_of(bop) / "gray/000012.tif").write_bytes(cv2.imencode(".tif", truth.rgb[..., 0])[1].tobytes())
    assert (read_scene(bop).rgb == truth.rgb[..., :1]).all()


def test_visible_masks_are_its_objects(bop: Path, truth: Truth) -> None:
    labels = read_masks(bop, (36, 48)).labels
    assert (labels == 1).sum() == (truth.labels == 3).sum()
    assert (labels == 2).sum() == (truth.labels == 7).sum()


@pytest.mark.parametrize(
    "name", ["", "12", "48/", "48/x", "48/-1", "48/1.5", "49/12", "48/99999999999", "nowhere/at/all/1", "48/²"]
)
def test_what_is_not_there_is_named(bop: Path, name: str) -> None:
    source = Path(f"bop:{scene_of(bop).parent if '/' in name else ''}/{name}")
    with pytest.raises(InputError, match=r"bop:|scene_camera\.json"):
        check_scene_source(source)
        read_scene(source)


def test_an_image_that_is_not_there_is_named_with_those_that_are(bop: Path) -> None:
    with pytest.raises(InputError, match="no image 13; name one of those it has: 1 from 12 to 12"):
        read_scene(bop.with_name("13"))


@pytest.mark.parametrize("name", ["rgb/000012.png", "scene_camera.json", "depth/000012.png"])
def test_a_missing_file_is_named(bop: Path, name: str) -> None:
    (scene_of(bop) / name).unlink()
    with pytest.raises(InputError, match=r"rgb/000012|scene_camera\.json"):
        read_scene(bop)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"cam_K": None}, "cam_K"),
        ({"cam_K": "wide"}, "cam_K"),
        ({"cam_K": [1.0] * 8}, "cam_K"),
        ({"cam_K": [float("nan")] * 9}, "cam_K"),
        ({"cam_K": [10**400, 0, 23, 0, 60, 18, 0, 0, 1]}, "cam_K"),
        ({"cam_K": [-60, 0, 23, 0, 60, 18, 0, 0, 1]}, "cam_K"),
        ({"depth_scale": None}, "depth_scale"),
        ({"depth_scale": 0}, "depth_scale"),
        ({"depth_scale": "mm"}, "depth_scale"),
        ({"depth_scale": float("inf")}, "depth_scale"),
        ({"depth_scale": 1000.0}, r"depth_scale.*millimetres"),
    ],
    ids=str,
)
def test_a_camera_that_is_none_is_named(bop: Path, values: dict[str, Any], word: str) -> None:
    change(bop, **values)
    with pytest.raises(InputError, match=word):
        read_scene(bop)


@pytest.mark.parametrize("content", [b"", b"[]", b'{"12": 3}', b'{"12": null}', b"\xff\xfe", b"[" * 100_000, b"{}"])
def test_a_broken_camera_file_is_named(bop: Path, content: bytes) -> None:
    (scene_of(bop) / "scene_camera.json").write_bytes(content)
    with pytest.raises(InputError, match=r"scene_camera\.json"):
        read_scene(bop)


def test_no_masks_are_named(bop: Path) -> None:
    for file in (scene_of(bop) / "mask_visib").iterdir():
        file.unlink()
    with pytest.raises(InputError, match="0 masks 000012_"):
        read_masks(bop, (36, 48))
    (scene_of(bop) / "mask_visib").rmdir()
    with pytest.raises(InputError, match="mask_visib"):
        read_masks(bop, (36, 48))


def test_depth_of_another_size_is_brought_to_the_photo(bop: Path, truth: Truth) -> None:
    (scene_of(bop) / "depth/000012.png").write_bytes(png(np.full((18, 24), 9000, np.uint16)))
    assert read_scene(bop).depth.shape == truth.depth.shape
