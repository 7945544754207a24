"""Photos without depth: who is asked, where the lens is told, and what comes of it."""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.scene_source import read_scene
from tests.perception.reading.conftest import CAMERA, Truth, png, write, write_bop


@dataclass(frozen=True)
class Estimate:
    depth: Any
    focal: float | None = None


@dataclass
class Model:
    """A model that sees a plane a metre away, and remembers what it was asked."""

    focal: float | None = None
    depth: Any = None
    asked: tuple[tuple[int, ...], float | None, str] | None = None

    def __call__(self, rgb: Any, focal: float | None, photo: str) -> Estimate:
        self.asked = (rgb.shape, focal, photo)
        return Estimate(np.ones(rgb.shape[:2], np.float32) if self.depth is None else self.depth, self.focal)


def photo(folder: Path, truth: Truth, orientation: int = 1, focal: int = 0) -> Path:
    exif = Image.Exif()
    exif[0x0112] = orientation
    if focal:
        exif.get_ifd(0x8769)[0xA405] = focal
    data = BytesIO()
    Image.fromarray(truth.rgb).save(data, "JPEG", exif=exif)
    write(folder, photo__jpg=data.getvalue())
    return folder / "photo.jpg"


def test_without_a_depth_tool_a_photo_is_refused(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(InputError, match=r"photo\.jpg has no depth"):
        read_scene(photo(tmp_path, truth))


def test_the_camera_beside_it_tells_the_lens(tmp_path: Path, truth: Truth) -> None:
    model, source = Model(focal=99.0), photo(tmp_path, truth, focal=26)
    write(tmp_path, CAMERA)
    frame = read_scene(source, model, 60)
    assert model.asked == ((36, 48, 3), 60.0, str(source))
    assert (frame.camera.fx, frame.camera.fy, frame.camera.cy) == (60.0, 62.0, 18.5)
    assert (frame.depth == 1).all()
    assert any("estimated" in note for note in frame.notes)


def test_an_angle_tells_it_next(tmp_path: Path, truth: Truth) -> None:
    frame = read_scene(photo(tmp_path, truth, focal=26), Model(focal=99.0), 90)
    assert frame.camera.fx == pytest.approx(24)
    assert (frame.camera.cx, frame.camera.cy) == (23.5, 17.5)


def test_the_photo_tells_it_next(tmp_path: Path, truth: Truth) -> None:
    frame = read_scene(photo(tmp_path, truth, focal=26), Model(focal=99.0))
    assert frame.camera.fx == pytest.approx(26 / 43.267 * 60, rel=1e-3)  # the diagonal of 48 x 36 is 60 pixels
    assert any("EXIF" in note for note in frame.notes)


def test_the_model_tells_it_last(tmp_path: Path, truth: Truth) -> None:
    assert read_scene(photo(tmp_path, truth), Model(focal=55.0)).camera.fx == 55
    with pytest.raises(InputError, match=r"focal length.*depth\.field_of_view"):
        read_scene(photo(tmp_path, truth), Model())


def test_a_turned_photo_is_turned(tmp_path: Path, truth: Truth) -> None:
    frame = read_scene(photo(tmp_path, truth, orientation=6), Model(), 60)
    assert frame.rgb.shape == (48, 36, 3)


def test_a_folder_and_a_data_set_without_depth_are_photos(tmp_path: Path, truth: Truth) -> None:
    folder = write(tmp_path / "folder", CAMERA, rgb__png=png(truth.rgb))
    assert (read_scene(folder, Model()).depth == 1).all()
    bop = write_bop(tmp_path / "set", truth)
    (tmp_path / "set/test/000048/depth/000012.png").unlink()
    assert (read_scene(bop, Model()).depth == 1).all()


def test_a_small_estimate_is_brought_to_the_photo(tmp_path: Path, truth: Truth) -> None:
    assert read_scene(photo(tmp_path, truth), Model(depth=np.ones((18, 24))), 60).depth.shape == (36, 48)


@pytest.mark.parametrize(
    "depth",
    [
        np.zeros((36, 48)),
        np.full((36, 48), np.nan),
        np.full((36, 48), 900.0),
        np.ones((36, 48), int),
        np.ones((1, 36, 48)),
        np.ones((36, 36)),
        np.ones((0, 0)),
        np.ones(0),
    ],
    ids=lambda value: f"{value.shape} {value.dtype}",
)
def test_an_estimate_of_no_use_is_named(tmp_path: Path, truth: Truth, depth: Any) -> None:
    with pytest.raises(InputError, match=r"photo\.jpg"):
        read_scene(photo(tmp_path, truth), Model(depth=depth), 60)
