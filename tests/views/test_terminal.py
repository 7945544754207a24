"""A run in the terminal."""

import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from grs_agents.base.trace.events import NodeStarted, Note
from grs_agents.views.terminal import ProgressView, summary_table


def console(terminal: bool) -> Console:
    """A console that writes to memory."""
    return Console(file=io.StringIO(), force_terminal=terminal, width=120, color_system=None)


def text_of(target: Console) -> str:
    """What was written to it."""
    assert isinstance(target.file, io.StringIO)
    return target.file.getvalue()


def test_without_a_terminal_each_node_is_one_line(script: Callable[[], Any]) -> None:
    run, target = script(), console(terminal=False)
    with ProgressView(target) as progress:
        run.log.subscribe(progress)
        run.before_fix()
        run.after_fix()
    lines = text_of(target).splitlines()
    assert len(lines) == 8 + 1
    assert lines[3] == "run_tests: done in 0.5 s  1 passed, 1 failed"
    assert lines[-1] == "accepted: every check passed"


def test_notes_before_the_first_node_are_lines_of_their_own() -> None:
    for terminal in (False, True):
        target = console(terminal)
        with ProgressView(target) as progress:
            progress(Note(text="hand: two fingers"))
            progress(NodeStarted(node="read"))
            progress(Note(text="within a node"))
        assert "hand: two fingers" in text_of(target)
        assert "within a node" not in text_of(target)


def test_a_terminal_shows_nodes_visits_and_the_verdict(script: Callable[[], Any]) -> None:
    run, target = script(), console(terminal=True)
    with ProgressView(target) as progress:
        run.log.subscribe(progress)
        run.before_fix()
        run.after_fix()
    shown = text_of(target)
    assert "sample-run graph grs, seed 0" in shown
    assert "x2" in shown
    assert "accepted: every check passed" in shown


def test_a_running_node_and_the_last_decision_show() -> None:
    target = console(terminal=True)
    with ProgressView(target) as progress:
        progress(NodeStarted(node="audit", attempt=2))
        progress(Note(level="warning", text="[red]markup\x1b[2J"))
    assert "audit" in text_of(target)
    assert "fixes so far: 2" in text_of(target)
    assert "[red]markup" in text_of(target)


def test_the_summary_holds_status_reason_counts_and_seconds() -> None:
    target = console(terminal=False)
    run = {"status": "rejected", "reason": "fixes used up", "counts": {"fixes": 10}, "seconds": {"audit": 1.25}}
    target.print(summary_table(run))
    target.print(summary_table({"status": "running"}))
    for part in ("rejected", "fixes used up", "fixes 10", "audit 1.2"):
        assert part in text_of(target)


def test_the_terminal_never_imports_rerun() -> None:
    probe = "import sys, grs_agents.views; print([name for name in ('rerun', 'cv2', 'trimesh') if name in sys.modules])"
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", probe], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
