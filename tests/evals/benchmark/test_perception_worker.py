"""Measuring a scene: perfect masks score perfectly, mistakes show, the frame found blind is compared."""

import json
from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.box_errors import frame_figures, object_figures
from evals.benchmark.figures import COLUMNS, calibration_error, perception_targets, scene_row, total_rows
from evals.benchmark.ground_truth import read_labelled
from evals.benchmark.perception_worker import measure_scene
from evals.benchmark.scene_run import TWIN, TWIN_ASIDE
from evals.benchmark.types import Order, Result, result_file, run_folder
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.library.library import Library
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table


@pytest.fixture(scope="module")
def measured(sample_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """The sample scene measured with the default tool, and the folder of its result."""
    out = tmp_path_factory.mktemp("measured")
    return measure_scene(Order(name="groceries", source=str(sample_scene), tool="segment_rgbd"), out), out


def test_the_sample_scene_is_measured_whole(measured: tuple[Result, Path]) -> None:
    figures = measured[0].figures
    assert (figures.score.objects, figures.score.hits[0], figures.error) == (11, 11, "")
    assert figures.cpu_seconds > 0 < figures.peak_mib
    assert figures.frame is not None
    assert figures.frame.tilt < 1
    assert abs(figures.frame.height) < 0.005
    assert np.median([one.center for one in figures.objects if one.center is not None]) < 0.01
    assert np.median([one.size for one in figures.objects if one.size is not None]) < 0.015


def test_the_run_of_the_sample_scene_is_compared_with_the_truth(measured: tuple[Result, Path]) -> None:
    figures, out = measured[0].figures, measured[1]
    assert figures.run is not None
    assert figures.twin is not None
    assert figures.run.true_coverage is not None
    assert 0.9 < figures.run.true_coverage <= 1
    assert (figures.run.right_segments, figures.run.kept_segments) == (11, 11)
    right = [one for one in figures.objects if one.right]
    assert len(right) >= 9
    assert all(one.stands == "asset" and one.adds is not None and one.adds < 0.1 for one in right)
    assert np.median([one.silhouette for one in figures.objects if one.silhouette is not None]) > 0.85
    assert all(one.depth_error is not None and one.depth_error < 0.02 for one in right)
    assert all((run_folder(out, "groceries") / name).is_file() for name in (TWIN, TWIN_ASIDE))


def test_a_result_is_read_back_as_it_was(measured: tuple[Result, Path]) -> None:
    result, out = measured
    file = result_file(out, "groceries")
    assert Result.model_validate_json(file.read_text()) == result
    assert file.with_suffix(".png").exists()


def test_the_true_masks_give_the_true_boxes(sample_scene: Path) -> None:
    scene = read_labelled(sample_scene)
    table = find_table(scene.frame, np.random.default_rng(0))
    candidates = measure_candidates(scene.frame, table, scene.labels)
    figures = object_figures(scene, scene.labels, candidates, Library())
    assert [one.iou for one in figures] == [1.0] * 11
    assert max(one.center for one in figures if one.center is not None) < 0.012


def test_a_tilted_frame_shows_its_tilt_and_height(sample_scene: Path) -> None:
    scene = read_labelled(sample_scene)
    angle = np.deg2rad(3)
    turn, camera = np.eye(4), scene.frame.camera
    turn[:3, :3] = [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    turn[2, 3] = 0.02
    pose = (turn @ np.array(camera.T_robot_cam)).tolist()
    moved = type(scene.frame)(
        scene.frame.rgb, scene.frame.depth, camera.model_copy(update={"T_robot_cam": pose}), scene.frame.source
    )
    figures = frame_figures(type(scene)(scene.name, moved, scene.labels), np.random.default_rng(0))
    assert figures is not None
    assert figures.tilt == pytest.approx(3, abs=0.15)
    # the true table (z = 0 of the given frame) now lies 2 cm below the one that is seen
    assert figures.height == pytest.approx(0.02, abs=0.004)


def test_the_tool_is_asked_with_the_model_that_is_named(tmp_path: Path, sample_scene: Path) -> None:
    order = Order(name="x", source=str(sample_scene), tool="segment_sam2", model=str(tmp_path / "no-model"))
    result = measure_scene(order, tmp_path)
    assert "no-model" in result.figures.error


def test_a_rule_that_is_off_changes_the_segments(
    tmp_path: Path, sample_scene: Path, measured: tuple[Result, Path]
) -> None:
    order = measured[0].order.model_copy(update={"without": ("common_rim", "interior", "flying_pixels")})
    assert measure_scene(order, tmp_path).figures.score.segments > measured[0].figures.score.segments


def test_a_tool_without_rules_says_so(tmp_path: Path, sample_scene: Path) -> None:
    order = Order(name="x", source=str(sample_scene), tool="segment_masks", without=("cap",))
    assert measure_scene(order, tmp_path).figures.error == "tool segment_masks has no rules that can be off"


def test_a_row_has_every_column_and_targets_are_kept(measured: tuple[Result, Path]) -> None:
    figures = measured[0].figures
    assert set(scene_row(figures)) == set(total_rows([figures])[0]) == set(COLUMNS)
    by_name = {one.name: one for one in perception_targets([figures])}
    assert by_name["F1 at IoU 0.5"].value == 1.0
    assert by_name["F1 at IoU 0.5"].is_target_met
    assert by_name["CPU up to 1920x1080, largest"].is_target_met is None
    json.dumps(scene_row(figures), allow_nan=False)


def test_confidence_is_calibrated_where_it_says_how_often_it_is_right() -> None:
    assert calibration_error([]) is None
    assert calibration_error([(0.75, True), (0.75, True), (0.75, True), (0.75, False)]) == pytest.approx(0)
    assert calibration_error([(0.95, False), (0.95, False)]) == pytest.approx(0.95)
    assert calibration_error([(0.95, False), (0.95, False), (0.25, True), (0.25, False)]) == pytest.approx(0.6)


def test_what_cannot_be_measured_is_refused(tmp_path: Path, sample_scene: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        measure_scene(Order(name="none", source=str(tmp_path / "none"), tool="segment_rgbd"), tmp_path)
    with pytest.raises(UnknownNameError, match="segment_nothing"):
        measure_scene(Order(name="x", source=str(sample_scene), tool="segment_nothing"), tmp_path)
