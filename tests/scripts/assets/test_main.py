"""The generator writes what is committed."""

from pathlib import Path

import numpy as np

from grs_agents import content
from grs_agents.library import Library
from scripts.assets.__main__ import write_library
from scripts.assets.scene import write_scene
from tests.pictures import read_picture


def test_the_committed_library_is_what_the_code_writes(tmp_path: Path) -> None:
    shipped = Library().roots[0]
    (tmp_path / "stray.urdf").write_text("of an older version")
    write_library(tmp_path)
    written = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()}
    assert written == {file.relative_to(shipped).as_posix() for file in shipped.rglob("*") if file.is_file()}
    for name in sorted(written):  # the letters of the textures depend on the version of OpenCV
        if not name.endswith(".png"):
            assert (tmp_path / name).read_bytes() == (shipped / name).read_bytes(), name


def test_the_committed_scene_is_what_the_code_draws(tmp_path: Path) -> None:
    shipped = content.path("assets", "scenes") / "groceries"
    write_scene(tmp_path, Library())
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in shipped.iterdir())
    for name in ("SOURCE.txt", "camera.json", "truth.json"):
        assert (tmp_path / name).read_text() == (shipped / name).read_text()
    for name, bound in (("labels.png", 0.1), ("depth.png", 1.0), ("rgb.png", 2.0)):
        drawn, kept = (read_picture(folder / name) for folder in (tmp_path, shipped))
        assert drawn.shape == kept.shape
        assert np.abs(drawn.astype(float) - kept).mean() < bound
