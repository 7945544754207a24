"""``grs runs`` and ``latest``."""

import json
import os
from pathlib import Path
from typing import Literal

import pytest

from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.runs.record import RunRecord
from tests.cli.command import grs

STATUSES: dict[str, Literal["accepted", "rejected", "failed"]] = {
    "first": "accepted",
    "second": "rejected",
    "damaged": "failed",
}


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder with three runs, one of them damaged, and a data set beside them."""
    for age, (name, status) in enumerate(STATUSES.items()):
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        RunRecord(
            id=name,
            status=status,
            command="run",
            source=f"photos/{name}_table",
            graph="grs",
            config=RecordedConfig({}),
            versions={},
            seeds=(0,),
            reason=f"why {name}",
        ).write(folder)
        os.utime(folder / "run.json", (1000 + age, 1000 + age))
    (tmp_path / "runs" / "damaged" / "run.json").write_text("{")
    (tmp_path / "runs" / "first-demos").mkdir()
    return tmp_path


def listed(work: Path, *options: str) -> list[str]:
    """The names of the runs that are listed."""
    done = grs("runs", *options, "--json", folder=work)
    assert done.returncode == 0
    return [row["id"] for row in json.loads(done.stdout)]


def test_runs_are_listed_newest_first(work: Path) -> None:
    assert listed(work) == ["second", "first"]
    assert listed(work, "--status", "accepted") == ["first"]
    assert listed(work, "--of", "second_t") == ["second"]
    shown = grs("runs", folder=work)
    assert shown.stdout.index("why second") < shown.stdout.index("why first")
    assert "damaged" in shown.stderr


def test_runs_are_written_as_a_page(work: Path) -> None:
    done = grs("runs", "--page", "--of", "first_t", "--json", folder=work)
    assert json.loads(done.stdout) == {"file": "runs/runs.html", "runs": 1}
    assert "damaged" in done.stderr
    page = (work / "runs" / "runs.html").read_text()
    assert page.count("<article") == 1 and "first_table" in page and "second_table" not in page
    refused = grs("runs", "--out", "page.png", folder=work)
    assert refused.returncode == 2 and "name a file that ends in .html" in refused.stderr


def test_latest_is_the_run_that_was_written_last(work: Path) -> None:
    for name, age in {"first": 9001, "second": 9000}.items():
        os.utime(work / "runs" / name / "run.json", (age, age))
    (work / "runs" / "damaged" / "run.json").unlink()
    assert "the run runs/first is accepted and waits for no reply" in grs("approve", "latest", folder=work).stderr


def test_where_there_are_none_the_remedy_is_told(tmp_path: Path) -> None:
    assert "there is no run below runs; make one with `grs run`" in grs("show", "latest", folder=tmp_path).stderr
    assert "runs is no folder; name the folder that holds run folders" in grs("runs", folder=tmp_path).stderr


def test_help_and_version_have_short_forms(tmp_path: Path) -> None:
    assert "List runs, the newest first." in grs("runs", "-h", folder=tmp_path).stdout
    assert grs("-V", folder=tmp_path).stdout == grs("--version", folder=tmp_path).stdout


def test_two_runs_are_compared(work: Path) -> None:
    (work / "runs" / "first" / "simulation.py").write_text("a = 1\nb = 2\n")
    (work / "runs" / "second" / "simulation.py").write_text("a = 1\nb = 3\n")
    done = grs("compare", "runs/first", "runs/second", "--json", folder=work)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["differences"] == {
        "status": ["accepted", "rejected"],
        "source": ["photos/first_table", "photos/second_table"],
        "reason": ["why first", "why second"],
        "simulation.py": [None, "2 lines differ"],
    }
    same = grs("compare", "runs/first", "runs/first", folder=work)
    assert same.stdout.strip() == "nothing differs"
    assert "why second" in grs("compare", "runs/first", "runs/second", folder=work).stdout
