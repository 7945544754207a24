"""The ablation: every program a run ends with has a reward, and the table says what it should."""

import json
from pathlib import Path

import pytest

from evals.benchmark.ablation_runs import Measured, tell_figures
from grs_agents.base.errors import InputError
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import load_experiment


def measured(graph: str, seed: int, published: float | None, status: str = "accepted") -> Measured:
    """A run that earned this."""
    return Measured(
        graph=graph,
        scene="s",
        seed=seed,
        status=status,
        task="t",
        published=published,
        strict=published,
        code_fixes=seed,
        test_fixes=0,
        task_fixes=0,
        hangs=0,
        tokens=100,
        cost=0.5,
        seconds=2.0,
    )


def test_runtime_errors_are_left_out_and_counted_as_zero(tmp_path: Path) -> None:
    good = [measured("grs", seed, 1.0) for seed in range(8)]
    bad = [measured("no_fix", seed, 0.5 if seed < 4 else None, "rejected") for seed in range(8)]
    tell_figures([*good, *bad], ExperimentParser("ablation", "").start(["--out", str(tmp_path)]))
    figures = json.loads((tmp_path / "result.json").read_text())
    grs, no_fix = figures["table"]
    assert (grs["reward"], grs["accepted"], grs["code fixes"]) == ("1.000 (1.000, 1.000)", "100%", 3.5)
    assert (no_fix["reward"], no_fix["runtime errors"]) == ("0.500 (0.500, 0.500)", 4)
    mean, low, high = (float(part.strip("(,)")) for part in no_fix["errors as 0"].split())
    assert low < mean == 0.25 < high
    assert {test["test"] for test in figures["tests"]} == {"Kruskal-Wallis", "Mann-Whitney, Holm"}
    assert all(float(test["p"]) < 0.01 for test in figures["tests"])
    assert "| no_fix | 8 |" in (tmp_path / "table2.md").read_text()


def test_a_program_that_no_audit_saw_has_the_same_reward(
    small_scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main = load_experiment("ablation").main
    arguments = [str(small_scene), "--runs", "1", "--graphs", "no_fix", "--out", str(tmp_path / "out"), "--json"]
    assert main(arguments) == 0
    figures = json.loads(capsys.readouterr().out)
    (run,) = figures["runs"]
    assert run["status"] == "accepted" and run["published"] > 0.99
    (tmp_path / "out" / "no_fix-small-0" / "audit.json").unlink()  # as where the tests of a run fail to its end
    assert main(arguments) == 0  # the row is kept
    assert json.loads(capsys.readouterr().out) == figures
    (tmp_path / "out" / "rows.json").unlink()  # as where the experiment was killed between the run's end and its row
    assert main(arguments) == 0  # the run is not made again, its program is rolled out
    assert json.loads(capsys.readouterr().out) == figures
    assert (tmp_path / "out" / "no_fix-small-0.check.json").is_file()


def test_a_graph_that_is_not_there_is_refused(small_scene: Path) -> None:
    with pytest.raises(InputError, match="no_rooter"):
        load_experiment("ablation").main([str(small_scene), "--graphs", "no_rooter"])
