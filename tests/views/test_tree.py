"""A run as a tree."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from grs_agents.base.trace.events import NodeEnded, NodeStarted, Reply
from grs_agents.base.trace.log import read_events
from grs_agents.views.common.event_steps import Steps, group_events_into_steps
from grs_agents.views.terminal import step_to_dict, steps_tree


def shown(rows: list[Any]) -> str:
    """The tree as a wide terminal shows it."""
    console = Console(file=io.StringIO(), width=200, color_system=None)
    console.print(steps_tree(rows))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_the_tree_has_a_branch_for_each_fix_and_a_leaf_for_each_call(script: Callable[[], Any]) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    lines = shown(group_events_into_steps(read_events(run.log.path))).splitlines()
    heads = [line.split()[:3] for line in lines if line.strip().startswith(("before", "after"))]
    assert heads == [["before", "any", "fix"], ["after", "fix", "1"]]
    assert any("├─ ✓ fix_code" in line and "1,020" in line for line in lines)
    assert any("ask fix_code" in line and "1,020" in line for line in lines)
    assert any("simulation v2" in line and "+1 -1 lines" in line for line in lines)
    assert any("└─ ✓ audit" in line and "seed 1: success" in line for line in lines)


def test_cost_and_cache_show_where_the_provider_tells_them() -> None:
    folded = Steps()
    folded.add_event(NodeStarted(node="route"))
    for cost in (0.01, None, 0.02):
        reply = Reply(call="a", role="route", model="m", text="", input_tokens=5, cached_tokens=4, cost=cost)
        folded.add_event(reply)
    folded.add_event(NodeEnded(node="route", seconds=2.0))
    text = shown(folded.rows)
    assert "$0.0300" in text and "12 tokens from the cache" in text and "ask route ×3" in text
    record = step_to_dict(folded.rows[0])
    assert (record["calls"], record["input_tokens"], record["cost"]) == (3, 15, 0.03)


def test_markup_in_names_is_text(tmp_path: Path) -> None:
    folded = Steps()
    folded.add_event(NodeStarted(node="[red]x[/red]"))
    folded.add_event(NodeEnded(node="[red]x[/red]", seconds=0.0, error="[bold]boom"))
    assert "[red]x[/red]" in shown(folded.rows) and "[bold]boom" in shown(folded.rows)
    assert json.loads(json.dumps(step_to_dict(folded.rows[0])))["trouble"] == "[bold]boom"
