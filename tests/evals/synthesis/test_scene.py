"""Synthesised scenes: the same recipe makes the same scene, and its labels, depth, boxes and poses agree."""

from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.ground_truth import read_labelled
from evals.synthesis import SENSORS, SynthesisedScene, SynthesisError, recipes, synthesise
from grs_agents.library.library import Library
from tests.evals.synthesis.conftest import SMALL


def _points(scene: SynthesisedScene) -> np.ndarray:
    """(H, W, 3) true points, robot frame."""
    camera, depth = scene.camera, scene.seen.depth
    rows, columns = np.indices(depth.shape)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(depth.shape)], -1)
    pose = np.array(camera.T_robot_cam)
    return local * depth[..., None] @ pose[:3, :3].T + pose[:3, 3]


def test_every_labelled_pixel_lies_in_its_objects_box(small: SynthesisedScene) -> None:
    points = _points(small)
    for one in small.truth.objects:
        assert one.box is not None
        mine = points[small.seen.labels == one.id]
        assert len(mine) == one.visible
        assert (mine >= np.array(one.box.low) - 1e-4).all()
        assert (mine <= np.array(one.box.high) + 1e-4).all()
        assert (one.visible or 0) <= (one.whole or 0)


def test_the_rest_of_the_table_is_at_zero(small: SynthesisedScene) -> None:
    heights = _points(small)[small.seen.labels == 0][:, 2]
    assert np.abs(np.median(heights)) < 1e-6
    assert heights.min() > -0.8


def test_everything_rests_on_the_table_or_on_another(small: SynthesisedScene) -> None:
    lows = [one.box.low[2] for one in small.truth.objects if one.box is not None]
    assert min(lows) == pytest.approx(0, abs=0.003)
    assert len(lows) == 4


def test_strange_things_have_no_asset(small: SynthesisedScene) -> None:
    names = [one.asset for one in small.truth.objects]
    assert names.count("") == 1
    assert all(name in Library() for name in names if name)


def test_the_camera_looks_down_as_far_as_asked(small: SynthesisedScene) -> None:
    forward = np.array(small.camera.T_robot_cam)[:3, 2]
    assert np.rad2deg(np.arcsin(-forward[2])) == pytest.approx(50.0, abs=1e-4)


def test_the_same_recipe_makes_the_same_files(small: SynthesisedScene, tmp_path: Path) -> None:
    small.write(tmp_path / "one")
    synthesise(SMALL, Library()).write(tmp_path / "other")
    names = sorted(file.name for file in (tmp_path / "one").iterdir())
    assert "truth.json" in names
    assert all((tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes() for name in names)


def test_a_written_scene_reads_back(small: SynthesisedScene, tmp_path: Path) -> None:
    small.write(tmp_path / "scene")
    scene = read_labelled(tmp_path / "scene")
    assert scene.truth == small.truth
    assert scene.frame.camera == small.camera
    assert np.array_equal(scene.labels, small.seen.labels)
    assert np.abs(scene.frame.depth - small.depth).max() <= 0.0005 + 1e-6
    assert np.array_equal(scene.frame.rgb, small.rgb)


def test_recipes_differ_and_cover_tilts_and_sensors() -> None:
    made = recipes(10, seed=3)
    assert len({recipe.seed for recipe in made}) == 10
    assert {recipe.sensor for recipe in made} == set(SENSORS)
    steps = sorted(int((recipe.tilt - 20) / 7) for recipe in made)
    assert steps == list(range(10))
    assert recipes(10, seed=3) == made != recipes(10, seed=4)


def test_more_distractors_than_objects_are_refused() -> None:
    with pytest.raises(SynthesisError, match="5 distractors"):
        synthesise(SMALL.model_copy(update={"distractors": 5}), Library())
