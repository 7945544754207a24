"""What experiments share: kept rows, configuration, results with how they came about."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from grs_agents.base import Frozen, content
from grs_agents.base.errors import InputError
from grs_agents.runs.experiment_run import Experiment, ExperimentParser
from grs_agents.runs.metrics import Figure


class Row(Frozen):
    """A row of the experiment below."""

    value: int
    error: str = ""


def start(out: Path, *arguments: str) -> Experiment:
    """An experiment of the tests' own."""
    parser = ExperimentParser("squares", "Squares of numbers.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--numbers", type=int, default=3)
    return parser.start(["--out", str(out), *arguments], lambda options: (f"max_fixes={options.numbers}", "seed=9"))


@pytest.mark.parametrize("workers", [1, 3])
def test_an_interrupted_experiment_goes_on_where_it_was(tmp_path: Path, workers: int) -> None:
    made: list[int] = []

    def square(number: int) -> Row:
        made.append(number)
        if number == 1 and len(made) < 3:
            raise KeyboardInterrupt
        return Row(value=number * number, error="odd one" if number == 2 else "")

    work: dict[str, Callable[[], Row]] = {str(number): partial(square, number) for number in range(3)}
    with pytest.raises(KeyboardInterrupt):
        start(tmp_path).make_or_reuse_rows(Row, {name: work[name] for name in ("0", "1")}, workers=1)
    for _ in range(2):
        rows = start(tmp_path).make_or_reuse_rows(Row, work, workers=workers, show=str)
        assert [row.value for row in rows] == [0, 1, 4]
    assert sorted(made) == [0, 1, 1, 2, 2]  # the row with an error is tried again, the others stay


def test_rows_of_other_options_are_refused_unless_those_only_choose(tmp_path: Path) -> None:
    work: dict[str, Callable[[], Row]] = {"one": lambda: Row(value=1)}
    start(tmp_path, "--seed", "1").make_or_reuse_rows(Row, work)
    start(tmp_path, "--seed", "1", "--json").make_or_reuse_rows(Row, work)
    for other in (("--seed", "2"), ("--seed", "1", "--set", "policy=rules"), ("--seed", "1", "--numbers", "4")):
        with pytest.raises(InputError, match="other options"):
            start(tmp_path, *other).make_or_reuse_rows(Row, work)
    chosen = tmp_path / "chosen"
    for seed in ("1", "2"):
        start(chosen, "--seed", seed).make_or_reuse_rows(Row, work, choosing=("seed",))


def test_rows_of_other_code_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(content, "_overlays", [])
    (tmp_path / "own/tools").mkdir(parents=True)
    tool = tmp_path / "own/tools/halve.py"
    tool.write_text("SHARE = 2\n")
    content.add_overlay_folder(tmp_path / "own")
    work: dict[str, Callable[[], Row]] = {"one": lambda: Row(value=1)}
    for _ in range(2):
        start(tmp_path / "out").make_or_reuse_rows(Row, work)
    tool.write_text("SHARE = 3\n")
    with pytest.raises(InputError, match="other code"):
        start(tmp_path / "out").make_or_reuse_rows(Row, work)


def test_the_configuration_reaches_processes_of_their_own(tmp_path: Path) -> None:
    file = tmp_path / "models.toml"
    file.write_text('max_fixes = 7\npolicy = "rules"\n[models.default]\nmodel = "offline:faulty"\n')
    experiment = start(tmp_path, "--config", str(file), "--set", "limits.cpu_seconds=5")
    assert (experiment.config.max_fixes, experiment.config.seed, experiment.config.policy) == (3, 9, "rules")
    again = start(tmp_path / "again", *(part for one in experiment.settings for part in ("--set", one)))
    assert again.config == experiment.config


def test_results_say_how_they_came_about(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures = [Figure(name="time", value=2.5, target=1, unit="s"), Figure(name="rate", value=None)]
    assert start(tmp_path, "--seed", "3").tell_figures("squares", figures, more=1) == 1
    assert "missed" in capsys.readouterr().out
    assert start(tmp_path, "--seed", "3", "--json").tell_figures("squares", figures[1:], more=1) == 0
    assert json.loads(capsys.readouterr().out)["table"] == []
    assert start(tmp_path, "--seed", "3").tell_figures("squares", figures, more=1) == 1
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["table"] == [{"figure": "time", "measured": "2.5 s", "target": "<= 1 s"}]
    assert (result["experiment"], result["more"], result["seeds"]) == ("squares", 1, {"seed": 3})
    assert result["arguments"][-2:] == ["--seed", "3"] and result["date"] and result["grs-agents"]
