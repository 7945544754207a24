"""Of a reply the answer alone is read, whatever a model says around it, and all that is wrong with it is told."""

import json
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.agents.reply import (
    ReplyError,
    extract_python_program,
    extract_test_program,
    join_problems,
    list_problems,
    parse_json,
    parse_verdict,
    read_json_rows,
)
from grs_agents.agents.types import Match, SegmentReply, TaskDefinition

ANSWER = '{"match": "no_asset", "reason": "answer"}'
DRAFT = '```json\n{"match": "no_object", "reason": "draft"}\n```'
PROGRAM = "import math\n\n\nclass Wanted(Task):\n    pass\n"


def match(text: str) -> str:
    """The reason in a reply of the matcher."""
    return parse_json(text, Match).reason


def row(number: int, **said: Any) -> str:
    words = {"description": "A box.", "color": "white", "shape": "box", "category": "box"}
    return json.dumps({"id": number, "is_object": True, "part_of": None, **words, **said})


THOUGHTS = {
    "think": f"<think>\n{DRAFT}\nNo.\n</think>\n\n{{}}",
    "without its beginning": f"Hm.\n{DRAFT}\nNo.\n</think>\n\n{{}}",
    "in one line": "<think>So.</think>{}",
    "without its beginning, in one line": "So.</think>{}",
    "in capitals": f"<Think>{DRAFT}</Think>\n{{}}",
    "thinking": f"<thinking>\n{DRAFT}\n</thinking>\n{{}}",
    "reasoning": f"<reasoning>\n{DRAFT}\n</reasoning>\n{{}}",
    "thought": f"<thought>\n{DRAFT}\n</thought>\n{{}}",
    "of Seed-OSS": f"<seed:think>\n{DRAFT}\n</seed:think>\n{{}}",
    "nested": f"<think>\nSo\n<think>\n{DRAFT}\n</think>\nand so\n</think>\n{{}}",
    "begun twice": f"<think>\n<think>\n{DRAFT}\n</think>\n{{}}",
    "twice": f"<think>\n{DRAFT}\n</think>\n<think>\n{DRAFT}\n</think>\n{{}}",
    "of an unclosed draft": '<think>\n```json\n{"match": \nno\n</think>\n{}',
    "of an unclosed draft, without its beginning": '```json\n{"match": \nno\n</think>\n\n{}',
    "after a word": f"Sure.\n<think>\n{DRAFT}\n</think>\n{{}}",
    "after the answer": f"{{}}\n<think>\n{DRAFT}\n</think>",
    "unclosed after the answer": f"{{}}\n<think>\n{DRAFT}",
    "with CRLF": f"<think>\n{DRAFT}\n</think>\n\n{{}}".replace("\n", "\r\n"),
    "of Magistral": f"[THINK]\n{DRAFT}\n[/THINK]{{}}",
    "of Kimi": f"◁think▷\n{DRAFT}\n◁/think▷{{}}",
    "of Cohere": f"<|START_THINKING|>{DRAFT}<|END_THINKING|><|START_RESPONSE|>{{}}<|END_RESPONSE|>",
    "of Gemma": f"<|channel>thought\n{DRAFT}\n<channel|>{{}}",
    "of Granite": f"Here is my thought process:\n{DRAFT}\nHere is my response:\n{{}}",
    "of gpt-oss": (
        f"<|channel|>analysis<|message|>{DRAFT}<|end|><|start|>assistant<|channel|>final<|message|>{{}}<|return|>"
    ),
    "of gpt-oss, constrained": (
        f"<|start|>assistant<|channel|>analysis<|message|>{DRAFT}<|end|><|start|>assistant<|channel|>commentary"
        f"<|message|>{DRAFT}<|end|><|start|>assistant<|channel|>final <|constrain|>json<|message|>{{}}<|return|>"
    ),
    "of gpt-oss, without its tokens": f"analysisSo.\n{DRAFT}\nassistantfinal{{}}",
}


@pytest.mark.parametrize("fenced", [False, True], ids=["bare", "fenced"])
@pytest.mark.parametrize("kind", THOUGHTS)
def test_thoughts_are_no_answer(kind: str, fenced: bool) -> None:
    answer = f"\n```json\n{ANSWER}\n```\n" if fenced else ANSWER
    assert match(THOUGHTS[kind].replace("{}", answer)) == "answer"


@pytest.mark.parametrize("text", ["<think>\nSo.", f"<think>\n{DRAFT}", f"{DRAFT}\n</think>\n", "[THINK]So.[/THINK]"])
def test_thoughts_alone_are_refused_as_such(text: str) -> None:
    for parse in (match, extract_python_program, parse_verdict):
        with pytest.raises(ReplyError, match=rf"thoughts alone, {len(text)} characters"):
            parse(text)


MARKS_IN_ANSWERS = [
    "label = '<think>'",
    'label = "</think>"',
    'label = "a </think> b"',
    'label = """\n<think>\nso\n</think>\n"""',
    'label = """\n</think>\n"""',
    "# no <think> and no </think> here",
]


@pytest.mark.parametrize("line", MARKS_IN_ANSWERS)
@pytest.mark.parametrize("before", ["", "<think>\nI write no </think> early.\n</think>\n", "Without `</think>`:\n"])
@pytest.mark.parametrize("after", ["", "\nIt prints:\n```\nOK\n```\n", "\nI used no `<think>` tags."])
def test_a_program_keeps_the_marks_of_thoughts_in_it(before: str, line: str, after: str) -> None:
    program = f"{PROGRAM}\n\n{line}\n"
    assert extract_python_program(f"{before}```python\n{program}```{after}") == program


@pytest.mark.parametrize("reason", ["<think>", "a </think> b", "it reads </think>", "</think> it reads"])
def test_json_keeps_the_marks_of_thoughts_in_it(reason: str) -> None:
    said = json.dumps({"match": "no_asset", "reason": reason})
    assert match(said) == match(f"```json\n{said}\n```") == match(f"<think>so</think>\n{said}") == reason


def test_a_fence_with_an_info_string_closes_no_block() -> None:
    assert match(f"```json\n{ANSWER}\n```\nAs in\n```text\n```json, then </think> in a line\n```\n") == "answer"


def test_an_explanation_holds_no_thoughts() -> None:
    reply = parse_verdict("<think>\n```\nfix_code\n```\n</think>\nThe test is wrong.\n```\nfix_test\n```<|im_end|>")
    assert (reply.verdict, reply.explanation) == ("fix_test", "The test is wrong.")


FENCES = {
    "CRLF": "```json\n{}\n```\n".replace("\n", "\r\n"),
    "tildes": "~~~json\n{}\n~~~",
    "longer": "````json\n{}\n````",
    "closed by a longer one": "```json\n{}\n`````",
    "indented": "   ```json\n   {}\n   ```",
    "in a list": "1. This one:\n\n    ```json\n    {}\n    ```\n",
    "with tabs": "-\tIt:\n\t```json\n\t{}\n\t```\n",
    "with blanks after it": "```json  \n{}\n```  \n",
    "blank before the tag": "``` json\n{}\n```",
    "unclosed": "Here:\n```json\n{}",
    "closed in the last line": "```json\n{}```",
    "in one line": "```json {}```",
    "attributes": '```json title="a.json"\n{}\n```',
    "pandoc": "```{.json .numberLines}\n{}\n```",
    "capitals": "```JSON\n{}\n```",
    "no tag": "```\n{}\n```",
    "another tag": "```javascript\n{}\n```",
    "bare after words": "Here it is:\n\n{}\n\nDone.",
    "in a tag": "<answer>{}</answer>",
    "an end token": "```json\n{}\n```<|im_end|>",
    **{tag: f"```{tag}\n{{}}\n```" for tag in ("jsonl", "json5", "jsonc", "ndjson", "jsonlines")},
}


@pytest.mark.parametrize("kind", FENCES)
def test_a_fenced_block_is_found_as_commonmark_does(kind: str) -> None:
    assert match(FENCES[kind].replace("{}", ANSWER)) == "answer"


@pytest.mark.parametrize(
    "tag", ["python", "python3", "py", "py3", "Python", "ipython", "ipython3", "python3.11", 'python title="a.py"', ""]
)
def test_a_program_is_found_under_each_tag_of_python(tag: str) -> None:
    assert extract_python_program(f"```{tag}\n{PROGRAM}```\n") == PROGRAM


def test_the_fences_of_an_indented_block_are_taken_off_its_lines() -> None:
    indented = "".join(f"   {line}" for line in f"```python\n{PROGRAM}```\n".splitlines(True))
    assert extract_python_program(f"1. The program:\n\n{indented}") == PROGRAM


def test_a_fence_within_a_program_does_not_end_it() -> None:
    program = f'{PROGRAM}\n\ndef helped():\n    """\n    ```\n    example\n    ```\n    """\n'
    assert extract_python_program(f"```python\n{program}```\n") == program
    assert extract_python_program(program) == program


@pytest.mark.parametrize(
    "text",
    [
        "```python\n{}```\n\nOutput when it is run:\n```\nOK\n```\n",
        "```python\n{}```\nUse it:\n```python\ntask = Wanted()\n```\n",
        "```bash\npip install numpy\n```\n```\n{}```\n```text\nOK\n```",
        "```python\nimport math\n```\nThe whole program:\n```simulation.py\n{}```\n",
        "First try:\n```python\nclass Old(Task):\n    pass\n```\nBetter:\n```python\n{}```\nDone.",
    ],
)
def test_of_several_blocks_the_one_with_the_task_is_the_program(text: str) -> None:
    assert extract_python_program(text.replace("{}", PROGRAM)) == PROGRAM


def test_of_several_blocks_the_one_with_test_cases_is_the_test_script() -> None:
    tests = "import unittest\n\n\nclass TestWanted(unittest.TestCase):\n    pass\n"
    text = f"```python\n{tests}```\nfor this program:\n```python\n{PROGRAM}```\n"
    assert (extract_test_program(text), extract_python_program(text)) == (tests, PROGRAM)


BARE = "class Wanted(Task):\n    pass\n"


@pytest.mark.parametrize(
    "text",
    [
        f"Sure, here it is.\n\n{PROGRAM}\nI hope that it helps.",
        json.dumps({"code": PROGRAM}),
        f"```python import math\n\n\n{BARE}```",
        f"The imports:\n```python\nimport math\n```\nThe class:\n```python\n{BARE}```",
        f"```\n{PROGRAM}```\nRun it:\n```bash\npython -m unittest\n```",
    ],
    ids=["no fence", "JSON", "code beside the fence", "imports apart", "no language"],
)
def test_a_program_in_a_sloppy_form_is_read_whole(text: str) -> None:
    assert extract_python_program(text) == PROGRAM


def test_an_import_in_another_block_is_not_put_before_a_program_with_imports() -> None:
    assert extract_python_program(f"```python\nimport os\n```\nBetter:\n```python\n{PROGRAM}```") == PROGRAM


def test_of_several_objects_the_last_of_the_type_that_is_asked_for_counts() -> None:
    text = f'{DRAFT}\nBetter:\n```json\n{ANSWER}\n```\nfor example\n```json\n{{"seen": ["MILK"]}}\n```'
    assert match(text) == "answer"


@pytest.mark.parametrize(
    "form",
    [
        "```json\n{1}\n{2}\n```",
        "```json\n[{1}, {2}]\n```",
        "```json\n{1},\n{2},\n```",
        "[\n{1},\n{2}\n]",
        '```json\n{"segments": [{1}, {2}]}\n```',
        "Segment 1:\n```json\n{1}\n```\nSegment 2:\n```json\n{2}\n```",
        "```json\n{2}\n```\n```json\n{1}\n{0}\n```",
    ],
)
def test_rows_are_read_in_each_form(form: str) -> None:
    old = row(2, color="old")
    text = form.replace("{0}", row(2)) if "{0}" in form else form
    text = text.replace("{1}", row(1)).replace("{2}", old if "{0}" in form else row(2))
    rows = read_json_rows(text, SegmentReply)
    assert not list_problems(rows)
    assert {row.parsed.id: row.parsed.color for row in rows if row.parsed} == {1: "white", 2: "white"}


WEAK = [
    '{"match": "no_asset", "asset": None, "reason": "answer"}',
    "{'match': 'no_asset', 'asset': 'none', 'reason': 'answer'}",
    '{"match": "no_asset", "asset": "null", "reason": "answer",}',
    '{match: "no_asset", reason: "answer"}',
    '{\n  "match": "no_asset", // none fits\n  "reason": "answer" # so\n  /* and so */\n}',
    '{"Match": "No asset", "Reason": "answer"}',
    '{"match": "NO-ASSET", "reason": "answer", "sure": True}',
    '[{"match": "no_asset", "reason": "answer"}]',
]


@pytest.mark.parametrize("written", WEAK)
def test_json_of_a_weak_model_is_read_where_it_has_one_meaning(written: str) -> None:
    assert match(f"```json\n{written}\n```") == "answer"
    assert parse_json(written, Match).asset is None


def test_quotes_in_texts_are_kept() -> None:
    assert match("{'match': 'no_asset', 'reason': 'It\\'s \"MILK\"'}") == 'It\'s "MILK"'
    assert match('{"match": "no_asset", "reason": "It\\\'s // \'MILK\', True",}') == "It's // 'MILK', True"


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ({"part_of": "none"}, None),
        ({"part_of": "Null"}, None),
        ({"part_of": "n/a"}, None),
        ({"part_of": "3"}, 3),
        ({"part_of": "segment 3"}, 3),
        ({"part_of": "#3"}, 3),
        ({"partOf": 3.0}, 3),
    ],
)
def test_a_segment_number_is_read_where_it_has_one_meaning(written: dict[str, Any], read: int | None) -> None:
    plain = json.loads(row(1))
    del plain["part_of"]
    assert parse_json(json.dumps(plain | written), SegmentReply).part_of == read


def test_words_about_no_object_may_be_missing() -> None:
    for said in ({}, {"description": None, "color": None}, {"description": ""}):
        reply = parse_json(json.dumps({"id": 1, "is_object": False, **said}), SegmentReply)
        assert not reply.is_object and reply.description
    with pytest.raises(ReplyError, match="description is missing"):
        parse_json('{"id": 1, "is_object": true}', SegmentReply)


@pytest.mark.parametrize(
    ("word", "is_object", "shows", "part_of"),
    [
        ("several things", True, "several", None),
        ("Multiple", True, "several", None),
        ("part of 3", False, "", 3),
        ("a piece of segment 12", False, "", 12),
        ("robot arm", False, "robot", None),
        ("the background", False, "background", None),
        ("Nothing", False, "nothing", None),
    ],
)
def test_an_honest_word_in_place_of_true_or_false_is_read(
    word: str, is_object: bool, shows: str, part_of: int | None
) -> None:
    for said in ({}, json.loads(row(1)) | {"part_of": part_of}):
        reply = parse_json(json.dumps({"id": 1, **said, "is_object": word}), SegmentReply)
        assert (reply.is_object, reply.shows, reply.part_of) == (is_object, shows, part_of)


@pytest.mark.parametrize("fence", ["```json\n{}\n```", "{}", "```json\n[{}]\n```"])
def test_all_that_is_wrong_is_told_at_once(fence: str) -> None:
    rows = [
        row(1, is_object="perhaps", part_of="the mug"),
        row(2),
        row(3).replace(', "shape"', ' "shape"'),
        row(4, color=7),
    ]
    comma = "," if "[" in fence else ""
    problems = list_problems(read_json_rows(fence.replace("{}", f"{comma}\n".join(rows)), SegmentReply))
    places = [problem.partition(":")[0] for problem in problems]
    assert places == ["object 1 (id 1)"] * 2 + ["object 3", "object 4 (id 4)"]
    assert "is_object" in problems[0] and "'perhaps'" in problems[0] and "'the mug'" in problems[1]
    assert "not JSON" in problems[2] and '"shape"' not in problems[1] and "color" in problems[3]


def test_very_many_problems_are_cut_short() -> None:
    rows = read_json_rows("\n".join(["{}"] * 20 + [row(9, color=7)] * 40), SegmentReply)
    text = join_problems(list_problems(rows))
    assert re.search(r"and \d+ more$", text)
    assert len(text) < 4000


@pytest.mark.parametrize(
    "body",
    [
        "[]",
        "{}",
        '{"match": "perhaps"}',
        "{'match': 'asset'",
        "nonsense",
        '{"match": ' + "[" * 100_000 + "]" * 100_000 + "}",
        '{"match": ' + "9" * 5000 + "}",
        '{"match": "no_asset", "reason": "half a \\ud800 pair"}',
        '{"match": "no_asset", "reason": "It says "MILK""}',
        "{'match': 'no_asset', 'reason': 'It's MILK'}",
        f"{ANSWER}\n{ANSWER}",
    ],
)
def test_what_is_no_json_or_has_several_meanings_is_refused(body: str) -> None:
    with pytest.raises(ReplyError):
        parse_json(f"```json\n{body}\n```", Match)


def test_json_by_schema() -> None:
    task = parse_json(
        '```json\n{"task-name": "Pack It!", "task-description": "d", "assets-used": ["a"]}\n```', TaskDefinition
    )
    assert task.name == "pack-it"
    assert task.as_json() == {"task-name": "pack-it", "task-description": "d", "assets-used": ["a"]}
    spelt = '{"task_name": "Pack It!", "taskDescription": "d", "Assets used": ["a"]}'
    assert parse_json(spelt, TaskDefinition) == task


def test_an_endless_reply_is_not_read() -> None:
    with pytest.raises(ReplyError, match="at most 1,048,576"):
        extract_python_program("```\n" * 300_000)


def test_prose_alone_is_refused() -> None:
    with pytest.raises(ReplyError, match="no block"):
        extract_python_program("I would rather import nothing.")


def test_a_bare_program_is_a_program() -> None:
    assert extract_python_program("import math\nx = math.pi") == "import math\nx = math.pi\n"


def test_a_broken_program_is_a_version_like_any_other() -> None:
    assert extract_python_program("```python\ndef f(:\n```") == "def f(:\n"


@pytest.mark.parametrize(
    "text", ["```python\n```", "```bash\nls\n```", "```python\n", '{"why": "", "code": "import a"}']
)
def test_a_reply_without_a_program_is_refused(text: str) -> None:
    with pytest.raises(ReplyError):
        extract_python_program(text)


@pytest.mark.parametrize("deep", ["(" * 100_000, "-" * 100_000 + "1", "import a\x00"])
def test_what_the_parser_cannot_hold_is_no_bare_program(deep: str) -> None:
    with pytest.raises(ReplyError):
        extract_python_program(f"import a\nb = {deep}")


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("The test is wrong.\n```\nfix_test\n```", "fix_test"),
        ('Code.\n```\n"fix_code"\n```', "fix_code"),
        ("Not this:\n```\nfix_code\n```\nbut this:\n```text\nfix_tests\n```", "fix_test"),
        ("Code.\r\n```\r\nfix_code\r\n```\r\n", "fix_code"),
        ("Code.\n```fix_code```", "fix_code"),
        ("Code.\n```\nFIX_CODE", "fix_code"),
        ("fix_code", "fix_code"),
        ("Code.\n```\nVerdict: fix_code (the tests are right)\n```", "fix_code"),
        ("They ask for too much, so my final answer is `fix_test`.", "fix_test"),
    ],
)
def test_verdicts(text: str, verdict: str) -> None:
    assert parse_verdict(text).verdict == verdict


@pytest.mark.parametrize(
    "text",
    [
        "fix_code or fix_test",
        "My answer is not fix_code or fix_test.",
        "So the verdict cannot be fix_code.",
        "```\nmaybe\n```",
        "```\nfix_code or fix_test\n```",
        "",
    ],
)
def test_no_verdict(text: str) -> None:
    with pytest.raises(ReplyError, match="fix_code or fix_test"):
        parse_verdict(text)


def test_the_explanation_is_what_stands_around_the_verdict() -> None:
    assert parse_verdict("The import fails.\n\n```\nfix_test\n```").explanation == "The import fails."


PIECES = st.sampled_from(
    [
        "<think>",
        "</think>",
        "```",
        "```json\n",
        "\n",
        "~~~",
        "{",
        "}",
        "[",
        '"',
        "'",
        "\\",
        "//",
        "/*",
        "a",
        ", ",
        "True",
    ]
)


@given(st.text() | st.lists(PIECES).map("".join))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    for parse in (extract_python_program, parse_verdict, match, lambda reply: read_json_rows(reply, SegmentReply)):
        try:
            parse(text)
        except ReplyError as error:
            assert str(error)


@given(st.dictionaries(st.sampled_from(["match", "asset", "reason", "more"]), st.none() | st.text() | st.integers()))
def test_any_object_is_parsed_or_refused(value: dict[str, object]) -> None:
    try:
        parsed = parse_json(f"```json\n{json.dumps(value)}\n```", Match)
    except ReplyError:
        return
    assert parsed.match in ("asset", "no_asset", "no_object")


@given(st.text(), st.text(alphabet="<>/think \n`'\""))
def test_json_is_read_as_it_was_written(reason: str, odd: str) -> None:
    said = {"match": "no_asset", "reason": reason + odd}
    assert parse_json(f"```json\n{json.dumps(said)}\n```", Match).reason == reason + odd
    assert parse_json(f"{json.dumps(said)[:-1]},}}", Match).reason == reason + odd


@pytest.mark.parametrize(
    "text",
    [
        "It fails.\n```\nverdict: fix_code\n```",
        "It fails.\n\n**Verdict:** fix_code",
        "It fails.\n```\nVerdict = `fix_code`.\n```",
    ],
)
def test_a_verdict_is_read_where_it_stands_by_itself(text: str) -> None:
    reply = parse_verdict(text)
    assert (reply.verdict, reply.explanation) == ("fix_code", "It fails.")


def test_a_verdict_within_a_sentence_is_none() -> None:
    with pytest.raises(ReplyError, match="exactly one of the verdicts"):
        parse_verdict("I would say fix_code here.")
