"""The records of a state: plain JSON is parsed into them, and they become the same JSON again."""

import json
from typing import Any, get_args, get_type_hints

import pytest

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.graph.state import CHECKPOINTED_TYPES, RunState, parse_state, state_as_json
from tests.graph.conftest import TASK, with_

REPORT = {"outcome": "failed", "cases": [{"id": "T.test_a", "outcome": "failed", "message": "1 != 2"}]}


def test_plain_json_becomes_records_and_json_again(state: RunState) -> None:
    revised = {"from": TASK, "given-up": "a block"}
    parsed = with_(state, report=REPORT, audit={}, revised=revised)
    assert parsed["task"].assets == tuple(TASK["assets-used"]) and parsed["audit"] is None
    assert parsed["revised"] is not None and parsed["revised"].original == parsed["task"]
    assert parse_state(parsed) == parsed
    plain = state_as_json(parsed)
    assert (plain["task"], plain["audit"], plain["revised"]) == (TASK, {}, revised)
    assert plain["report"]["cases"][0]["message"] == "1 != 2"
    assert parse_state(json.loads(json.dumps(plain))) == parsed


def test_a_task_answers_to_the_names_of_its_json(state: RunState) -> None:
    assert state["task"]["task-description"] == state["task"].description


@pytest.mark.parametrize(
    ("key", "value"),
    [("task", {"task-name": "t"}), ("audit", {"accepted": True}), ("history", [{}]), ("report", "passed")],
)
def test_a_value_of_another_type_is_named(key: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"the state's {key}"):
        parse_state({key: value})


def test_the_classes_that_a_checkpoint_may_hold_are_those_of_the_state() -> None:
    hints = get_type_hints(RunState).values()
    named = {kind for hint in hints for kind in (hint, *get_args(hint)) if isinstance(kind, type)}
    assert {kind for kind in named if issubclass(kind, Frozen)} == set(CHECKPOINTED_TYPES)
