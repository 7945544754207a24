"""Files of a batch: ``results.json`` to read again, ``.csv`` and ``.parquet`` for analysis, and the page
``index.html``."""

import csv
import html
import importlib
import io
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from pydantic import TypeAdapter, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.control_characters import escape_control_chars, escape_formula
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes, write_json, write_text
from grs_agents.base.foreign.files import MOST_VALUES_OF_DATA, check_json_limits, read_bytes
from grs_agents.runs.batch.row import BatchRow

RESULTS: Final = "results.json"
_REMEDY: Final = "name a folder that `grs batch` wrote"
_COLUMNS: Final = tuple(BatchRow.model_fields)
_MOST_BYTES: Final = 1 << 28
"""Largest ``results.json``: a quarter of a million runs."""
_PHOTO: Final = "scene/rgb.png"
_REPORT: Final = "report.html"
_POLICY: Final = "default-src 'none'; img-src 'self' file:; style-src 'unsafe-inline'"
_STYLE: Final = """
:root{color-scheme:light dark;--line:#8884;--good:#1a7f37;--bad:#cf222e}
body{font:15px/1.45 system-ui,sans-serif;margin:1.5rem auto;max-width:90rem;padding:0 1rem}
.runs{display:grid;grid-template-columns:repeat(auto-fill,minmax(17rem,1fr));gap:1rem}
article{border:1px solid var(--line);border-radius:8px;overflow:hidden;break-inside:avoid}
article>div{padding:.5rem .8rem;overflow-wrap:anywhere}img{width:100%;aspect-ratio:4/3;object-fit:cover;display:block}
h1{font-size:1.4rem}h2{font-size:1rem;margin:0}p{margin:.25rem 0}.quiet{opacity:.75;font-size:.85rem}
.accepted{color:var(--good)}.rejected,.failed,.killed{color:var(--bad)}
"""


class BatchResults(Frozen):
    """All rows of a batch with their summary."""

    summary: dict[str, Any]
    rows: tuple[BatchRow, ...]


def write_results(out: Path, results: BatchResults) -> None:
    """Write ``results.json``, ``results.csv``, with pyarrow ``results.parquet``, and ``index.html``, each
    atomically."""
    write_json(out / RESULTS, results.model_dump(mode="json"), durable=True)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, _COLUMNS)
    writer.writeheader()
    for row in results.rows:
        cells = {**row.model_dump(), "goals": "; ".join(row.goals)}
        writer.writerow({column: escape_formula(cell) for column, cell in cells.items()})
    write_text(out / "results.csv", text.getvalue())
    write_text(out / "index.html", render_page(out, results))
    try:
        arrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ImportError:  # of the extra `batch`; the csv file has the same content
        return
    buffer = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist([row.model_dump(mode="json") for row in results.rows]), buffer)
    write_bytes(out / "results.parquet", buffer.getvalue())


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
    """The page of the batch in ``out``, without scripts; photos and reports are relative links."""
    total = results.summary
    families = ", ".join(f"{name or 'none'} {count}" for name, count in total["families"].items())
    head = (
        f"<p>{total['accepted']} of {total['runs']} accepted, {total['different_tasks']} different tasks "
        f"({_to_html(families)}), {total['seconds']:.0f} s, ${total['cost']:.2f}</p>"
    )
    runs = "".join(_render_run(out, row) for row in results.rows)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Batch</title>'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}"><style>{_STYLE}</style></head>'
        f'<body><h1>{_to_html(out.resolve().name)}</h1>{head}<div class="runs">{runs}</div></body></html>\n'
    )


def _render_run(out: Path, row: BatchRow) -> str:
    photo, report, folder = (_to_html(quote(f"{row.run}/{file}")) for file in (_PHOTO, _REPORT, ""))
    image = f'<img loading="lazy" alt="" src="{photo}">' if (out / row.run / _PHOTO).is_file() else ""
    report_link = f'<a href="{report}">report</a>' if (out / row.run / _REPORT).is_file() else ""
    repeats = f"<p>the same task as {_to_html(row.repeats)}</p>" if row.repeats else ""
    reward = "" if row.reward is None else f"reward {row.reward:.2f}, "
    fixes = row.code_fixes + row.test_fixes + row.task_fixes
    return (
        f'<article id="{_to_html(row.run)}">{image}<div><h2>{_to_html(row.run)} '
        f'<span class="{_to_html(row.status)}">{_to_html(row.status)}</span></h2><p>{_to_html(row.description)}</p>'
        f'{repeats}<p class="quiet">{_to_html(row.reason)}</p><p class="quiet">{reward}{fixes} fixes, '
        f"{row.model_calls} model calls, {row.input_tokens + row.output_tokens} tokens, ${row.cost:.2f}, "
        f'{row.seconds:.1f} s</p><p>{report_link} <a href="{folder}">files</a></p></div></article>'
    )


def _to_html(text: str) -> str:
    return html.escape(escape_control_chars(text))
