"""Whatever is wrong with what a user gives: one line that names it, exit status 2, and a folder that says so."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from grs_agents.base import content
from tests.cli.command import Done, grs
from tests.needs import needs
from tests.pictures import read_picture


def copy_scene(sample_scene: Path, folder: Path) -> Path:
    scene = folder / "scene"
    shutil.copytree(sample_scene, scene)
    return scene


def assert_refused(done: Done, *words: str) -> None:
    assert done.returncode == 2, done.stderr
    *progress, error = done.stderr.strip().splitlines()
    assert all(": done in " in line for line in progress), done.stderr
    assert error.startswith("grs: ") and not done.stdout
    for word in words:
        assert word in error, error


def set_camera(scene: Path, **values: object) -> None:
    file = scene / "camera.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **values}))


def no_rgb(scene: Path) -> None:
    (scene / "rgb.png").unlink()


def torn_rgb(scene: Path) -> None:
    (scene / "rgb.png").write_bytes((scene / "rgb.png").read_bytes()[:100])


def other_size(scene: Path) -> None:
    cv2.imwrite(str(scene / "depth.png"), np.full((100, 100), 900, np.uint16))


def no_depth(scene: Path) -> None:
    depth = read_picture(scene / "depth.png")
    cv2.imwrite(str(scene / "depth.png"), np.zeros_like(depth))


def wrong_unit(scene: Path) -> None:
    set_camera(scene, depth_scale=1.0)


def ten_times_too_near(scene: Path) -> None:
    set_camera(scene, depth_scale=0.00015)


def absurd_lens(scene: Path) -> None:
    set_camera(scene, fx=1e-9)


def not_finite(scene: Path) -> None:
    (scene / "camera.json").write_text((scene / "camera.json").read_text().replace('"fx": ', '"fx": NaN, "_": '))


def missing_value(scene: Path) -> None:
    camera = json.loads((scene / "camera.json").read_text())
    del camera["fy"]
    (scene / "camera.json").write_text(json.dumps(camera))


def no_plane(scene: Path) -> None:
    depth = read_picture(scene / "depth.png")
    noise = np.random.default_rng(0).integers(500, 3000, depth.shape)
    cv2.imwrite(str(scene / "depth.png"), noise.astype(np.uint16))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (no_rgb, ("rgb.png",)),
        (torn_rgb, ("rgb.png",)),
        (other_size, ("depth.png", "100")),
        (no_depth, ("depth.png",)),
        (wrong_unit, ("depth_scale",)),
        (ten_times_too_near, ("T_robot_cam", "depth_scale")),
        (absurd_lens, ("camera.json", "fx")),
        (not_finite, ("camera.json",)),
        (missing_value, ("camera.json", "fy")),
        (no_plane, ("table",)),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_bad_scene(tmp_path: Path, sample_scene: Path, spoil: Callable[[Path], None], words: tuple[str, ...]) -> None:
    scene = copy_scene(sample_scene, tmp_path)
    spoil(scene)
    done = grs("run", str(scene), "--out", "run", folder=tmp_path)
    assert_refused(done, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


def test_a_refused_scene_leaves_of_its_folders_those_that_were_there(tmp_path: Path, sample_scene: Path) -> None:
    scene = copy_scene(sample_scene, tmp_path)
    torn_rgb(scene)
    assert_refused(grs("run", str(scene), folder=tmp_path), "rgb.png")
    assert not (tmp_path / "runs").exists()
    (tmp_path / "mine").mkdir()
    for out in ("mine", "mine/deep/run"):
        assert_refused(grs("scene", str(scene), "--out", out, folder=tmp_path), "rgb.png")
        assert not list((tmp_path / "mine").iterdir())


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("models.default=nobody:any", ("no module 'nobody' in Python's path or in the current folder", "offline")),
        ("models.default=openai:any", ("OPENAI_API_KEY",)),
        ("policy=guess", ("guess", "rules")),
        ("graph=grss", ("grss", "grs")),
        ("tools.segment=magic", ("magic", "segment_rgbd")),
        ("tools.segment=run_tests", ("run_tests", "frame")),
        ("prompts.task=magic", ("magic", "task")),
        ("graph=router", ("router", "task and scene")),
        ("graph=scene", ("scene", "verdict")),
        ("max_fixes=-1", ("max_fixes",)),
        ("colour=red", ("colour", "use one of: ")),
    ],
)
def test_a_bad_setting(tmp_path: Path, sample_scene: Path, setting: str, words: tuple[str, ...]) -> None:
    done = grs("run", str(sample_scene), "--out", "run", "--set", setting, folder=tmp_path)
    assert_refused(done, *words)
    assert not (tmp_path / "run").exists()


def test_a_photo_alone_needs_a_depth_tool(tmp_path: Path, sample_scene: Path) -> None:
    alone, work = tmp_path / "alone", tmp_path / "work"
    alone.mkdir()
    work.mkdir()
    photo = str(shutil.copy(sample_scene / "rgb.png", alone))
    done = grs("scene", photo, "--out", "given", folder=work)
    assert_refused(done, "rgb.png", "no depth", "tools.depth=depth_transformers")
    done = grs("scene", photo, "--set", "tools.depth=depth_transformers", "--out", "asked", folder=work)
    assert_refused(done, "depth.model")
    assert not list(work.iterdir())


@pytest.mark.parametrize("source", ["bop:nowhere/test/1/1", "bop:1", "cloud.ply", "notes.txt"])
def test_what_is_no_scene_is_found_before_a_folder_is_made(tmp_path: Path, source: str) -> None:
    for name in ("cloud.ply", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    assert_refused(grs("run", source, folder=tmp_path), source)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("name", "kind", "way"),
    [
        ("desk.svo", "a ZED recording", "rgb.png, depth.png aligned with it, camera.json"),
        ("desk.usdz", "a USD model or room scan", "grs assets import"),
        ("desk.mp4", "a video", "one frame"),
        ("desk.zip", "an archive", "unpack it"),
        ("desk.dng", "a raw photo", "develop it"),
    ],
)
def test_a_capture_of_another_kind_is_named_with_the_way_in(tmp_path: Path, name: str, kind: str, way: str) -> None:
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / name).write_bytes(b"\0" * 64)
    for source in (f"scene/{name}", "scene"):  # the file, and the folder that holds nothing else
        assert_refused(grs("run", source, folder=tmp_path), name, kind, way)
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


def test_no_such_folder(tmp_path: Path) -> None:
    assert_refused(grs("run", "nowhere", folder=tmp_path), "nowhere")
    assert not (tmp_path / "runs").exists()


def test_comprehension_has_one_graph(tmp_path: Path, sample_scene: Path) -> None:
    assert_refused(grs("scene", str(sample_scene), "--set", "graph=grs", folder=tmp_path), "grs", "scene")


def test_a_graph_of_ones_own_must_come_to_a_verdict(tmp_path: Path, known_scene: Path) -> None:
    (tmp_path / "mine" / "graphs").mkdir(parents=True)
    text = content.content_path("graphs", "scene").read_text().replace("VERDICT = False", "VERDICT = True")
    (tmp_path / "mine" / "graphs" / "endless.py").write_text(text)
    arguments = (
        "--content",
        str(tmp_path / "mine"),
        "run",
        str(known_scene),
        "--out",
        "run",
        "--set",
        "graph=endless",
    )
    done = grs(*arguments, folder=tmp_path)
    assert done.returncode == 2
    assert "graph 'endless' ended without a verdict" in done.stderr.strip().splitlines()[-1]
    assert json.loads((tmp_path / "run" / "run.json").read_text())["counts"]["objects"] == 3


def test_an_existing_run(tmp_path: Path, sample_scene: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    assert_refused(grs("run", str(sample_scene), "--out", "run", folder=tmp_path), "--resume")


def test_a_folder_that_cannot_be_written(tmp_path: Path, sample_scene: Path) -> None:
    done = grs("run", str(sample_scene), "--out", "/proc/run", folder=tmp_path)
    assert_refused(done, "/proc/run", "--out")


@needs("mounts")
def test_a_full_disk(tmp_path: Path, small_scene: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=700k", "none", str(disk)], check=True)
    try:
        # A process of its own: its files must be closed before the disk can go.
        command = [sys.executable, "-m", "grs_agents", "run", str(small_scene), "--out", str(disk / "run")]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        said = ended.stderr.splitlines()[-1]  # the recording warns too: it lost its file
        assert_refused(Done(ended.returncode, ended.stdout, said), "cannot write", "--out")
        assert json.loads((disk / "run" / "run.json").read_text())["status"] == "failed"
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)
