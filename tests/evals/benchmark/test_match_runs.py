"""Correspondence measured on the sample scene: answers, figures and files; done once, not twice."""

import json
from pathlib import Path

import pytest

from evals.benchmark.match_runs import match_orders, run_match_orders
from evals.benchmark.match_types import f1_precision_recall, matching_file
from evals.benchmark.perception_runs import MeasurementOptions, orders_of
from grs_agents.base.errors import InputError
from grs_agents.runs.experiment_run import Experiment, ExperimentParser


def started(out: Path) -> Experiment:
    """The experiment, one scene at a time."""
    parser = ExperimentParser("correspondence", "")
    parser.add_argument("--workers", type=int, default=1)
    return parser.start(["--out", str(out), "--json"])


def test_orders_are_for_each_method_model_and_run(sample_scene: Path) -> None:
    scenes = orders_of([str(sample_scene)], MeasurementOptions(""), 1)
    orders = match_orders(scenes, ["features", "both"], ["offline", "other"], 2, [])
    told = [(one.method.name, one.model, one.run) for one in orders]
    assert told == [("features", "-", 0), *(("both", model, run) for model in ("offline", "other") for run in (0, 1))]
    assert len({one.stem for one in orders}) == len(orders)


def test_a_scene_is_matched_once(small_scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    orders = match_orders(orders_of([str(small_scene)], MeasurementOptions(""), 1), ["both"], ["offline"], 1, [])
    assert run_match_orders(orders, started(tmp_path), ["offline=1,2"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / "figures.json").read_text()) == figures
    (row,) = figures["table"]
    assert (row["method"], row["scenes"], row["runs"]) == ("both", 1, 1)
    assert float(row["F1"]) >= 0.8
    assert float(row["cost"]) > 0
    for name in ("table1.md", "table1.csv", "objects.csv", "confusions.csv", "f1.png", "sheet-both.png"):
        assert (tmp_path / name).stat().st_size > 0
    files = [matching_file(tmp_path, order) for order in orders]
    before = [file.stat().st_mtime_ns for file in files]
    assert run_match_orders(orders, started(tmp_path), []) == 0
    assert [file.stat().st_mtime_ns for file in files] == before


def test_a_price_without_numbers_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="MODEL=IN,OUT"):
        run_match_orders([], started(tmp_path), ["offline=cheap"])


def test_scores_of_counts() -> None:
    assert f1_precision_recall((8, 1, 3)) == pytest.approx((0.8, 8 / 9, 8 / 11))
    assert f1_precision_recall((0, 0, 0)) == (1.0, 1.0, 1.0)
    assert f1_precision_recall((0, 2, 0)) == (0.0, 0.0, 1.0)
