"""What ``run.json`` counts comes from the events and the final state."""

from pathlib import Path

import pytest

from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import NodeEnded, Reply
from grs_agents.runs.record import RunRecord, count_run_results, installed_versions, read_record, seconds_by_stage

EVENTS = [
    NodeEnded(node="run_tests", seconds=1.0),
    NodeEnded(node="fix_code", seconds=0.25),
    NodeEnded(node="run_tests", seconds=0.5),
    Reply(call="1", role="tests", model="offline", text="x", input_tokens=7, output_tokens=3),
]


def record() -> RunRecord:
    return RunRecord(
        id="r",
        status="running",
        command="run",
        source="s",
        graph="grs",
        config=RecordedConfig.of(Config()),
        versions=installed_versions(),
        seeds=(0, 1, 2),
    )


def test_seconds_are_summed_over_visits() -> None:
    assert seconds_by_stage(EVENTS) == {"run_tests": 1.5, "fix_code": 0.25, "total": 1.75}


def test_counts() -> None:
    state = {
        "objects": [{}, {}, {}],
        "scene": {"objects": [{"matched": True, "reachable": True}, {"matched": False, "reachable": True}]},
        "task": {"assets-used": ["a"]},
        "audit": {"rollouts": [{"moved": ["a", "b"]}, {"moved": ["a"]}]},
    }
    found = count_run_results(EVENTS, state)
    assert (found["candidates"], found["objects"], found["objects_matched"]) == (3, 2, 1)
    assert (found["code_fixes"], found["test_fixes"], found["model_calls"]) == (1, 0, 1)
    assert (found["input_tokens"], found["objects_moved"]) == (7, 1)


def test_a_run_that_saw_nothing_counts_nothing() -> None:
    assert set(count_run_results([], {}).values()) == {0}


def test_a_record_reads_back(tmp_path: Path) -> None:
    written = record().write(tmp_path)
    assert read_record(tmp_path) == written
    assert written.versions["mujoco"] != "not installed"


def test_a_full_disk_does_not_leave_it_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record().write(tmp_path)

    def full(*_: object, **named: object) -> None:
        raise InputError("disk is full")

    monkeypatch.setattr("grs_agents.runs.record.write_json", full)
    record().model_copy(update={"status": "failed"}).write(tmp_path)
    assert read_record(tmp_path).status == "failed"
