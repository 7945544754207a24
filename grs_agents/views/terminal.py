"""Terminal output of a run: live progress, the final summary, and a tree of fix attempts, steps and events."""

import time
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from itertools import groupby
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.trace.events import Event, NodeEnded, Note, ProgramVersion, Reply, RunEnded, RunStarted
from grs_agents.views.common.event_steps import Status, Step, Steps, format_event_line
from grs_agents.views.common.safe_text import to_terminal_line

MARKS: dict[Status, tuple[str, str]] = {
    "running": ("▶", "yellow"),
    "done": ("✓", "green"),
    "failed": ("✗", "red"),
    "interrupted": ("-", "red"),
}
"""Mark and style of each status."""
_TROUBLE = ("✗", "red")


def step_mark_and_style(step: Step) -> tuple[str, str]:
    """Returns: mark and style. A finished node whose tests or checks failed is marked as failed."""
    return _TROUBLE if step.status == "done" and step.problem_summary else MARKS[step.status]


_VERDICTS = {"accepted": "bold green", "rejected": "bold red", "failed": "bold red", "interrupted": "yellow"}


@contextmanager
def show_activity_status(task: str) -> Generator[Callable[[str], None]]:
    """Show the status of a long command on standard error, if that is a terminal; the yielded function updates the
    text."""
    console = terminal.make_console(error=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status(Text(to_terminal_line(task))) as status:
        yield lambda text: status.update(Text(to_terminal_line(text)))


class ProgressView:
    """Prints events as they arrive: a live table on a terminal, else a line for each finished node (if verbose, for
    each event). Use as a context manager and subscribe it to the event log."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or terminal.make_console(error=True)
        self._steps = Steps()
        self._title = "starting"
        self._live: Live | None = None
        self._verbose = terminal.VERBOSITY.get() == "verbose"

    def __enter__(self) -> "ProgressView":
        if self._console.is_terminal and not self._verbose:
            self._live = Live(console=self._console, get_renderable=self._render_progress, refresh_per_second=4)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()
            self._live = None

    def __call__(self, event: Event) -> None:
        """Show an event; the live table refreshes four times a second."""
        self._steps.add_event(event)
        if isinstance(event, RunStarted):
            self._title = f"{event.run_id} graph {event.graph}, seed {event.seed}"
        if isinstance(event, Note) and not self._steps.rows and not self._verbose:  # before the first node: of the run
            self._console.print(Text(to_terminal_line(event.text, 300)), soft_wrap=True)
        if self._live is not None:
            return
        if self._verbose:
            line = to_terminal_line(format_event_line(event), 2000)
        elif isinstance(event, NodeEnded):
            step = next((row for row in reversed(self._steps.rows) if row.node == event.node), None)
            detail = to_terminal_line(step.details_as_text, 120) if step else ""
            line = f"{event.node}: {'failed' if event.error else 'done'} in {event.seconds:.1f} s  {detail}"
        elif isinstance(event, RunEnded):
            line = f"{event.status}: {to_terminal_line(event.reason)}"
        else:
            return
        self._console.print(Text(line.rstrip()), soft_wrap=True)

    def _render_progress(self) -> RenderableType:
        table = Table.grid(padding=(0, 1))
        latest_visits = {step.node: step for step in self._steps.rows}  # in the order of the first visits
        for step in latest_visits.values():
            mark, style = step_mark_and_style(step)
            now = time.time() - step.started if step.status == "running" else step.seconds
            visit = f"x{step.visit}" if step.visit > 1 else ""
            detail = Text(to_terminal_line(step.details_as_text, 300), overflow="ellipsis", no_wrap=True, style="dim")
            table.add_row(Text(mark, style=style), step.node, visit, f"{max(now, 0):.1f} s", detail)
        if ended := self._steps.ended:
            footer = Text(f"{ended.status}: {to_terminal_line(ended.reason)}", style=_VERDICTS.get(ended.status, ""))
        else:
            attempt = self._steps.rows[-1].attempt if self._steps.rows else 0
            decision = self._steps.decision
            last = f"; last decision: {decision.verdict}" if decision else ""
            footer = Text(f"fixes so far: {attempt}{last}", style="dim")
        return Group(Text(to_terminal_line(self._title), style="bold"), table, footer)


def summary_table(run: dict[str, Any]) -> Table:
    """Summary of a finished run, from the content of its ``run.json``."""
    status = str(run.get("status", "?"))
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row("status", Text(status, style=_VERDICTS.get(status, "")))
    if run.get("reason"):
        table.add_row("reason", Text(to_terminal_line(str(run["reason"]), 400)))
    for line in run.get("edits") or ():
        table.add_row("corrected", Text(to_terminal_line(str(line), 200)))
    counts, seconds = dict[str, Any](run.get("counts") or {}), dict[str, Any](run.get("seconds") or {})
    calls, tokens_in, tokens_out = (counts.pop(key, 0) for key in ("model_calls", "input_tokens", "output_tokens"))
    if counts:
        table.add_row("counts", Text(to_terminal_line(_format_key_values(counts), 600)))
    if calls:
        dollars = run.get("cost")
        cost = "" if dollars is None else f"; cost: ${dollars:.4f}" if dollars else "; they cost nothing"
        table.add_row("models", Text(to_terminal_line(f"{calls} calls, {tokens_in} tokens in, {tokens_out} out{cost}")))
    if seconds:
        table.add_row("seconds", Text(to_terminal_line(_format_key_values(seconds), 600)))
    return table


def _format_key_values(values: dict[str, Any]) -> str:
    shown = (f"{value:.1f}" if isinstance(value, float) else str(value) for value in values.values())
    return ", ".join(f"{key} {value}" for key, value in zip(values, shown, strict=True))


_MAX_DETAIL = 400
"""Characters of the details of a step."""


def steps_tree(rows: list[Step]) -> Table:
    """The steps of a run as a tree: fix attempts, steps, and below each step its model calls and program versions."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("#", justify="right", no_wrap=True)
    table.add_column("step", no_wrap=True)
    for column in ("seconds", "tokens", "cost"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("what came of it", overflow="fold")
    for attempt, group in groupby(rows, key=lambda step: step.attempt):
        steps = list(group)
        title = f"after fix {attempt}" if attempt else "before any fix"
        table.add_row("", Text(title, style="bold"), *_format_step_totals(steps), "", style="bold")
        for step in steps:
            mark, style = step_mark_and_style(step)
            stem, trunk = ("└─ ", "   ") if step is steps[-1] else ("├─ ", "│  ")
            visit = f" ×{step.visit}" if step.visit > 1 else ""
            name = Text.assemble(stem, (mark, style), f" {step.node}{visit}")
            detail = Text(
                to_terminal_line(step.details_as_text, _MAX_DETAIL), style="red" if step.problem_summary else ""
            )
            table.add_row(str(step.number), name, *_format_step_totals([step]), detail)
            leaves = _list_step_leaves(step)
            for leaf in leaves:
                stem = "└─ " if leaf is leaves[-1] else "├─ "
                table.add_row("", Text(f"{trunk}{stem}{leaf[0]}"), *leaf[1:], style="dim")
    return table


def _list_step_leaves(step: Step) -> list[tuple[str, str, str, str, Text]]:
    """Rows below a step: its model calls by role, then its program versions.
    Returns: cells (title, seconds, tokens, cost, detail)."""
    leaves: list[tuple[str, str, str, str, Text]] = []
    replies_by_role: dict[str, list[Reply]] = {}
    for reply in step.model_replies:
        replies_by_role.setdefault(reply.role, []).append(reply)
    for role, replies in replies_by_role.items():
        tokens = sum(reply.input_tokens + reply.output_tokens for reply in replies)
        count = f" ×{len(replies)}" if len(replies) > 1 else ""
        details = [replies[0].model]
        if cached := sum(reply.cached_tokens for reply in replies):
            details.append(f"{cached} tokens from the cache")
        if unused := sum(bool(reply.error) for reply in replies):
            details.append(f"{unused} not used")
        seconds = f"{sum(reply.seconds for reply in replies):.1f}"
        cost = _format_total_cost(reply.cost for reply in replies)
        detail = Text(to_terminal_line(", ".join(details)))
        leaves.append((f"ask {role}{count}", seconds, f"{tokens:,}", cost, detail))
    for event in step.events:
        if isinstance(event, ProgramVersion):
            lines = [line for line in event.diff.splitlines() if not line.startswith(("+++", "---"))]
            added, removed = (sum(line.startswith(sign) for line in lines) for sign in "+-")
            detail = Text(f"+{added} -{removed} lines, {event.path}")
            leaves.append((f"{event.program} v{event.number}", "", "", "", detail))
    return leaves


def _format_total_cost(costs: Iterable[float | None]) -> str:
    """Sum of the known costs; empty if none is known."""
    known = [cost for cost in costs if cost is not None]
    return (f"${sum(known):.4f}" if sum(known) else "none") if known else ""


def _format_step_totals(steps: list[Step]) -> tuple[str, str, str]:
    """Returns: seconds, tokens and cost of ``steps``."""
    tokens = sum(step.total_tokens for step in steps)
    seconds = f"{sum(step.seconds for step in steps):.1f}"
    return seconds, f"{tokens:,}" if tokens else "", _format_total_cost(step.cost for step in steps)


def step_to_dict(step: Step) -> dict[str, Any]:
    """A step as plain data; its events have the ``sequence`` numbers ``first`` to ``last``."""
    return {
        "number": step.number,
        "node": step.node,
        "visit": step.visit,
        "attempt": step.attempt,
        "status": step.status,
        "trouble": step.problem_summary,
        "started": step.started,
        "seconds": step.seconds,
        "calls": len(step.model_replies),
        "input_tokens": step.input_tokens,
        "output_tokens": step.output_tokens,
        "cost": step.cost,
        "detail": step.details_as_text,
        "first": step.events[0].sequence,
        "last": step.events[-1].sequence,
    }
