"""Conditions over the columns of a batch."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.runs.batch.row import BatchRow
from grs_agents.runs.batch.selection import select_rows

ROWS = [
    BatchRow(run="a", scene="s", seed=0, status="accepted", reason="", reward=1.0, code_fixes=2, goals=("on A -> B",)),
    BatchRow(run="b", scene="s", seed=1, status="rejected", reason="tests failed", reward=0.5),
    BatchRow(run="c", scene="t", seed=2, status="failed", reason="no photo"),
]


@pytest.mark.parametrize(
    ("condition", "runs"),
    [
        ('status == "accepted"', "a"),
        ('status in ("accepted", "failed") and not scene == "t"', "a"),
        ("reward >= 0.5", "ab"),  # a run without a reward is not among them
        ("reward == None", "c"),
        ("0 < seed <= 2 or code_fixes > 1", "abc"),
        ('"tests" in reason', "b"),
        ('"on A -> B" in goals', "a"),
    ],
)
def test_a_condition_selects(condition: str, runs: str) -> None:
    assert "".join(row.run for row in select_rows(ROWS, condition)) == runs


@pytest.mark.parametrize(
    "condition",
    ["", "status =", "__import__('os').system('true')", "status.upper() == 'A'", "seed < 'a'", "sead == 1", "seed + 1"],
)
def test_what_is_no_condition_is_refused(condition: str) -> None:
    with pytest.raises(InputError):
        select_rows(ROWS, condition)


@given(st.text(max_size=40))
def test_any_text_selects_or_is_refused(text: str) -> None:
    try:
        assert set(select_rows(ROWS, text)) <= set(ROWS)
    except InputError as error:
        assert error.remedy
