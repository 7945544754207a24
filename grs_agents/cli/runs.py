"""``grs runs`` with its page, ``grs compare``, and ``latest`` as a run folder."""

import difflib
from pathlib import Path
from typing import Any, Final

from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.config.load import flatten_tree
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import check_output_path, refuse_link
from grs_agents.base.foreign.files import read_json, read_text
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.runs.record import RunRecord, read_record
from grs_agents.runs.run_opening import RUNS

LATEST: Final = "latest"
_FILE_REMEDY: Final = "restore the file"
_MOST_LINES: Final = 5000
"""Longest programs whose lines are compared: difflib takes quadratic time, and the file may be foreign."""


def resolve_run_folder(folder: Path) -> Path:
    """``folder``; for ``latest``, unless a folder has that name, the newest run below ``runs/``. Raises InputError:
    no run."""
    if str(folder) != LATEST or folder.exists():
        return folder
    folders = _list_newest_run_folders(RUNS)
    if not folders:
        raise InputError(f"there is no run below {RUNS}", "make one with `grs run`, or name its folder")
    return folders[0]


def list_runs(root: Path, status: str | None, scene: str | None, as_json: bool) -> None:
    """Print the runs below ``root``, newest first; unreadable runs are reported on stderr."""
    rows = _read_runs(root, status, scene)
    if as_json:
        print_json([{"folder": str(folder), **record.model_dump(mode="json")} for folder, record in rows])
        return
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for column in ("run", "status", "scene", "graph", "seconds"):
        table.add_column(column, no_wrap=column != "run", overflow="fold")
    table.add_column("reason", overflow="fold", ratio=1)
    for folder, record in rows:
        seconds = f"{record.seconds.get('total', 0.0):.1f}"
        cells = (str(folder), record.status, Path(record.source).name, record.graph, seconds, record.reason)
        table.add_row(*map(Text, cells))
    terminal.make_console().print(table)


def write_runs_index(
    root: Path, status: str | None, scene: str | None, out: Path | None, films: bool, as_json: bool
) -> None:
    """Write the page of the runs below ``root``, newest first, and print its path."""
    from grs_agents.views.runs_index.page import write_runs_page
    from grs_agents.views.terminal import show_activity_status

    page = out or refuse_link(root / "runs.html")
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"cannot write the page of runs as {page}", "name a file that ends in .html")
    rows = [(folder, record.model_dump(mode="json")) for folder, record in _read_runs(root, status, scene)]
    check_output_path(page)
    with show_activity_status("reading runs") as show:
        write_runs_page(rows, page, films, show)
    if as_json:
        print_json({"file": str(page), "runs": len(rows)})
    else:
        print_escaped(f"{page}: {len(rows)} runs")


def _read_runs(root: Path, status: str | None, scene: str | None) -> list[tuple[Path, RunRecord]]:
    """The runs below ``root``, newest first; unreadable runs are reported on stderr."""
    if not root.is_dir():
        raise InputError(f"{root} is no folder", "name the folder that holds run folders, runs/ by default")
    rows: list[tuple[Path, RunRecord]] = []
    for folder in _list_newest_run_folders(root):
        try:
            record = read_record(folder)
        except GrsError as error:
            print_escaped(f"grs: {error}", error=True)
            continue
        if (status is None or record.status == status) and (scene is None or scene in record.source):
            rows.append((folder, record))
    return rows


def _list_newest_run_folders(root: Path) -> list[Path]:
    """The run folders below ``root``, newest first."""
    files = [file for file in root.glob("*/run.json") if file.is_file()]
    return [file.parent for file in sorted(files, key=lambda file: file.stat().st_mtime_ns, reverse=True)]


def compare_runs(first: Path, second: Path, as_json: bool) -> None:
    """Print the differences of two runs: outcome, settings, counts, seconds, task and programs."""
    a, b = _flatten_run_record(first), _flatten_run_record(second)
    differing = {key: (a.get(key), b.get(key)) for key in {**a, **b} if a.get(key) != b.get(key)}
    for name in ("simulation.py", "test_simulation.py"):
        files = (first / name, second / name)
        old, new = (read_text(file, _FILE_REMEDY).splitlines() if file.is_file() else [] for file in files)
        if old != new and max(len(old), len(new)) > _MOST_LINES:
            differing[name] = (f"{len(old)} lines", f"{len(new)} lines")
            continue
        diff = list(difflib.unified_diff(old, new, n=0))[2:]  # without the two headers
        changed = sum(line[0] in "+-" for line in diff)
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


def _flatten_run_record(folder: Path) -> dict[str, Any]:
    """The record of a run by dotted key, with its task, without fields that differ between any two runs."""
    record = read_record(folder).model_dump(mode="json", exclude={"id", "question", "exit_status"})
    task = folder / "task.json"
    record["task"] = read_json(task, _FILE_REMEDY).get("task-description") if task.is_file() else None
    record["seconds"] = record["seconds"].get("total")
    return flatten_tree(record)
