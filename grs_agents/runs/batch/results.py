"""Files of a batch: ``results.json`` to read again, ``.csv`` and ``.parquet`` for analysis, and the page
``index.html``."""

from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from pydantic import TypeAdapter, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json, write_text
from grs_agents.base.foreign.files import MOST_VALUES_OF_DATA, check_json_limits, read_bytes
from grs_agents.base.tables import write_table
from grs_agents.base.templates import load_template
from grs_agents.runs.batch.row import BatchRow

RESULTS: Final = "results.json"
_REMEDY: Final = "name a folder that `grs batch` wrote"
_MOST_BYTES: Final = 1 << 28
"""Largest ``results.json``: a quarter of a million runs."""


class BatchResults(Frozen):
    """All rows of a batch with their summary."""

    summary: dict[str, Any]
    rows: tuple[BatchRow, ...]


def write_results(out: Path, results: BatchResults) -> None:
    """Write ``results.json``, ``results.csv``, with pyarrow ``results.parquet``, and ``index.html``, each
    atomically."""
    write_json(out / RESULTS, results.model_dump(mode="json"), durable=True)
    write_table(out / "results", tuple(BatchRow.model_fields), [row.model_dump(mode="json") for row in results.rows])
    write_text(out / "index.html", render_page(out, results))


def read_results(out: Path) -> BatchResults:
    """Read the results of an earlier batch; the summary may be anything (`summarize_rows`).
    Raises InputError: there are none, or they are damaged."""
    file = out / RESULTS
    if not file.is_file():
        raise InputError(f"{out} holds no batch: there is no {RESULTS} in it", _REMEDY)
    data = read_bytes(file, _REMEDY, _MOST_BYTES)
    check_json_limits(data, file, MOST_VALUES_OF_DATA)
    try:
        return TypeAdapter(BatchResults).validate_json(data)
    except ValidationError as error:
        raise InputError(f"{file} is not what a batch wrote: {error.errors()[0]['msg']}", _REMEDY) from error


def render_page(out: Path, results: BatchResults) -> str:
    """The page of the batch in ``out``."""

    def has_file(row: BatchRow, name: str) -> bool:
        return (out / row.run / name).is_file()

    return load_template(Path(__file__).with_name("page.html")).render(
        name=out.resolve().name,
        total=results.summary,
        rows=results.rows,
        has_file=has_file,
        quote=quote,
        PHOTO="scene/rgb.png",
        REPORT="report.html",
    )
