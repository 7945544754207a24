"""Every experiment can be asked what it does; those with scenes make their figures."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from evals.faults.planting import read_fault_folders
from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.runs.experiments import CHECKOUT_ONLY, load_experiment

OPTIONS = ("--out", "--config", "--set", "--json")


@pytest.mark.parametrize("name", content.content_names("evals"))
def test_every_experiment_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    module = content.load_module("evals", name)
    assert module.__doc__
    with pytest.raises(SystemExit) as caught:
        module.main(["--help"])
    assert caught.value.code == 0
    told = capsys.readouterr().out
    assert name in told
    assert [option for option in OPTIONS if f"\n  {option} " in told] == [*OPTIONS]


def test_routing_of_no_fault_is_an_error(tmp_path: Path) -> None:
    main = content.load_module("evals", "routing").main
    with pytest.raises(InputError, match="none of 0 faults was routed"):
        main(["--only", "no such fault", "--out", str(tmp_path)])


def write_pairs(folder: Path, **programs: str) -> None:
    """Pairs in folders, each with this program and the same tests, and the task of ``BASE``."""
    for name, program in programs.items():
        (folder / name).mkdir()
        (folder / name / "simulation.py").write_text(program)
        (folder / name / "test_simulation.py").write_text("")
    task = {"task-name": "t", "task-description": "Put a into b.", "assets-used": ["a"]}
    (folder / "BASE" / "task.json").write_text(json.dumps(task))


def test_a_fault_in_a_folder_of_any_name_is_in_the_file_that_differs_from_the_base(tmp_path: Path) -> None:
    write_pairs(tmp_path, BASE="1\n")
    with pytest.raises(InputError, match=r"no folder with simulation\.py and test_simulation\.py beside BASE"):
        read_fault_folders(tmp_path)
    write_pairs(tmp_path, wrong_asset="2\n", weak="1\n")
    (tmp_path / "notes").mkdir()
    with pytest.raises(InputError, match="weak differs from BASE in neither"):
        read_fault_folders(tmp_path)
    (tmp_path / "weak" / "test_simulation.py").write_text("pass\n")
    truths = {fault.name: fault.truth for fault in read_fault_folders(tmp_path)}
    assert truths == {"wrong_asset": "fix_code", "weak": "fix_test"}


def test_faults_in_folders_are_of_the_scene_that_is_named(tmp_path: Path) -> None:
    main = content.load_module("evals", "routing").main
    write_pairs(tmp_path, BASE="1 / 0\n", S01="1 / 2\n")
    with pytest.raises(InputError, match="nowhere does not exist"):
        main([str(tmp_path), "--scene", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")])


def test_perception_of_labelled_and_synthesised_scenes(
    small_scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main = content.load_module("evals", "perception").main
    made = ["--synthesised", "1", "--objects", "2", "--size", "320x240", "--seed", "2"]
    arguments = ["--scenes", str(small_scene), *made, "--repeats", "1", "--out", str(tmp_path), "--json"]
    assert main(arguments) == 0
    figures = json.loads(capsys.readouterr().out)
    rows = {row["scene"]: row for row in figures["rows"]}
    assert set(rows) == {"small", "synth_2000"}
    assert rows["small"]["F1@.5"] == "1.000"
    names = "errors.png figures.json figures.md objects.csv result.json runs scenes scenes.csv scores.png sheet-01.png"
    assert sorted(file.name for file in tmp_path.iterdir()) == [*names.split(), "synthesised"]
    assert len((tmp_path / "objects.csv").read_text().splitlines()) == 1 + 3 + 2
    assert len(list((tmp_path / "synthesised").glob("*/*/truth.json"))) == 1
    assert main(arguments) == 0  # nothing is measured again: even the time it took is the same
    assert json.loads(capsys.readouterr().out) == figures


def test_a_sheet_shows_photo_and_twin_of_each_scene(tmp_path: Path, small_scene: Path) -> None:
    main = content.load_module("evals", "twin").main
    assert main([str(small_scene.parent), "--out", str(tmp_path / "out")]) == 0
    sheet = cv2.imread(str(tmp_path / "out" / "sheet-01.png"))
    assert sheet is not None
    assert sheet.shape == (24 + 360 + 6, 3 * 480, 3)
    photo, twin = sheet[24:-6, :480].astype(int), sheet[24:-6, 480:960].astype(int)
    assert 0 < np.abs(photo - twin).mean() < 80


def test_a_sheet_of_no_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        content.load_module("evals", "twin").main([str(tmp_path / "none"), "--out", str(tmp_path / "out")])


def test_perception_without_a_labelled_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no labelled scene"):
        content.load_module("evals", "perception").main(["--scenes", str(tmp_path), "--out", str(tmp_path / "out")])


@pytest.mark.parametrize(
    "arguments", [["--size", "640"], ["--size", "0x480"], ["--synthesised", "-1"], ["--seed", "x"]]
)
def test_perception_refuses_what_is_no_number(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        content.load_module("evals", "perception").main(arguments)
    assert caught.value.code == 2
    assert arguments[0] in capsys.readouterr().err


@pytest.mark.parametrize("name", CHECKOUT_ONLY)
def test_what_a_wheel_leaves_out_says_so(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "evals").mkdir()
    monkeypatch.setattr(content, "content_root", lambda: tmp_path)
    with pytest.raises(InputError, match=f"{name}.*needs a checkout"):
        load_experiment(name)


def test_an_experiment_of_ones_own_may_have_any_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "evals").mkdir()
    (tmp_path / "evals" / "perception.py").write_text('"""Of my own."""\n')
    monkeypatch.setattr(content, "content_root", lambda: tmp_path)
    assert load_experiment("perception").__doc__ == "Of my own."


def test_rates_of_peers_stand_beside_the_hand_that_is_like_theirs() -> None:
    rates = {"hertz": 25.0, "steps": 2500.0, "resets": 10.0}
    measured = {
        "GRS": rates,
        "GRS with fingers": {**rates, "steps": 1000.0},
        "fetch": {**rates, "steps": 500.0},
        "robosuite_lift": {"hertz": 20.0, "steps": 200.0, "resets": 2.0},
    }
    rows = {row.name: row for row in content.load_module("evals", "peer_speed").figures_of(measured)}
    fingers = rows["GRS over GRS with fingers: steps"]
    assert fingers.value == pytest.approx(2.5) and fingers.is_target_met is False
    lift = rows["GRS with fingers over robosuite_lift: steps"]
    assert lift.value == pytest.approx(4.0) and lift.is_target_met is False
    assert rows["GRS over fetch: steps"].value == pytest.approx(5.0)
    assert rows["GRS with fingers over robosuite_lift: resets"].value == pytest.approx(5.0)
