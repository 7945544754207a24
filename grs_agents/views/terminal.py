"""A run in the terminal: live progress and the final summary."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.trace import Event, NodeEnded, RunEnded, RunStarted
from grs_agents.views.common.safe_text import one_line
from grs_agents.views.common.steps import Status, Step, Steps

MARKS: dict[Status, tuple[str, str]] = {
    "running": ("▶", "yellow"),
    "done": ("✓", "green"),
    "failed": ("✗", "red"),
    "interrupted": ("-", "red"),
}
"""How each status looks: a mark and its style."""
_TROUBLE = ("✗", "red")


def mark_of(step: Step) -> tuple[str, str]:
    """The mark of a step and its style; a node that did its work and found tests failing is no success."""
    return _TROUBLE if step.status == "done" and step.trouble else MARKS[step.status]


_VERDICTS = {"accepted": "bold green", "rejected": "bold red", "failed": "bold red", "interrupted": "yellow"}


@contextmanager
def working(task: str, console: Console | None = None) -> Generator[Callable[[str], None]]:
    """Show what a long command is at, on standard error and only if that is a terminal.

    Yields:
        Call it with what comes next.
    """
    console = console or terminal.console(error=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status(Text(one_line(task))) as status:
        yield lambda text: status.update(Text(one_line(text)))


class Progress:
    """Shows events as they come: a live table on a terminal, else one line for each finished node.

    Use as a context manager and subscribe it to the event log.

    Args:
        console: where to; standard error by default, so that ``--json`` has stdout to itself.
        quiet: show nothing.
    """

    def __init__(self, console: Console | None = None, quiet: bool = False) -> None:
        self._console = console or terminal.console(error=True)
        self._quiet = quiet
        self._steps = Steps()
        self._title = "starting"
        self._live: Live | None = None

    def __enter__(self) -> "Progress":
        if self._console.is_terminal and not self._quiet:
            live = Live(console=self._console, get_renderable=self._render, refresh_per_second=4)
            self._live = live
            live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()
            self._live = None

    def __call__(self, event: Event) -> None:
        """Take in one event; the screen follows four times a second."""
        self._steps.add(event)
        if isinstance(event, RunStarted):
            self._title = f"{event.run_id} graph {event.graph}, seed {event.seed}"
        if self._live is None and not self._quiet:
            self._print(event)

    def _print(self, event: Event) -> None:
        if isinstance(event, NodeEnded):
            step = next((row for row in reversed(self._steps.rows) if row.node == event.node), None)
            detail = one_line(step.detail, 120) if step else ""
            line = f"{event.node}: {'failed' if event.error else 'done'} in {event.seconds:.1f} s  {detail}"
        elif isinstance(event, RunEnded):
            line = f"{event.status}: {one_line(event.reason)}"
        else:
            return
        self._console.print(Text(line.rstrip()), soft_wrap=True)

    def _render(self) -> RenderableType:
        table = Table.grid(padding=(0, 1))
        for step in _latest_visits(self._steps.rows):
            mark, style = mark_of(step)
            now = time.time() - step.started if step.status == "running" else step.seconds
            visit = f"x{step.visit}" if step.visit > 1 else ""
            detail = Text(one_line(step.detail, 300), overflow="ellipsis", no_wrap=True, style="dim")
            table.add_row(Text(mark, style=style), step.node, visit, f"{max(now, 0):.1f} s", detail)
        return Group(Text(one_line(self._title), style="bold"), table, self._footer())

    def _footer(self) -> Text:
        if self._steps.ended:
            ended = self._steps.ended
            return Text(f"{ended.status}: {one_line(ended.reason)}", style=_VERDICTS.get(ended.status, ""))
        attempt = self._steps.rows[-1].attempt if self._steps.rows else 0
        decision = self._steps.decision
        said = f"; last decision: {decision.verdict}" if decision else ""
        return Text(f"fixes so far: {attempt}{said}", style="dim")


def _latest_visits(rows: list[Step]) -> list[Step]:
    """The latest visit of each node, in the order of the nodes' first visits."""
    latest: dict[str, Step] = {}
    for step in rows:
        latest[step.node] = step
    return list(latest.values())


def summary_table(run: dict[str, Any]) -> Table:
    """The end of a run in a few lines, from the content of its ``run.json``."""
    status = str(run.get("status", "?"))
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row("status", Text(status, style=_VERDICTS.get(status, "")))
    if run.get("reason"):
        table.add_row("reason", Text(one_line(str(run["reason"]), 400)))
    for group in ("counts", "seconds"):
        values: dict[str, Any] | None = run.get(group)
        if values:
            table.add_row(group, Text(one_line(_pairs(values), 600)))
    return table


def _pairs(values: dict[str, Any]) -> str:
    shown = (f"{value:.1f}" if isinstance(value, float) else str(value) for value in values.values())
    return ", ".join(f"{key} {value}" for key, value in zip(values, shown, strict=True))
