"""``grs compare``."""

import difflib
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.config import flatten_tree
from grs_agents.foreign import read_json, read_text
from grs_agents.runs import read_record
from grs_agents.terminal import print_json

_FILE_REMEDY = "restore the file"


def compare_runs(first: Path, second: Path, as_json: bool) -> None:
    """Print what differs between two runs: outcome, settings, counts, seconds, task and programs."""
    one, other = _describe_run(first), _describe_run(second)
    differing = {key: (one.get(key), other.get(key)) for key in {**one, **other} if one.get(key) != other.get(key)}
    for name in ("simulation.py", "test_simulation.py"):
        changed = _count_changed_lines(first / name, second / name)
        if changed:
            differing[name] = (None, f"{changed} lines differ")
    if as_json:
        print_json({"runs": [str(first), str(second)], "differences": differing})
        return
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for column in ("", str(first), str(second)):
        table.add_column(column, overflow="fold")
    for key, values in differing.items():
        table.add_row(key, *(Text("" if value is None else str(value)) for value in values))
    terminal.make_console().print(table if differing else Text("nothing differs"))


def _describe_run(folder: Path) -> dict[str, Any]:
    """The record of a run by dotted key, with its task; without what differs between any two runs."""
    record = read_record(folder).model_dump(mode="json", exclude={"id", "question", "exit_status"})
    task = folder / "task.json"
    record["task"] = read_json(task, _FILE_REMEDY).get("task-description") if task.is_file() else None
    record["seconds"] = record["seconds"].get("total")
    return flatten_tree(record)


def _count_changed_lines(first: Path, second: Path) -> int:
    """How many lines were added or removed between two files; one that is not there is empty."""
    old, new = (read_text(file, _FILE_REMEDY).splitlines() if file.is_file() else [] for file in (first, second))
    return sum(line[0] in "+-" for line in difflib.ndiff(old, new))
