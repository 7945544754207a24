"""Validation of a run's checkpoints, which may be foreign, before they are read."""

import os
import sqlite3
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, cast, get_type_hints

from pydantic import TypeAdapter, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.graph.state import CHECKPOINTED_TYPES, TYPED_KEYS, RunState, parse_state_value

FILE = "checkpoint.sqlite"
MOST_VALUE = 1 << 21
"""Largest value, bytes: 18 objects and five fixes take 145 KB. SQLite can expand a value to a gigabyte, and a byte
of msgpack can become an object of 90 bytes."""
_PENDING = "SELECT sum(length(value)) FROM writes GROUP BY checkpoint_id"
"""Bytes of the results of each step, which are read together."""
_REMEDY = "start the scene again in another folder: --out"


class RecordSerializer:
    """LangGraph's serializer of states: of the classes of GRS, those of `CHECKPOINTED_TYPES` alone are built.

    LangGraph builds an allowed class without validation if its content is not valid. Here that is an error.
    """

    def __init__(self) -> None:
        from langgraph.checkpoint.serde.jsonplus import JsonPlusSerializer

        self._serializer = JsonPlusSerializer(allowed_msgpack_modules=CHECKPOINTED_TYPES)
        self.dumps_typed = self._serializer.dumps_typed  # as it is, so that its errors are those of the user's graph

    def loads_typed(self, data: tuple[str, bytes]) -> Any:
        """The value of a format and bytes. Raises ValueError: a record in it is not valid."""
        value = self._serializer.loads_typed(data)
        _check_records(value)
        return value


def _check_records(value: Any) -> None:
    """Validate each record in a nesting of containers again. Raises ValueError: it is not valid."""
    if isinstance(value, dict):
        value = list(cast("dict[Any, Any]", value).values())
    if isinstance(value, list | tuple | set | frozenset | deque):
        for item in cast("Iterable[Any]", value):
            _check_records(item)
    elif type(value).__module__ == "langgraph.types":  # Send, Overwrite, Command, Interrupt
        for name in ("arg", "value", "update", "resume"):
            _check_records(getattr(value, name, None))
    elif isinstance(value, Frozen):
        try:
            type(value).model_validate(value.model_dump(warnings="error"))
        except (ValueError, TypeError, AttributeError) as error:
            raise ValueError(f"a {type(value).__name__} with values of other types than a run writes") from error


@cache
def _langgraph_schema() -> frozenset[str]:
    """The statements by which LangGraph makes its tables, with single spaces."""
    from langgraph.checkpoint.sqlite import SqliteSaver

    with closing(sqlite3.connect(":memory:")) as database:
        SqliteSaver(database).setup()
        rows = database.execute("SELECT sql FROM sqlite_schema WHERE sql IS NOT NULL").fetchall()
    return frozenset(" ".join(sql.split()) for (sql,) in rows)


def check_checkpoint_file(folder: Path) -> None:
    """Refuse an incomplete database, any table but LangGraph's, and more pending writes than a run has.

    Generated columns, triggers and views would run SQL of whoever made the file, and SQLite deletes the file that a
    rollback journal names.
    """
    journal = folder / f"{FILE}-journal"
    if os.path.lexists(journal):
        raise InputError(f"{journal} is no file of a run", _REMEDY)
    if not (folder / FILE).exists():  # the run was interrupted before the first step
        return
    file = resolve_member_file(folder, FILE)
    try:
        with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as database:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_VALUE)
            database.execute("PRAGMA trusted_schema = OFF")
            rows = database.execute("SELECT name, sql FROM sqlite_schema").fetchmany(100)
            known = _langgraph_schema()
            unexpected = [name for name, sql in rows if sql is not None and " ".join(sql.split()) not in known]
            if unexpected:
                raise InputError(f"{file} holds no checkpoints of a run: {unexpected[0]!r} is not LangGraph's", _REMEDY)
            check = database.execute("PRAGMA quick_check(1)").fetchone()
            pending = 0
            if any(name == "writes" for name, _ in rows):
                pending = max((size for (size,) in database.execute(_PENDING)), default=0)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise InputError(f"{file} is no whole database: {error}", _REMEDY) from error
    if check != ("ok",):
        raise InputError(f"{file} holds no checkpoints of a run: {check[0]}", _REMEDY)
    if pending > MOST_VALUE:
        raise InputError(f"{file}: a step has {pending} bytes of results; {MOST_VALUE} are allowed", _REMEDY)


def check_restored_state(values: Mapping[str, Any], folder: Path) -> None:
    """Validate a state restored from the checkpoints. Raises InputError: a field has the wrong type."""
    if "candidates" in values:  # the key of the segments before `objects`
        raise InputError(f"{folder / FILE} was written by an earlier version of GRS", _REMEDY)
    hints = get_type_hints(RunState)
    for name, value in values.items():
        try:
            if name in TYPED_KEYS:
                if value != {}:  # no record yet
                    parse_state_value(name, value)
            else:
                TypeAdapter(hints.get(name, Any)).validate_python(value, strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field = ".".join(map(str, (name, *first["loc"])))
            raise InputError(f"{folder / FILE}: {field}: {first['msg']}", _REMEDY) from error
