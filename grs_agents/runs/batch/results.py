"""The files that a batch leaves: ``results.json`` to read again, ``.csv`` and ``.parquet`` to work with."""

import csv
import importlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes, write_json, write_text
from grs_agents.base.foreign.files import read_bytes
from grs_agents.runs.batch.row import BatchRow

RESULTS: Final = "results.json"
_REMEDY: Final = "name a folder that `grs batch` wrote"
_COLUMNS: Final = tuple(BatchRow.model_fields)
_MOST_BYTES: Final = 1 << 28
"""Of ``results.json``: a quarter of a million runs."""


class BatchResults(Frozen):
    """All rows of a batch with what they come to."""

    summary: dict[str, Any]
    rows: tuple[BatchRow, ...]


def write_results(out: Path, results: BatchResults) -> None:
    """Write ``results.json``, ``results.csv`` and, where pyarrow is installed, ``results.parquet``, each whole."""
    write_json(out / RESULTS, results.model_dump(mode="json"), durable=True)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, _COLUMNS)
    writer.writeheader()
    writer.writerows({**row.model_dump(), "goals": "; ".join(row.goals)} for row in results.rows)
    write_text(out / "results.csv", text.getvalue())
    _write_parquet(out / "results.parquet", results.rows)


def _write_parquet(file: Path, rows: Sequence[BatchRow]) -> None:
    try:
        arrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ImportError:  # the extra `batch` has it; the csv says the same
        return
    buffer = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist([row.model_dump(mode="json") for row in rows]), buffer)
    write_bytes(file, buffer.getvalue())


def read_results(out: Path) -> BatchResults:
    """What an earlier batch left in ``out``. Raises InputError: there is none, or it is damaged."""
    file = out / RESULTS
    if not file.is_file():
        raise InputError(f"{out} holds no batch: there is no {RESULTS} in it", _REMEDY)
    try:
        return TypeAdapter(BatchResults).validate_json(read_bytes(file, _REMEDY, _MOST_BYTES))
    except ValidationError as error:
        raise InputError(f"{file} is not what a batch wrote: {error.errors()[0]['msg']}", _REMEDY) from error
