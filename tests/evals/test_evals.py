"""Every experiment can be asked what it does; the two of many runs make their figures."""

import json
from pathlib import Path

import pytest

from grs_agents import content
from grs_agents.errors import InputError


@pytest.mark.parametrize("name", content.names("evals"))
def test_every_experiment_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    module = content.load_module("evals", name)
    assert module.__doc__
    with pytest.raises(SystemExit) as caught:
        module.main(["--help"])
    assert caught.value.code == 0
    assert name in capsys.readouterr().out


def test_seeds_of_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = content.load_module("evals", "seeds").main(["--seeds", "2", "--out", str(tmp_path / "out"), "--json"])
    figures = json.loads(capsys.readouterr().out)
    assert (status, figures["summary"]["verdicts"]) == (0, 2)
    assert json.loads((tmp_path / "out" / "figures.json").read_text()) == figures
    assert "seed 1" in (tmp_path / "out" / "figures.md").read_text()


def test_runs_of_two_experiments_are_not_mixed(tmp_path: Path) -> None:
    main = content.load_module("evals", "real").main
    scene = tmp_path / "scenes" / "bad"
    scene.mkdir(parents=True)
    (scene / "camera.json").write_text("{}")
    arguments = [str(tmp_path / "scenes"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 1
    assert main(arguments) == 1  # the same experiment goes on
    with pytest.raises(InputError, match="other config"):
        main([*arguments, "--set", "policy=rules"])
    (tmp_path / "out" / "experiment.json").write_text("[")
    with pytest.raises(InputError, match=r"experiment\.json"):
        main(arguments)


def test_no_seeds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as caught:
        content.load_module("evals", "seeds").main(["--seeds", "0", "--out", str(tmp_path / "out")])
    assert caught.value.code == 2


def test_a_folder_without_scenes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no scene"):
        content.load_module("evals", "real").main([str(tmp_path)])
