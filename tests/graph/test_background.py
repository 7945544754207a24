"""A room with its background on, from the photo to the verdict."""

import json
from pathlib import Path

import pytest

from grs_agents.library.background_asset import BACKGROUND
from tests.cli.command import grs
from tests.perception import room

ON = ("--set", "background.on=true", "--json")


@pytest.fixture
def photographed(tmp_path: Path) -> Path:
    """The folder of the room's photo."""
    frame, _, _ = room.photo(room.camera(width=640, height=480), 0.001)
    return room.write(frame, tmp_path / "room")


def test_a_scene_has_its_background_and_a_room_is_accepted_with_it(photographed: Path, tmp_path: Path) -> None:
    done = grs("scene", str(photographed), "--out", "scene", *ON, folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads((tmp_path / "scene/scene.json").read_text())["background"] == BACKGROUND
    assert (tmp_path / "scene/assets" / BACKGROUND).is_file()
    assert len(json.loads((tmp_path / "scene/scene.json").read_text())["objects"]) == 2
    done = grs("run", "scene", "--out", "run", *ON, folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)["status"] == "accepted"
    instances = sorted((tmp_path / "run/instances").glob("*.json"))
    assert [json.loads(file.read_text())["background"] for file in instances] == [BACKGROUND] * 3
    assert BACKGROUND not in (tmp_path / "run/simulation.py").read_text()
