"""Run folders are never mixed up and never half-made."""

from pathlib import Path

import pytest

from grs_agents.base.config.schema import Config
from grs_agents.base.errors import InputError
from grs_agents.runs.record import RunRecord, read_record
from grs_agents.runs.run_opening import make_run_folder, open_resumed_folder


def record(source: str, status: str = "running") -> RunRecord:
    return RunRecord.model_validate(
        {
            "id": "r",
            "status": status,
            "command": "run",
            "source": source,
            "graph": "grs",
            "config": Config().model_dump(mode="json"),
            "versions": {},
            "seeds": (0,),
        }
    )


def test_two_runs_of_one_second_get_two_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folders = {make_run_folder("my scene", 3, None) for _ in range(3)}
    assert len(folders) == 3
    assert all("my-scene-3" in folder.name for folder in folders)


def test_an_existing_run_is_not_overwritten(tmp_path: Path) -> None:
    out = make_run_folder("s", 0, tmp_path / "run")
    record("s").write(out)
    with pytest.raises(InputError, match="--resume"):
        make_run_folder("s", 0, out)


def test_a_folder_of_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="not empty"):
        make_run_folder("s", 0, tmp_path)


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        make_run_folder("s", 0, tmp_path / "file" / "run")


def test_resume_wants_a_run_of_the_same_scene(tmp_path: Path) -> None:
    out = make_run_folder("s", 0, tmp_path / "run")
    record(str(tmp_path / "scene")).write(out)
    assert open_resumed_folder(out, tmp_path / "scene", "run")[1].id == "r"
    with pytest.raises(InputError, match="is a run of"):
        open_resumed_folder(out, tmp_path / "other", "run")
    with pytest.raises(InputError, match="--out"):
        open_resumed_folder(None, tmp_path / "scene", "run")
    with pytest.raises(InputError, match="grs run"):
        open_resumed_folder(out, tmp_path / "scene", "scene")


@pytest.mark.parametrize("text", ["", "{}", "not json"])
def test_a_damaged_record_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError, match="run record"):
        read_record(tmp_path)


def test_no_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no run"):
        read_record(tmp_path)
