"""A checkpoint may come from somebody else: only records are built from it, and only valid records."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import ormsgpack
import pytest
from langgraph.checkpoint.sqlite import SqliteSaver

from grs_agents.base.errors import InputError
from grs_agents.graph.state import parse_state
from grs_agents.runs.checkpoint import (
    FILE,
    MOST_VALUE,
    RecordSerializer,
    check_checkpoint_file,
    check_restored_state,
)
from grs_agents.sandbox.protocol.report import TestCase, TestReport

STATE, AGENTS, REPORT = "grs_agents.graph.state", "grs_agents.agents.types", "grs_agents.sandbox.protocol.report"
PERCEPTION = "grs_agents.perception.types"
TASK = {"task-name": "t", "task-description": "d", "assets-used": ["a"]}
CAMERA = {"fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480, "depth_scale": 0.001}
LEVEL = ((0.0, -1.0, 0.0, 0.5), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 1.0), (0.0, 0.0, 0.0, 1.0))
TABLE = {"T_robot_cam": LEVEL, "origin": "table_plane", "residual": 0.001, "inliers": 0.7}
SEGMENT = {
    "id": 1,
    "mask": "scene/mask_01.png",
    "crop": "scene/crop_01.png",
    "box": {"low": (0.4, -0.1, 0.0), "high": (0.5, 0.1, 0.1)},
    "upright": {"center": (0.45, 0.0, 0.05), "size": (0.1, 0.2, 0.1), "yaw": 0.0},
    "color": (0.5, 0.5, 0.5),
    "shape": "box",
    "points": 900,
}
WORDS = {"is_object": True, "description": "a box", "color": "grey", "shape": "box", "category": "box"}
ARGUMENT, ARGUMENTS, KEYWORDS, METHOD, V1, V2 = range(6)
"""Codes of the serializer's extensions."""


def packed(code: int, *parts: Any) -> ormsgpack.Ext:
    return ormsgpack.Ext(code, ormsgpack.packb(parts))


def restored(state: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The state that a run goes on with. Raises ValueError or InputError: it is refused."""
    values = RecordSerializer().loads_typed(("msgpack", ormsgpack.packb(state)))
    check_restored_state(values, folder)
    return values


def test_records_come_back_as_they_were() -> None:
    case = TestCase(id="T.a", outcome="failed", episode={"score": float("inf"), "deep": [{"a": [1]}]})
    report = TestReport(outcome="failed", cases=(case,))
    state = dict(parse_state({"task": TASK, "history": [], "audit": None})) | {"report": report, "fixes": 1}
    photo = {"camera": CAMERA, "table": TABLE, "objects": [{**SEGMENT, "description": WORDS}]}
    state |= parse_state({**photo, "dropped": [{"id": 0, "reason": "the robot"}]})
    serializer = RecordSerializer()
    assert serializer.loads_typed(serializer.dumps_typed(state)) == state


@pytest.mark.filterwarnings("ignore:The `construct` method:DeprecationWarning")
@pytest.mark.parametrize(
    "state",
    [
        {"report": packed(V2, REPORT, "TestReport", {"outcome": "splendid"}, "")},
        {"report": packed(V2, REPORT, "TestReport", {"outcome": "passed", "cases": [{"id": 7}]}, "")},
        {"report": packed(V2, REPORT, "TestReport", {"outcome": "passed", "more": 1, "cases": [{"id": "a"}]}, "")},
        {"report": packed(V1, REPORT, "TestReport", {"outcome": 7}, "")},
        {"report": packed(V2, AGENTS, "TaskDefinition", TASK, "")},
        {"history": [packed(V2, STATE, "FixRecord", {"fixed": "task"}, "")]},
        {"history": packed(ARGUMENT, "collections", "deque", [packed(V2, STATE, "FixRecord", {"fixed": "task"}, "")])},
        {
            "problem": packed(
                ARGUMENTS, "langgraph.types", "Send", ["a", packed(V2, STATE, "FixRecord", {"fixed": "task"}, "")]
            )
        },
        {"task": packed(V2, AGENTS, "TaskDefinition", {"name": 7, "_fields_set": 3}, "")},
        {"report": packed(KEYWORDS, REPORT, "TestReport", {"outcome": "splendid"})},
        {"audit": {"accepted": True}},
        {"best": {"score": {}, "kept": {"task": {}}}},
        {"history": [{"fixed": "task"}]},
        {"fixes": "1"},
        {"candidates": []},
        {"camera": packed(V2, PERCEPTION, "Camera", {**CAMERA, "fx": -1.0}, "")},
        {"camera": {**CAMERA, "T_robot_cam": [[1.0]]}},
        {"camera": packed(V2, PERCEPTION, "TableFrame", TABLE, "")},
        {"table": packed(V2, PERCEPTION, "TableFrame", {**TABLE, "origin": "the moon"}, "")},
        {"table": {**TABLE, "residual": "small"}},
        {"objects": [packed(V2, STATE, "TableObject", {**SEGMENT, "mask": "../../mask.png"}, "")]},
        {"objects": [packed(V2, STATE, "TableObject", {**SEGMENT, "crop": "/etc/passwd"}, "")]},
        {"objects": [packed(V2, STATE, "TableObject", {**SEGMENT, "placed": {"id": 1}}, "")]},
        {"objects": [packed(V2, PERCEPTION, "DroppedCandidate", {"id": 1, "reason": "a shadow"}, "")]},
        {"objects": [{**SEGMENT, "mask": "../../mask.png"}]},
        {"objects": packed(V2, STATE, "TableObject", SEGMENT, "")},
        {"dropped": [packed(V2, PERCEPTION, "DroppedCandidate", {"id": "x", "reason": "a shadow"}, "")]},
        {"dropped": [{"id": 1}]},
    ],
)
def test_forged_content_is_refused(state: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises((ValueError, InputError)) as refused:
        restored(state, tmp_path)
    assert "\n" not in str(refused.value)


def test_only_records_are_built(tmp_path: Path) -> None:
    mark = tmp_path / "owned"
    for module, name, content in (
        ("subprocess", "getoutput", f"touch {mark}"),
        (REPORT, "CallResult", {"outcome": "ok"}),
        (AGENTS, "TaskRevision", {**TASK, "given-up": "all"}),
        (PERCEPTION, "CandidateRecord", SEGMENT),
        (AGENTS, "Description", WORDS),
        (PERCEPTION, "SceneObject", {"id": 1}),
    ):
        for code in range(6):
            values = RecordSerializer().loads_typed(
                ("msgpack", ormsgpack.packb({"x": packed(code, module, name, content, "")}))
            )
            assert isinstance(values["x"], str | dict)
    assert (
        RecordSerializer().loads_typed(
            ("msgpack", ormsgpack.packb(packed(METHOD, AGENTS, "TaskDefinition", TASK, "model_validate")))
        )
        == TASK
    )
    assert not mark.exists()


@pytest.fixture
def database(tmp_path: Path) -> Iterator[sqlite3.Connection]:
    """A database as LangGraph makes it, without rows."""
    with closing(sqlite3.connect(tmp_path / FILE)) as connection:
        SqliteSaver(connection).setup()
        connection.commit()
        yield connection


GENERATED = (
    "ALTER TABLE writes ADD COLUMN more TEXT GENERATED ALWAYS AS (replace(printf('%.*c', 9, 'a'), 'a', 'bb')) VIRTUAL"
)


@pytest.mark.parametrize(
    ("statement", "told"),
    [
        (GENERATED, "'writes' is not LangGraph's"),
        ("CREATE TABLE more (a)", "'more' is not LangGraph's"),
        ("CREATE VIEW more AS SELECT 1", "'more' is not LangGraph's"),
        ("CREATE INDEX more ON writes (length(value))", "'more' is not LangGraph's"),
    ],
)
def test_a_database_with_sql_of_another_is_refused(
    database: sqlite3.Connection, tmp_path: Path, statement: str, told: str
) -> None:
    check_checkpoint_file(tmp_path)
    database.execute(statement)
    database.commit()
    with pytest.raises(InputError, match=told):
        check_checkpoint_file(tmp_path)


def test_the_results_of_a_step_are_bounded_together(database: sqlite3.Connection, tmp_path: Path) -> None:
    for number in range(5):
        row = ("t", "", "c", f"task {number}", number, "channel", "msgpack", bytes(MOST_VALUE // 4))
        names = "thread_id, checkpoint_ns, checkpoint_id, task_id, idx, channel, type, value"
        database.execute(f"INSERT INTO writes ({names}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)
    database.commit()
    with pytest.raises(InputError, match="bytes of results"):
        check_checkpoint_file(tmp_path)


def test_a_rollback_journal_is_refused_before_the_database_is_opened(
    database: sqlite3.Connection, tmp_path: Path
) -> None:
    (tmp_path / f"{FILE}-journal").write_bytes(b"")
    with pytest.raises(InputError, match="journal"):
        check_checkpoint_file(tmp_path)
