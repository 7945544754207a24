"""The scenes that a command line names."""

import json
from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.runs.batch.scene_list import list_scenes


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two scene folders, an archive, a folder without a photo, and a BOP data set of three images."""
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rgb.png").touch()
    (tmp_path / "c.npz").touch()
    (tmp_path / "notes").mkdir()
    for scene, images in (("000001", (2, 10)), ("000003", (1,))):
        (tmp_path / "bop" / "test" / scene).mkdir(parents=True)
        cameras = {str(image): {} for image in images}
        (tmp_path / "bop" / "test" / scene / "scene_camera.json").write_text(json.dumps(cameras))
    return tmp_path


def names(folder: Path, *scenes: str) -> list[str]:
    """The scenes found, without the folder they lie in."""
    return [scene.replace(f"{folder.resolve()}/", "") for scene in list_scenes(scenes)]


def test_a_folder_gives_the_scenes_in_it(folder: Path) -> None:
    assert names(folder, str(folder)) == ["a", "b", "c.npz"]


def test_a_glob_gives_what_fits_and_nothing_twice(folder: Path) -> None:
    assert names(folder, f"{folder}/b", f"{folder}/[ab]") == ["b", "a"]


def test_a_split_gives_its_images_in_their_order(folder: Path) -> None:
    images = [f"bop:bop/test/{image}" for image in ("000001/2", "000001/10", "000003/1")]
    assert names(folder, f"bop:{folder}/bop/test") == images
    assert names(folder, f"bop:{folder}/bop/test/000001") == images[:2]
    assert names(folder, f"bop:{folder}/bop/test/000001/10") == images[1:2]


def test_a_sample_scene_is_found_by_its_name() -> None:
    assert [Path(scene).name for scene in list_scenes(["groceries"])] == ["groceries"]


@pytest.mark.parametrize("name", ["nowhere", "notes", "*.jpg", "bop:bop/train"])
def test_what_names_no_scene_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(InputError, match=name.replace("*", r"\*")):
        list_scenes([name])
