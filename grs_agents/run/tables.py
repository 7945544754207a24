"""Figures of many runs as rows, a terminal table and Markdown."""

from collections.abc import Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from grs_agents.foreign import read_json
from grs_agents.run.batch import Done

COLUMNS = (
    "name",
    "status",
    "task",
    "candidates",
    "objects",
    "matched",
    "reachable",
    "used",
    "moved",
    "fixes",
    "seconds",
    "reason",
)


def row(done: Done) -> dict[str, Any]:
    """The figures of one run."""
    record = done.record
    counts = record.counts if record else {}
    return {
        "name": done.job.name,
        "status": record.status if record else ("killed" if done.exit_status is None else "failed"),
        "task": _task(done),
        "candidates": counts.get("candidates", 0),
        "objects": counts.get("objects", 0),
        "matched": counts.get("objects_matched", 0),
        "reachable": counts.get("objects_reachable", 0),
        "used": counts.get("assets_used", 0),
        "moved": counts.get("objects_moved", 0),
        "fixes": counts.get("code_fixes", 0) + counts.get("test_fixes", 0),
        "seconds": record.seconds.get("total", 0.0) if record else 0.0,
        "reason": "" if record and record.status == "accepted" else (record.reason if record else done.error),
    }


def table(title: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> Table:
    """The rows for a terminal."""
    made = Table(*columns, title=title)
    for one in rows:
        made.add_row(*(Text(str(one[column])) for column in columns))
    return made


def markdown(columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    """The rows as a Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(str(one[column]).replace("|", "/") for column in columns) + " |" for one in rows]
    return "\n".join(lines) + "\n"


def _task(done: Done) -> str:
    file = done.job.out / "task.json"
    return str(read_json(file, "run again").get("task-name", "")) if file.is_file() else ""
