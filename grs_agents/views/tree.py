"""A whole run in the terminal: what was tried, the steps of each try, and what happened in each step."""

from itertools import groupby
from typing import Any

from rich.table import Table
from rich.text import Text

from grs_agents.trace import ProgramVersion
from grs_agents.views.common.safe_text import one_line
from grs_agents.views.common.steps import Step
from grs_agents.views.terminal import mark_of

_LONG = 400


def steps_tree(rows: list[Step]) -> Table:
    """The steps of a run as a tree: each fix a branch, each step a twig, its model calls and programs the leaves."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("#", justify="right", no_wrap=True)
    table.add_column("step", no_wrap=True)
    for column in ("seconds", "tokens", "cost"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("what came of it", overflow="fold")
    for attempt, group in groupby(rows, key=lambda step: step.attempt):
        steps = list(group)
        title = f"after fix {attempt}" if attempt else "before any fix"
        table.add_row("", Text(title, style="bold"), *_spent(steps), "", style="bold")
        for step in steps:
            _add_step(table, step, last=step is steps[-1])
    return table


def _add_step(table: Table, step: Step, last: bool) -> None:
    mark, style = mark_of(step)
    stem, trunk = ("└─ ", "   ") if last else ("├─ ", "│  ")
    visit = f" ×{step.visit}" if step.visit > 1 else ""
    name = Text.assemble(stem, (mark, style), f" {step.node}{visit}")
    detail = Text(one_line(step.detail, _LONG), style="red" if step.trouble else "")
    table.add_row(str(step.number), name, *_spent([step]), detail)
    leaves = [*_calls(step), *_programs(step)]
    for leaf in leaves:
        stem = "└─ " if leaf is leaves[-1] else "├─ "
        table.add_row("", Text(f"{trunk}{stem}{leaf[0]}"), *leaf[1:], style="dim")


def _calls(step: Step) -> list[tuple[str, str, str, str, Text]]:
    """One leaf for each role that was asked."""
    rows: list[tuple[str, str, str, str, Text]] = []
    for role in dict.fromkeys(reply.role for reply in step.replies):
        replies = [reply for reply in step.replies if reply.role == role]
        costs = [reply.cost for reply in replies if reply.cost is not None]
        tokens = sum(reply.input_tokens + reply.output_tokens for reply in replies)
        count = f" ×{len(replies)}" if len(replies) > 1 else ""
        cached = sum(reply.cached_tokens for reply in replies)
        unused = sum(bool(reply.error) for reply in replies)
        said = [replies[0].model, f"{cached} tokens from the cache" if cached else "", f"{unused} not used"]
        detail = Text(one_line(", ".join(part for part in said[: 2 + bool(unused)] if part)))
        seconds = f"{sum(reply.seconds for reply in replies):.1f}"
        rows.append((f"ask {role}{count}", seconds, f"{tokens:,}", f"${sum(costs):.4f}" if costs else "", detail))
    return rows


def _programs(step: Step) -> list[tuple[str, str, str, str, Text]]:
    """One leaf for each program that was written."""
    rows: list[tuple[str, str, str, str, Text]] = []
    for event in step.events:
        if isinstance(event, ProgramVersion):
            lines = [line for line in event.diff.splitlines() if not line.startswith(("+++", "---"))]
            added, gone = (sum(line.startswith(sign) for line in lines) for sign in "+-")
            rows.append((f"{event.program} v{event.number}", "", "", "", Text(f"+{added} -{gone} lines, {event.path}")))
    return rows


def _spent(steps: list[Step]) -> tuple[str, str, str]:
    """Seconds, tokens and cost of ``steps``."""
    tokens = sum(step.tokens for step in steps)
    costs = [step.cost for step in steps if step.cost is not None]
    seconds = f"{sum(step.seconds for step in steps):.1f}"
    return seconds, f"{tokens:,}" if tokens else "", f"${sum(costs):.4f}" if costs else ""


def step_record(step: Step) -> dict[str, Any]:
    """A step as plain data; its events are those with ``sequence`` from ``first`` to ``last``."""
    return {
        "number": step.number,
        "node": step.node,
        "visit": step.visit,
        "attempt": step.attempt,
        "status": step.status,
        "trouble": step.trouble,
        "started": step.started,
        "seconds": step.seconds,
        "calls": len(step.replies),
        "input_tokens": step.input_tokens,
        "output_tokens": step.output_tokens,
        "cost": step.cost,
        "detail": step.detail,
        "first": step.events[0].sequence,
        "last": step.events[-1].sequence,
    }
