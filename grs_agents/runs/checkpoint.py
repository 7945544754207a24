"""The checkpoints of a run, which may come from somebody else: looked at before anything is read from them."""

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.graph.state import RunState
from grs_agents.perception.types import Camera, CandidateRecord, SceneDescription, SceneObject, TableFrame

FILE = "checkpoint.sqlite"
MOST_VALUE = 1 << 22
"""Bytes of one value: 18 objects and five fixes take 145 KB. SQLite makes up values of a gigabyte otherwise, and a
byte of msgpack may become an object of 90."""
_TABLES = frozenset({"checkpoints", "writes"})
_REMEDY = "start the scene again in another folder: --out"
_NESTED: dict[str, TypeAdapter[Any]] = {
    "camera": TypeAdapter(Camera),
    "table": TypeAdapter(TableFrame),
    "candidates": TypeAdapter(list[CandidateRecord]),
    "objects": TypeAdapter(list[SceneObject]),
    "scene": TypeAdapter(SceneDescription),
}


def check_checkpoint_file(folder: Path) -> None:
    """Refuse checkpoints that are no whole database with LangGraph's tables and nothing that runs by itself."""
    if not (folder / FILE).exists():  # interrupted before the first step
        return
    file = resolve_member_file(folder, FILE)
    try:
        with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as database:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_VALUE)
            database.execute("PRAGMA trusted_schema = OFF")
            rows = database.execute("SELECT type, name FROM sqlite_schema").fetchmany(100)
            check = database.execute("PRAGMA quick_check(1)").fetchone()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise InputError(f"{file} is no whole database: {error}", _REMEDY) from error
    unexpected = [
        name for kind, name in rows if kind not in ("table", "index") or (kind == "table" and name not in _TABLES)
    ]
    if unexpected or check != ("ok",):
        problem = f"it holds {unexpected[0]!r}" if unexpected else str(check[0])
        raise InputError(f"{file} holds no checkpoints of a run: {problem}", _REMEDY)


def check_restored_state(values: Mapping[str, Any], folder: Path) -> None:
    """See that a state that was read from the checkpoints is one that the nodes can go on with."""
    hints = get_type_hints(RunState)
    for name, value in values.items():
        try:
            TypeAdapter(hints.get(name, Any)).validate_python(value, strict=True)
            if name in _NESTED and value:
                _NESTED[name].validate_python(value)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, (name, *first["loc"])))
            raise InputError(f"{folder / FILE}: {where}: {first['msg']}", _REMEDY) from error
