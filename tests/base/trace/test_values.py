"""Values that are safe to write as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.trace.events import replace_surrogates, summarise_value, to_plain_json

SCALARS = st.none() | st.booleans() | st.floats() | st.integers(-(2**53), 2**53) | st.text()
TREES = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=12)


@given(st.text(st.characters(exclude_categories=())))
def test_any_string_becomes_utf8(text: str) -> None:
    assert replace_surrogates(text).encode("utf-8").decode("utf-8") == replace_surrogates(text)
    assert len(replace_surrogates(text)) == len(text)


@given(TREES)
def test_plain_data_survives_a_file_and_is_plain_already(value: Any) -> None:
    once = to_plain_json(value)
    assert json.loads(json.dumps(once, allow_nan=False)) == once == to_plain_json(once)


def test_tuples_paths_arrays_and_nan_become_json() -> None:
    value = {"size": (1, 2), "file": Path("a/b"), "pose": np.eye(2), "score": float("nan"), "n": np.int64(3)}
    expected = {"size": [1, 2], "file": "a/b", "pose": [[1.0, 0.0], [0.0, 1.0]], "score": "NaN", "n": 3}
    assert to_plain_json(value) == expected


def test_what_is_long_or_deep_is_told_by_its_size() -> None:
    report = {
        "outcome": "failed",
        "cases": [{"id": "a"}, {"id": "b"}],
        "pose": [1.0, 2.0],
        "deep": {"a": {"b": 1}},
    }
    summary = {"outcome": "failed", "cases": "2 items", "pose": [1.0, 2.0], "deep": {"a": "1 fields"}}
    assert summarise_value(report) == summary
    assert summarise_value("class A:\n    pass\n") == "2 lines, 18 characters"
    assert summarise_value({"scene": dict.fromkeys(map(str, range(40)), 0)}) == {"scene": "40 fields"}
    assert summarise_value(3) == 3
    assert summarise_value(float("nan")) == "NaN"


@given(TREES)
def test_a_brief_value_is_plain_and_stays_short(value: Any) -> None:
    summary = summarise_value(value)
    assert to_plain_json(summary) == summary
    assert not isinstance(summary, list) or len(summary) <= 4
