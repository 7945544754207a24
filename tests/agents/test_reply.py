"""Replies are parsed strictly, whatever a model says around its answer."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.agents import (
    Match,
    ReplyError,
    TaskDefinition,
    extract_fenced_block,
    extract_python_program,
    parse_json,
    parse_verdict,
)


def test_the_last_block_in_the_language_counts() -> None:
    text = "First try:\n```python\nold = 1\n```\nBetter:\n```python\nnew = 2\n```\nDone."
    assert extract_fenced_block(text, "python") == "new = 2\n"


def test_an_unclosed_block_is_refused() -> None:
    with pytest.raises(ReplyError, match="closed"):
        extract_fenced_block("```python\nnew = 2\n", "python")


def test_prose_alone_is_refused() -> None:
    with pytest.raises(ReplyError, match="no block"):
        extract_python_program("I would rather import nothing.")


def test_a_bare_program_is_a_program() -> None:
    assert extract_python_program("import math\nx = math.pi") == "import math\nx = math.pi\n"


def test_a_broken_program_is_a_version_like_any_other() -> None:
    assert extract_python_program("```python\ndef f(:\n```") == "def f(:\n"


@pytest.mark.parametrize("deep", ["(" * 100_000, "-" * 100_000 + "1", "import a\x00"])
def test_what_the_parser_cannot_hold_is_no_bare_program(deep: str) -> None:
    with pytest.raises(ReplyError):
        extract_python_program(f"import a\nb = {deep}")


def test_json_by_schema() -> None:
    task = parse_json(
        '```json\n{"task-name": "Pack It!", "task-description": "d", "assets-used": ["a"]}\n```', TaskDefinition
    )
    assert task.name == "pack-it"
    assert task.as_json() == {"task-name": "pack-it", "task-description": "d", "assets-used": ["a"]}


@pytest.mark.parametrize(
    "body",
    [
        "[]",
        "{}",
        '{"match": "perhaps"}',
        "{'match': 'asset'}",
        "nonsense",
        '{"match": ' + "[" * 100_000 + "]" * 100_000 + "}",
        '{"match": ' + "9" * 5000 + "}",
        '{"match": "no_asset", "reason": "half a \\ud800 pair"}',
    ],
)
def test_json_off_schema_is_refused(body: str) -> None:
    with pytest.raises(ReplyError):
        parse_json(f"```json\n{body}\n```", Match)


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("The test is wrong.\n```\nfix_test\n```", "fix_test"),
        ('Code.\n```\n"fix_code"\n```', "fix_code"),
        ("Not this:\n```\nfix_code\n```\nbut this:\n```text\nfix_tests\n```", "fix_test"),
    ],
)
def test_verdicts(text: str, verdict: str) -> None:
    assert parse_verdict(text).verdict == verdict


@pytest.mark.parametrize("text", ["fix_code", "```\nmaybe\n```", "```\nfix_code or fix_test\n```", ""])
def test_no_verdict(text: str) -> None:
    with pytest.raises(ReplyError, match="fix_code or fix_test"):
        parse_verdict(text)


def test_the_explanation_is_what_stands_around_the_verdict() -> None:
    assert parse_verdict("The import fails.\n\n```\nfix_test\n```").explanation == "The import fails."


@given(st.text())
def test_any_text_is_parsed_or_refused(text: str) -> None:
    for parse in (extract_python_program, parse_verdict, lambda reply: parse_json(reply, Match)):
        try:
            parse(text)
        except ReplyError as error:
            assert str(error)


@given(st.dictionaries(st.sampled_from(["match", "asset", "reason", "more"]), st.none() | st.text() | st.integers()))
def test_any_object_is_parsed_or_refused(value: dict[str, object]) -> None:
    try:
        found = parse_json(f"```json\n{json.dumps(value)}\n```", Match)
    except ReplyError:
        return
    assert found.match in ("asset", "no_asset", "no_object")
