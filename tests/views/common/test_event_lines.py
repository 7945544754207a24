"""Each event as one line."""

from collections.abc import Callable
from typing import Any

from grs_agents.base.trace.events import Decision, Finding, NodeEnded, Note, RunEnded
from grs_agents.base.trace.log import read_events
from grs_agents.views.common.event_steps import event_log_level, format_event_line


def test_every_event_of_a_run_has_words(script: Callable[[], Any]) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    lines = [format_event_line(event) for event in read_events(run.log.path)]
    assert all(len(text) > 3 for text in lines)
    assert "▶ run_tests, visit 2" in lines
    assert "• seed 0: success, reward 1.00" in lines


def test_what_went_wrong_stands_out() -> None:
    assert event_log_level(NodeEnded(node="a", seconds=0, error="boom")) == "ERROR"
    assert event_log_level(NodeEnded(node="a", seconds=0)) == "DEBUG"
    assert (
        event_log_level(Finding(check="reward", passed=False))
        == event_log_level(Decision(verdict="fix_code"))
        == "WARN"
    )
    assert event_log_level(RunEnded(status="rejected")) == "WARN"
    assert event_log_level(RunEnded(status="accepted")) == "INFO"
    assert event_log_level(Note(level="error", text="x")) == "ERROR"


def test_only_a_check_that_holds_has_a_tick() -> None:
    assert format_event_line(Finding(check="reward", passed=True, measured="1.00")) == "✓ reward: 1.00"
    assert format_event_line(Finding(check="reward", passed=False, measured="0.50")).startswith("× ")
