"""Rows of figures as files for analysis: CSV, and Parquet where pyarrow is installed."""

import csv
import importlib
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from grs_agents.base.control_characters import escape_formula
from grs_agents.base.files import write_bytes, write_text


def write_table(stem: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write ``stem.csv``, whose cells join lists of text by ``; `` and start no formula; with pyarrow ``stem.parquet``.

    Args:
        stem: path of the files without their endings.
        columns: names in order.
        rows: JSON values by column.

    Raises:
        InputError: a file cannot be written.
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns)
    writer.writeheader()
    for row in rows:
        cells = {
            name: "; ".join(cast("list[str]", value)) if isinstance(value, list) else value
            for name, value in row.items()
        }
        writer.writerow({name: escape_formula(cell) for name, cell in cells.items()})
    write_text(stem.with_suffix(".csv"), text.getvalue())
    try:
        arrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ImportError:  # of the extra `batch`; the csv file has the same content
        return
    buffer = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist(list(rows)), buffer)
    write_bytes(stem.with_suffix(".parquet"), buffer.getvalue())
