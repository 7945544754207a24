"""Rows of an experiment outlive it, and are never mixed with those of other options."""

from pathlib import Path

import pytest

from grs_agents.base import Frozen
from grs_agents.base.config.load import load_config
from grs_agents.base.errors import InputError
from grs_agents.runs.experiment_run import open_stored_rows


class Row(Frozen):
    """A row."""

    score: float


def test_an_experiment_finds_its_rows_again_and_others_are_refused(tmp_path: Path) -> None:
    config = load_config(None, ["seed=1"]).config
    kept = open_stored_rows(tmp_path / "out", Row, {"config": config, "fixes": 3})
    assert kept.rows == {}
    kept.keep("one", Row(score=0.5))
    kept.keep("two", Row(score=1))
    again = open_stored_rows(tmp_path / "out", Row, {"config": config, "fixes": 3})
    assert again.rows == {"one": Row(score=0.5), "two": Row(score=1)}
    again.keep("one", Row(score=0))  # it was measured already
    assert open_stored_rows(tmp_path / "out", Row, {"config": config, "fixes": 3}).rows["one"] == Row(score=0.5)
    for other in ({"config": config, "fixes": 4}, {"config": load_config(None, ["seed=2"]).config, "fixes": 3}):
        with pytest.raises(InputError, match="--out"):
            open_stored_rows(tmp_path / "out", Row, other)
