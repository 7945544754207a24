"""``grs scene`` on other forms than a folder, and what ``scene.json`` says of how they were read."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grs_agents.runs.sandbox_setup import PRELOAD
from tests.cli.command import grs
from tests.kept_sandbox import note_preloads
from tests.perception.conftest import Thing, render
from tests.perception.room import write
from tests.pictures import read_picture

ABOVE = (-0.6, 0.0, 1.35)
LOW_TABLE = Thing("box", (0.5, 0.0), (0.5, 0.7, 0.5))
CAN = Thing("cylinder", (0.45, 0.0), (0.12, 0.12, 0.13), bottom=0.5)
"""On that table, of a size that nothing in the library has."""


@pytest.fixture(scope="module")
def photo(small_scene: Path) -> dict[str, Any]:
    """The small scene as arrays."""
    camera = json.loads((small_scene / "camera.json").read_text())
    return {
        "rgb": read_picture(small_scene / "rgb.png")[..., ::-1],
        "depth": read_picture(small_scene / "depth.png") * camera["depth_scale"],
        "K": np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]]),
        "masks": cv2.imread(str(small_scene / "labels.png"), cv2.IMREAD_UNCHANGED),
        "T_robot_cam": np.array(camera["T_robot_cam"]),
    }


"""Which asset stands for a thing is not what these are about."""


def comprehended(folder: Path, source: str, *options: str) -> dict[str, Any]:
    done = grs("scene", source, "--out", "run", *options, folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "run/scene.json").read_text())


def test_an_archive_with_its_own_masks(tmp_path: Path, photo: dict[str, Any]) -> None:
    np.savez_compressed(tmp_path / "table.npz", **photo)
    scene = comprehended(tmp_path, "table.npz", "--set", "tools.segment=segment_masks")
    assert scene["frame"]["origin"] == "calibrated"
    assert len(scene["objects"]) + len(scene["dropped"]) == photo["masks"].max()
    assert all(one["reachable"] for one in scene["objects"])


def test_a_data_set_and_what_is_out_of_reach(tmp_path: Path, photo: dict[str, Any]) -> None:
    scene = tmp_path / "set/test/000001"
    millimetres = np.rint(photo["depth"] * 1000).astype(np.uint16)
    for name, image in (("rgb", photo["rgb"][..., ::-1]), ("depth", millimetres)):
        (scene / name).mkdir(parents=True)
        cv2.imwrite(str(scene / name / "000007.png"), image)
    entry = {"cam_K": photo["K"].reshape(-1).tolist(), "depth_scale": 1.0}
    (scene / "scene_camera.json").write_text(json.dumps({"7": entry}))
    told = comprehended(tmp_path, "bop:set/test/1/7")
    assert told["frame"]["origin"] == "table_plane"
    assert told["source"] == "bop:set/test/1/7"
    away = {one["name"] for one in told["objects"] if not one["reachable"]}
    assert {line.split()[0] for line in told["warnings"] if "out of the arm's reach" in line} == away


def test_a_calibrated_camera_far_away_leaves_objects_out_of_reach(tmp_path: Path, photo: dict[str, Any]) -> None:
    moved = photo["T_robot_cam"].copy()
    moved[0, 3] += 0.35
    np.savez_compressed(tmp_path / "table.npz", **(photo | {"T_robot_cam": moved}))
    told = comprehended(tmp_path, "table.npz")
    away = {one["name"] for one in told["objects"] if not one["reachable"]}
    assert away
    assert {line.split()[0] for line in told["warnings"] if "out of the arm's reach" in line} == away


def test_the_table_is_told_and_can_be_chosen(tmp_path: Path) -> None:
    write(render((LOW_TABLE, CAN), eye=ABOVE).frame, tmp_path / "low")
    (tmp_path / "low" / "rgb.png").rename(tmp_path / "elsewhere.png")
    (tmp_path / "low" / "rgb.png").symlink_to(tmp_path / "elsewhere.png")
    told = comprehended(tmp_path, "low")
    assert len(told["objects"]) == 1
    assert [(plane["number"], plane["taken"]) for plane in told["frame"]["planes"]] == [(1, False), (2, True)]
    assert any("--set scene.table=1" in warning for warning in told["warnings"])
    assert any("outside the scene's folder" in warning for warning in told["warnings"])  # of the reader of the files
    options = ("--set", "scene.table=largest")
    with note_preloads() as preloads:
        done = grs("scene", "low", "--out", "floor", *options, folder=tmp_path, own_sandbox=True)
    assert PRELOAD not in preloads  # no generated code is called
    assert done.returncode == 2
    assert "nothing on the table is an object" in done.stderr
    assert "--set scene.table=2" in done.stderr


@pytest.mark.parametrize(
    ("things", "setting", "problem"),
    [((), "scene.table=highest", "found nothing on the table"), ((CAN,), "match.proxies=false", "none of 1 segments")],
)
def test_nothing_found_on_a_doubtful_table_names_the_doubt(
    tmp_path: Path, things: tuple[Thing, ...], setting: str, problem: str
) -> None:
    write(render((LOW_TABLE, *things), eye=ABOVE).frame, tmp_path / "low")
    done = grs("scene", "low", "--out", "run", "--set", setting, folder=tmp_path)
    assert done.returncode == 2
    assert problem in done.stderr
    assert "--set scene.table=1" in done.stderr
