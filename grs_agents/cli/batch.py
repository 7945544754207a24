"""``grs batch``."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.cli.run_outputs import write_report
from grs_agents.runs.batch.batch import BatchOrder, find_scenes_given_up, run_batch, summarize_rows
from grs_agents.runs.batch.results import read_results
from grs_agents.runs.batch.row import BatchRow
from grs_agents.runs.batch.scene_list import list_scenes
from grs_agents.runs.batch.selection import select_rows

_STYLES = {"accepted": "green", "rejected": "red", "failed": "red", "killed": "red", "interrupted": "yellow"}


def run_batch_and_print_rows(
    scenes: Sequence[str],
    out: Path,
    tasks: int | None,
    seed: int | None,
    config: Path | None,
    settings: Sequence[str],
    where: str | None,
    reports: bool,
    as_json: bool,
    **limits: Any,
) -> int:
    """Make the runs, then print all rows or those selected by ``where``; ``limits`` are fields of `BatchOrder`.

    Returns:
        Exit status: 0 if every run has a verdict and no task is missing, else 1.
    """
    order = BatchOrder(list_scenes(scenes), out, tasks, seed or 0, config, tuple(settings), **limits)
    try:
        with _show_batch_progress_bar(order) as watch:
            results = run_batch(order, watch)
    except KeyboardInterrupt:
        print_escaped("interrupted; the same command goes on", error=True)
        raise
    if reports:
        for row in results.rows:
            folder = order.out / row.run
            if (folder / "events.jsonl").is_file() and not (folder / "report.html").is_file():
                write_report(folder, None, lambda _: None)
        results = run_batch(order)  # links the reports on the page; no run is repeated
    _print_batch_rows(results.summary, select_rows(results.rows, where) if where else results.rows, order.out, as_json)
    verdicts = all(row.status in ("accepted", "rejected") for row in results.rows)
    given_up = list(find_scenes_given_up(order, results))
    for line in given_up:
        print_escaped(line, error=True)
    return 0 if verdicts and not given_up else 1


def list_batch(out: Path, where: str | None, as_json: bool) -> int:
    """Print the rows of an earlier batch, or those selected by ``where``."""
    results = summarize_rows(read_results(out).rows)
    _print_batch_rows(results.summary, select_rows(results.rows, where) if where else results.rows, out, as_json)
    return 0


@contextmanager
def _show_batch_progress_bar(order: BatchOrder) -> Generator[Any]:
    """A progress bar on a terminal, and a line for each ended run."""
    console = terminal.make_console(error=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    ended = 0
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("runs", total=(order.tasks or 1) * len(order.scenes))

        def watch(row: BatchRow) -> None:
            nonlocal ended
            ended += 1
            bar.update(task, completed=ended, total=max(ended, (order.tasks or 1) * len(order.scenes)))
            line = f"{row.run}: {row.status}  {row.task or row.reason}  {row.seconds:.1f} s"
            console.print(Text(line, style=_STYLES.get(row.status, "")), soft_wrap=True)

        yield watch


def _print_batch_rows(summary: dict[str, Any], rows: Sequence[BatchRow], out: Path, as_json: bool) -> None:
    if as_json:
        print_json({"summary": summary, "rows": [row.model_dump(mode="json") for row in rows]})
        return
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for column in ("run", "status", "task", "reward", "fixes", "seconds"):
        table.add_column(column, no_wrap=column != "task", overflow="fold")
    table.add_column("reason", overflow="fold", ratio=1)
    for row in rows:
        fixes = row.code_fixes + row.test_fixes + row.task_fixes
        reward = "" if row.reward is None else f"{row.reward:.2f}"
        reason = f"the same task as {row.repeats}" if row.repeats else row.reason * (row.status != "accepted")
        cells = (row.run, row.status, row.task, reward, str(fixes), f"{row.seconds:.1f}", reason)
        table.add_row(*map(Text, cells), style=_STYLES.get(row.status, ""))
    terminal.make_console().print(table)
    families = ", ".join(f"{name} {count}" for name, count in summary["families"].items())
    print_escaped(
        f"{summary['accepted']} of {summary['runs']} accepted, {summary['different_tasks']} different tasks"
        + (f" ({families}), mean distance {summary['mean_distance']}" if families else "")
        + f"; {out / 'index.html'}"
    )
