"""The records of a state: plain JSON is parsed into them, and they become the same JSON again."""

import json
from typing import Any, cast, get_args, get_type_hints

import pytest

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.graph.perceive import next_step_after_register
from grs_agents.graph.state import CHECKPOINTED_TYPES, RunState, TableObject, parse_state, state_as_json
from tests.graph.conftest import TASK, with_

PHOTO: dict[str, Any] = {
    "camera": {"fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480, "depth_scale": 0.001},
    "table": {
        "T_robot_cam": [[0.0, -1.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0], [0.0, 0.0, 0.0, 1.0]],
        "origin": "table_plane",
        "residual": 0.001,
        "inliers": 0.7,
    },
    "objects": [
        {
            "id": 1,
            "mask": "scene/mask_01.png",
            "crop": "scene/crop_01.png",
            "box": {"low": [0.4, -0.1, 0.0], "high": [0.5, 0.1, 0.1]},
            "upright": {"center": [0.45, 0.0, 0.05], "size": [0.1, 0.2, 0.1], "yaw": 0.0},
            "color": [0.5, 0.5, 0.5],
            "shape": "box",
            "points": 900,
        }
    ],
    "dropped": [{"id": 0, "reason": "the robot"}],
}
"""The keys of perception as JSON, without fields at their default."""
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


def test_the_photo_and_its_segments_become_records_and_json_again() -> None:
    parsed = parse_state(PHOTO)
    (item,) = parsed["objects"]
    assert isinstance(item, TableObject) and item.box.high == (0.5, 0.1, 0.1) and parsed["camera"].fx == 600
    plain = state_as_json(parsed)
    assert plain["objects"][0].items() >= PHOTO["objects"][0].items()
    assert plain["table"]["T_robot_cam"] == PHOTO["table"]["T_robot_cam"]
    assert parse_state(json.loads(json.dumps(plain))) == parsed


def test_the_edge_after_registration_reads_segments_that_a_node_left_as_json() -> None:
    dropped = {**PHOTO, "dropped": [{"id": 1, "reason": "a shadow"}]}
    steps = [next_step_after_register(cast(RunState, left)) for left in (PHOTO, dropped)]
    assert steps == ["describe", "settle"]


def test_a_task_answers_to_the_names_of_its_json(state: RunState) -> None:
    assert state["task"]["task-description"] == state["task"].description


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("task", {"task-name": "t"}),
        ("audit", {"accepted": True}),
        ("history", [{}]),
        ("report", "passed"),
        ("camera", {**PHOTO["camera"], "fx": -1.0}),
        ("table", {**PHOTO["table"], "origin": "the moon"}),
        ("objects", [{**PHOTO["objects"][0], "mask": "../mask.png"}]),
        ("dropped", [{"id": 1}]),
    ],
)
def test_a_value_of_another_type_is_named(key: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"the state's {key}"):
        parse_state({key: value})


def test_the_classes_that_a_checkpoint_may_hold_are_those_of_the_state() -> None:
    hints = get_type_hints(RunState).values()
    named = {kind for hint in hints for kind in (hint, *get_args(hint)) if isinstance(kind, type)}
    assert {kind for kind in named if issubclass(kind, Frozen)} == set(CHECKPOINTED_TYPES)
