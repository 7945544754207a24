"""Events folded into steps."""

from collections.abc import Callable
from typing import Any

from grs_agents.base.trace.events import NodeEnded, NodeStarted, Note, RunEnded
from grs_agents.base.trace.log import read_events
from grs_agents.views.common.event_steps import Steps, group_events_into_steps


def test_a_run_becomes_one_step_a_visit(script: Callable[[], Any]) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    rows = group_events_into_steps(read_events(run.log.path))
    visits = " ".join(f"{row.node} {row.visit}" for row in rows)
    assert visits == "segment 1 generate_task 1 generate_sim 1 run_tests 1 route 1 fix_code 1 run_tests 2 audit 1"
    assert {row.status for row in rows} == {"done"}
    assert [row.attempt for row in rows] == [0, 0, 0, 0, 0, 1, 1, 1]
    assert rows[2].total_tokens == 1020
    assert rows[3].details_as_text == "1 passed, 1 failed"
    assert rows[4].details_as_text.startswith("→ fix_code: The oracle")
    assert "seed 1: success, reward 1.00" in rows[-1].details_as_text


def test_errors_and_interruptions_show() -> None:
    folded = Steps()
    folded.add_event(NodeStarted(node="a"))
    assert folded.running_step is not None
    folded.add_event(NodeEnded(node="a", seconds=1.0, error="boom"))
    assert folded.running_step is None
    folded.add_event(NodeStarted(node="b"))
    folded.add_event(Note(level="warning", text="slow"))
    folded.add_event(NodeStarted(node="b", visit=2))
    folded.add_event(RunEnded(status="interrupted"))
    assert [row.status for row in folded.rows] == ["failed", "interrupted", "interrupted"]
    assert [row.details_as_text for row in folded.rows] == ["boom", "slow", ""]
    assert folded.ended is not None
