"""One step in full."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import Finding, NodeEnded, NodeStarted, Reply
from grs_agents.base.trace.log import read_events
from grs_agents.views.common.event_steps import Step, Steps, group_events_into_steps
from grs_agents.views.common.step_text import (
    find_last_failed_step,
    find_step_by_number,
    iter_step_sections,
    make_event_section,
)
from tests.views.conftest import DIFF, SECOND


@pytest.fixture
def rows(script: Callable[[], Any]) -> list[Step]:
    run = script()
    run.before_fix()
    run.after_fix()
    return group_events_into_steps(read_events(run.log.path))


def told(step: Step) -> str:
    """All that is said of a step."""
    return "\n".join(f"{section.heading}\n{section.text}" for section in iter_step_sections(step))


def test_a_step_tells_its_prompt_reply_and_diff_exactly(rows: list[Step]) -> None:
    text = told(find_step_by_number(rows, 6))
    assert rows[5].node == "fix_code"
    assert "# Role: fix_code\n\n## Test report" in text
    assert f"```python\n{SECOND}```" in text
    assert "900 tokens in, 120 out" in text
    assert DIFF in text


def test_a_reply_tells_its_tokens_from_the_cache_its_cost_and_why_it_was_not_used() -> None:
    reply = Reply(
        role="task",
        model="m",
        call="2",
        text="hello",
        input_tokens=30,
        output_tokens=4,
        cached_tokens=12,
        cost=0.03,
        seconds=1.5,
        finish_reason="stop",
        error="no JSON",
    )
    section = make_event_section(reply)
    assert section is not None
    usage = "30 tokens in (12 from the cache), 4 out, $0.0300, 1.5 s, stop"
    assert section.heading == f"reply of m to task (call 2): {usage}"
    assert section.text == "hello\n\nnot used: no JSON"


def test_a_failing_test_comes_with_its_traceback_and_what_the_oracle_did(rows: list[Step]) -> None:
    text = told(find_step_by_number(rows, 4))
    assert 'File "test.py", line 9\nAssertionError: 0.25 < 0.99' in text
    assert "oracle: step_limit, reward 0.25" in text


def test_the_step_that_failed_is_the_last_one_with_trouble(rows: list[Step]) -> None:
    found = find_last_failed_step(rows)
    assert found is not None and (found.number, found.problem_summary) == (4, "tests: 1 passed, 1 failed")
    assert find_last_failed_step(rows[:3]) is None
    folded = Steps()
    folded.add_event(NodeStarted(node="audit"))
    folded.add_event(Finding(check="solved", passed=False, measured="0.25", bound="at least 0.99"))
    folded.add_event(NodeEnded(node="audit", seconds=1.0))
    assert folded.rows[0].problem_summary == "solved: 0.25; at least 0.99"
    folded.add_event(NodeStarted(node="conclude"))
    folded.add_event(NodeEnded(node="conclude", seconds=1.0, error="KeyError: 'reward'"))
    found = find_last_failed_step(folded.rows)
    assert found is not None and found.problem_summary in told(found)


@pytest.mark.parametrize("number", [0, 9, -1])
def test_a_step_that_is_not_there_is_an_input_error(rows: list[Step], number: int) -> None:
    with pytest.raises(InputError, match="one of 1 to 8"):
        find_step_by_number(rows, number)


@given(st.text())
def test_what_is_printed_cannot_command_the_terminal(text: str) -> None:
    shown = escape_control_chars(text)
    assert all(character in "\n\t" or ord(character) >= 32 for character in shown)
    assert not any(0x7F <= ord(character) <= 0x9F for character in shown)
    if shown == text.replace("\r\n", "\n"):
        assert escape_control_chars(shown) == shown
