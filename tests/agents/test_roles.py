"""Every role is given exactly what its prompt declares, and all that its model is shown has a bounded length."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.prompt_template import read_prompt_template
from grs_agents.agents.roles import JudgedPrograms, WordsEvidence
from grs_agents.agents.types import NoReply, TaskDefinition, TaskRevision
from grs_agents.base import content
from grs_agents.base.config.schema import Config
from grs_agents.base.trace.log import read_events
from tests.scripted import scripted

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "<task>", "assets-used": ["a"]})
SCENE: dict[str, Any] = {"objects": [{"asset": "a", "name": "<scene>"}]}
JUDGED = JudgedPrograms(TASK, "<scene>", "<code>", "<tests>", "<test_results>", ["<history>"], (), "<explanation>")
EVIDENCE = WordsEvidence("<words>", "<sentence>", ["<other_texts>"], [{"x": "<objects>"}], ["<goals>"], ["<notes>"])
ASKED: dict[str, Callable[[Agents], object]] = {
    "describe": lambda agents: roles.describe_segments(agents, [{"id": 1, "x": "<segments>"}], [1], "<pictures>", []),
    "match": lambda agents: roles.match_segments(
        agents, [{"id": 1, "x": "<segments>"}], [{"name": "<assets>"}], "<pictures>", []
    ),
    "task": lambda agents: roles.author_task(agents, SCENE, [{"name": "<fixtures>"}], [], "<sides>"),
    "simulation": lambda agents: roles.author_simulation(agents, TASK, SCENE, "<api>", "<examples>", []),
    "tests": lambda agents: roles.author_tests(agents, TASK, "<code>", "<api>"),
    "route": lambda agents: roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test")),
    "fix_code": lambda agents: roles.fix_code(agents, JUDGED, "<api>"),
    "fix_tests": lambda agents: roles.fix_tests(agents, JUDGED, "<api>"),
    "fix_task": lambda agents: roles.fix_task(agents, JUDGED, SCENE["objects"], [{"name": "<fixtures>"}]),
    "judge": lambda agents: roles.judge_words(agents, EVIDENCE),
}


@pytest.mark.parametrize("role", ASKED)
def test_a_role_shows_each_input_that_its_prompt_declares(role: str, tmp_path: Path) -> None:
    agents = scripted(tmp_path, ["I would rather not."], Config(reply_retries=0))
    assert isinstance(ASKED[role](agents), NoReply)
    [prompt] = [event for event in read_events(agents.log.path) if event.kind == "prompt"]
    shown = {"verdicts": "fix_code: change the simulation program"}
    for name in read_prompt_template(content.content_path("prompts", role)).inputs:
        assert shown.get(name, f"<{name}>") in prompt.text


def test_every_fixer_sees_what_it_judges() -> None:
    declared = {role: set(read_prompt_template(content.content_path("prompts", role)).inputs) for role in ASKED}
    judged = {"task", "scene", "code", "test_results", "history"}
    assert all(judged <= declared[role] for role in ("route", "fix_code", "fix_tests", "fix_task"))
    assert all("tests" in declared[role] for role in ("route", "fix_code", "fix_tests"))


def describe(tmp_path: Path, reply: str, asked: tuple[int, ...] = (1, 2)) -> object:
    """What the describer comes to of one reply, about some of the segments 1 to 3."""
    agents = scripted(tmp_path, [reply], Config(reply_retries=0))
    return roles.describe_segments(agents, [{"id": number} for number in asked], [1, 2, 3], "", [])


def row(number: int, part_of: object = None, **said: object) -> str:
    words = {"description": "A box.", "color": "white", "shape": "box", "category": "box"}
    return json.dumps({"id": number, "is_object": True, "part_of": part_of, **words, **said})


@pytest.mark.parametrize(("part_of", "read"), [(None, None), ("none", None), (0, None), (-1, None), (1, None), (3, 3)])
def test_what_a_segment_is_a_part_of_is_read_where_it_has_one_meaning(
    tmp_path: Path, part_of: object, read: int | None
) -> None:
    described = describe(tmp_path, f"{row(1, part_of)}\n{row(2)}")
    assert isinstance(described, dict) and described[1].part_of == read


def test_the_describer_is_told_all_that_is_wrong_at_once(tmp_path: Path) -> None:
    outcome = describe(tmp_path, f"{row(1, 9)}\n{row(2, color=7)}", (1, 2, 3))
    assert isinstance(outcome, NoReply)
    for text in ("id 2): color", "no object with the id 3", "segment 1: part_of is 9"):
        assert text in outcome.problem
    assert "id 2," not in outcome.problem


ASSETS = [
    {"name": "HOPE/Milk.urdf"},
    {"name": "HOPE/Tomato_Sauce.urdf"},
    {"name": "a/cup.urdf"},
    {"name": "b/cup.urdf"},
]


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("HOPE/Milk.urdf", "HOPE/Milk.urdf"),
        ("HOPE/Milk", "HOPE/Milk.urdf"),
        ("milk", "HOPE/Milk.urdf"),
        ("Milk.urdf", "HOPE/Milk.urdf"),
        ("tomato sauce", "HOPE/Tomato_Sauce.urdf"),
        ("b/cup", "b/cup.urdf"),
        ("cup", None),
        ("YCB/Milk.urdf", None),
        ("none", None),
        ("..", None),
    ],
)
def test_an_asset_is_found_by_a_name_that_means_no_other(tmp_path: Path, written: str, read: str | None) -> None:
    agents = scripted(tmp_path, [json.dumps({"match": "asset", "asset": written})], Config(reply_retries=0))
    reply = roles.match_segments(agents, [{"id": 7}], ASSETS, "", [])
    assert (None if isinstance(reply, NoReply) else reply[7].asset) == read


@pytest.mark.parametrize(
    ("said", "read"), [(0.9, 0.9), ("0.9", 0.9), ("90 %", 0.9), (90, 0.9), ("high", None), (-1, None)]
)
def test_a_confidence_is_a_share_or_none(tmp_path: Path, said: object, read: float | None) -> None:
    row = {"id": 7, "match": "no_asset", "asset": "none", "confidence": said, "reason": None}
    agents = scripted(tmp_path, [json.dumps(row)], Config(reply_retries=0))
    reply = roles.match_segments(agents, [{"id": 7}], ASSETS, "", [])
    assert not isinstance(reply, NoReply) and reply[7].confidence == read and reply[7].asset is None


def test_the_matcher_is_told_all_that_is_wrong_at_once(tmp_path: Path) -> None:
    rows = [{"id": 1, "match": "asset", "asset": "Mylk"}, {"id": 2, "match": "perhaps"}]
    agents = scripted(tmp_path, ["\n".join(map(json.dumps, rows))], Config(reply_retries=0))
    outcome = roles.match_segments(agents, [{"id": number} for number in (1, 2, 3)], ASSETS, "", [])
    assert isinstance(outcome, NoReply)
    for text in ("segment 1: asset 'Mylk' is not in the list", "HOPE/Milk.urdf", "id 2): match", "with the id 3"):
        assert text in outcome.problem


def test_a_second_reply_joins_the_first(tmp_path: Path) -> None:
    said = {"is_object": True, "color": "red", "shape": "box", "category": "box"}
    first = [{"id": 1, **said, "description": "first"}, {"id": 2, **said, "description": None}]
    second = [{"id": 2, **said, "description": "second"}]
    replies = ["\n".join(map(json.dumps, rows)) for rows in (first, second)]
    agents = scripted(tmp_path, replies, Config(reply_retries=1))
    described = roles.describe_segments(agents, [{"id": 1}, {"id": 2}], [1, 2], "", [])
    assert not isinstance(described, NoReply)
    assert {number: item.description for number, item in described.items()} == {1: "first", 2: "second"}
    matches = [{"id": 1, "match": "no_asset"}, {"id": 2, "match": "asset", "asset": "Mylk"}]
    mended = {"id": 2, "match": "asset", "asset": "milk"}
    agents = scripted(tmp_path, ["\n".join(map(json.dumps, matches)), json.dumps(mended)], Config(reply_retries=1))
    matched = roles.match_segments(agents, [{"id": 1}, {"id": 2}], ASSETS, "", [])
    assert not isinstance(matched, NoReply)
    assert [matched[number].asset for number in (1, 2)] == [None, "HOPE/Milk.urdf"]


def _ask_weak_model(role: str, agents: Agents) -> object:
    rows = [{"id": number, "box": [10, 10, 50, 50]} for number in (1, 2)]
    asked: dict[str, Callable[[], object]] = {
        "describe": lambda: roles.describe_segments(agents, rows, [1, 2], "", []),
        "match": lambda: roles.match_segments(agents, rows[:1], ASSETS, "", []),
        "group": lambda: roles.group_segments(agents, rows, (640, 480), "", []),
        "task": lambda: roles.author_task(agents, {"objects": []}, ASSETS, []),
        "judge": lambda: roles.judge_words(agents, EVIDENCE),
        "route": lambda: roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test")),
    }
    return asked[role]()


CAN = '"description": "A can", "color": null, "shape": "cylinder", "category": "can"'


@pytest.mark.parametrize(
    ("role", "reply"),
    [
        ("describe", f'```\n{{"1": {{"isObject": "yes", {CAN}}}, "2": {{"is_object": false}}}}\n```'),
        ("describe", f'{{"segment_id": 1, "is_object": true, {CAN}}}\n{{"segmentId": "2", "is_object": "robot"}}'),
        ("describe", f"[{{'id': 1, 'isObject': True, {CAN},}}, // a can\n{{'id': 2, 'isObject': False}},]\nDone!"),
        ("match", '```json\n{"id": 1, "asset": "HOPE/Milk.urdf", "confidence": "95%"}\n```'),
        ("match", '{"segment": 1, "match": "no asset", "asset": "None", "confidence": "high"}'),
        ("group", "{'merge': [1, 2], 'split': {}, 'drop': {'segment': 1, 'what': 'robot'}, 'missing': None}"),
        ("task", '{"name": "t", "description": "d", "assets": [{"name": "HOPE/Milk.urdf"}, {"asset": "a/cup.urdf"}]}'),
        ("task", 'Here:\n{"taskName": "t", "taskDescription": "d", "assetsUsed": "milk, HOPE/Tomato_Sauce.urdf",}'),
        ("judge", '```json\n{"explanation": "The can stays.", "verdict": "Disagrees"}\n```'),
        ("judge", "They agree.\n{'verdict': 'agree', 'reason': 'all of it',}"),
        ("route", '```json\n{"verdict": "fix_test"}\n```'),
        ("route", '{"verdict": "FIX-CODE"}'),
    ],
)
def test_what_a_weak_model_says_is_not_refused_for_its_form(tmp_path: Path, role: str, reply: str) -> None:
    outcome = _ask_weak_model(role, scripted(tmp_path, [reply], Config(reply_retries=0)))
    assert not isinstance(outcome, NoReply), outcome


def test_a_task_may_name_assets_as_the_photo_shows_them(tmp_path: Path) -> None:
    objects = [{"asset": "proxy/red.urdf", "name": f"red_cube_{number}"} for number in (1, 2)]
    said = {"task-name": "t", "task-description": "d", "assets-used": ["red_cube_1", "Red cube 2", "milk"]}
    agents = scripted(tmp_path, [json.dumps(said)], Config(reply_retries=0))
    task = roles.author_task(agents, {"objects": objects}, ASSETS, [])
    assert isinstance(task, TaskDefinition) and task.assets == ("proxy/red.urdf", "HOPE/Milk.urdf")


def test_all_unknown_assets_are_told_with_those_that_are_near(tmp_path: Path) -> None:
    said = {"task-name": "t", "task-description": "d", "assets-used": ["Mylk.urdf", "HOPE/Milk.urdf", "xyz"]}
    agents = scripted(tmp_path, [json.dumps(said)], Config(reply_retries=0))
    outcome = roles.author_task(agents, {"objects": []}, ASSETS, [])
    assert isinstance(outcome, NoReply) and "'Mylk.urdf', 'xyz'" in outcome.problem
    assert "HOPE/Milk.urdf" in outcome.problem


@pytest.mark.parametrize(
    ("reply", "changed", "given_up"),
    [
        ({"task-description": "Put b into c."}, {"task-description": "Put b into c."}, "nothing was given up"),
        ({"task_description": "Put b."}, {"task-description": "Put b."}, "nothing was given up"),
        ({"assets-used": None, "given-up": "c stays"}, {}, "c stays"),
    ],
)
def test_a_revision_keeps_what_it_leaves_out(
    reply: dict[str, Any], changed: dict[str, Any], given_up: str, tmp_path: Path
) -> None:
    agents = scripted(tmp_path, [f"```json\n{json.dumps(reply)}\n```"], Config(reply_retries=0))
    revision = roles.fix_task(agents, JUDGED, SCENE["objects"], [])
    assert isinstance(revision, TaskRevision)
    assert revision.as_json() == {**TASK.as_json(), **changed, "given-up": given_up}


def test_a_revision_of_nothing_is_refused(tmp_path: Path) -> None:
    agents = scripted(tmp_path, ['```json\n{"task": "Put b."}\n```'], Config(reply_retries=0))
    assert isinstance(roles.fix_task(agents, JUDGED, SCENE["objects"], []), NoReply)
