"""Rows of an experiment, kept in a file as they are made: an interrupted experiment goes on where it stopped."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from pydantic import BaseModel

from grs_agents.base.content import hash_code
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import read_json

_REMEDY: Final = "name another --out"
_Row = TypeVar("_Row", bound=BaseModel)


class StoredRows(Generic[_Row]):
    """The rows in ``rows.json`` of a folder, by name."""

    def __init__(self, file: Path, of: str, rows: dict[str, _Row]) -> None:
        self.file, self.of, self.rows = file, of, rows

    def keep(self, name: str, row: _Row) -> None:
        """Write the rows with this one; one that is kept already stays."""
        if name not in self.rows:
            self.rows[name] = row
            rows = {name: row.model_dump(mode="json") for name, row in self.rows.items()}
            write_json(self.file, {"of": self.of, "rows": rows}, durable=True)


def open_stored_rows(folder: Path, kind: type[_Row], of: Mapping[str, Any]) -> StoredRows[_Row]:
    """The rows that an earlier, interrupted experiment left in ``folder``.

    Args:
        folder: where the experiment writes to; it need not be there.
        kind: the type of a row.
        of: what the rows depend on: configuration and options.

    Raises:
        InputError: the rows there are of other code, another configuration or other options.
    """
    parts = {
        key: part.model_dump(mode="json") if isinstance(part, BaseModel) else str(part) for key, part in of.items()
    }
    digest = hashlib.sha256(json.dumps([hash_code(), parts], sort_keys=True).encode()).hexdigest()
    file = folder / "rows.json"
    if not file.is_file():
        return StoredRows(file, digest, {})
    found = read_json(file, _REMEDY)
    if found.get("of") != digest:
        raise InputError(f"{file} holds rows of other code, another configuration or other options", _REMEDY)
    return StoredRows(file, digest, {name: kind.model_validate(row) for name, row in found["rows"].items()})
