"""Replies by a JSON schema, over the wire of a real client, and the way back to text."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.prompt_template import read_prompt_template
from grs_agents.agents.reply_schema import reply_schema
from grs_agents.agents.roles import JudgedPrograms
from grs_agents.agents.types import Description, Grouping, Match, NoReply, RouterReply, TaskDefinition, WordsJudgement
from grs_agents.base import content
from grs_agents.base.config.load import validate_config
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import GrsError
from grs_agents.base.trace.events import Note, Prompt, Reply
from grs_agents.base.trace.log import EventLog, read_events
from tests.chat_server import Answer, Json, chat_server, completion
from tests.needs import needs

TASK: Json = {"task-name": "t", "task-description": "d", "assets-used": ["a"]}
SEGMENT: Json = {
    "is_object": True,
    "part_of": None,
    "description": "a red can",
    "color": "red",
    "shape": "cylinder",
    "category": "can",
    "open_top": False,
    "boxes": [],
}
REPLIES: dict[str, Json] = {
    "describe": {"segments": [{**SEGMENT, "id": 3}]},
    "group": {"merge": [[1, 2]], "split": [], "drop": [], "missing": []},
    "match": {"segments": [{"id": 3, "match": "asset", "asset": "a", "confidence": 0.9, "reason": "red"}]},
    "task": TASK,
    "route": {"explanation": "The oracle falls short.", "verdict": "fix_code"},
    "fix_task": {**TASK, "given-up": "the lid"},
    "judge": {"verdict": "agrees", "reason": "it does"},
}
pytestmark = needs("langchain_openai")
USAGE = {"prompt_tokens": 11, "completion_tokens": 5, "total_tokens": 16}


def judged() -> JudgedPrograms:
    """The inputs of the router and of a fixer."""
    return JudgedPrograms(TaskDefinition.model_validate(TASK), "{}", "", "", "failed: 0 of 1 tests passed", [])


ASK: dict[str, Callable[[Agents], Any]] = {
    "describe": lambda agents: roles.describe_segments(agents, [{"id": 3}], [3], "none", []),
    "group": lambda agents: roles.group_segments(
        agents, [{"id": number, "box": [1, 2, 3, 4]} for number in (1, 2)], (640, 480), "none", []
    ),
    "match": lambda agents: roles.match_segments(agents, [{"id": 3}], [{"name": "a"}], "(none)", []),
    "task": lambda agents: roles.author_task(agents, {"objects": [{"asset": "a"}]}, [], [], ""),
    "route": lambda agents: roles.decide_what_to_fix(agents, judged(), ("fix_code", "fix_test")),
    "fix_task": lambda agents: roles.fix_task(agents, judged(), [{"asset": "a"}], []),
    "judge": lambda agents: roles.judge_words(agents, roles.WordsEvidence("w", "s", [], [], [])),
}
MEANT: dict[str, Any] = {
    "describe": {3: Description.model_validate(SEGMENT)},
    "group": Grouping(merge=((1, 2),), split=(), drop=(), missing=()),
    "match": {3: Match(match="asset", asset="a", confidence=0.9, reason="red")},
    "task": TaskDefinition.model_validate(TASK),
    "route": RouterReply(verdict="fix_code", explanation="The oracle falls short."),
    "judge": WordsJudgement(verdict="agrees", reason="it does"),
}


def role_of(body: Json) -> str:
    """The role that a request is for."""
    return str(body["messages"][0]["content"]).split("\n", 1)[0].removeprefix("# Role: ").strip()


def as_text(role: str) -> str:
    """The reply of a role in the form that its prompt asks for."""
    if role == "route":
        return "The oracle falls short.\n```\nfix_code\n```"
    rows = [json.dumps(row) for row in REPLIES[role].get("segments", [REPLIES[role]])]
    return "\n".join(("Here it is:", "```json", *rows, "```"))


class Server:
    """A server of chat completions that treats a JSON schema in one of several ways.

    Attributes:
        bodies: what it was asked.
        way: `honours`, `refuses` (status 400), `ignores` (answers in text), `cuts` (finish reason length) or `fails`.
    """

    def __init__(self, way: str) -> None:
        self.way = way
        self.bodies: list[Json] = []

    def answer(self, body: Json, _: str) -> Answer:
        """JSON in the schema's form, its refusal, or text."""
        self.bodies.append(body)
        role, sent = role_of(body), "response_format" in body
        if self.way == "fails" or (sent and self.way == "refuses"):
            error = {"message": "response_format json_schema is not supported", "type": "invalid_request_error"}
            return 400, {}, json.dumps({"error": error}).encode()
        text = json.dumps(REPLIES[role]) if sent and self.way != "ignores" else as_text(role)
        cut = self.way == "cuts" and len(self.bodies) == 1
        return 200, {}, json.dumps(completion({"content": text}, USAGE, "length" if cut else "stop")).encode()


def agents_of(url: str, folder: Path, **model: Any) -> Agents:
    """Agents whose every role is served over the wire."""
    spec = {"model": "openai:any", "base_url": url, "timeout": 20, **model}
    config = validate_config({**Config().model_dump(), "models": {"default": spec}})
    return Agents(config, EventLog(folder / "events.jsonl"), folder)


def logged(agents: Agents) -> list[Reply]:
    """The replies in the log."""
    return [event for event in read_events(agents.log.path) if isinstance(event, Reply)]


@pytest.mark.parametrize("role", [role for role in REPLIES if role != "fix_task"])
def test_a_provider_with_structured_output_is_sent_the_schema(tmp_path: Path, role: str) -> None:
    server = Server("honours")
    with chat_server(server.answer) as url:
        agents = agents_of(url, tmp_path)
        assert ASK[role](agents) == MEANT[role]
    [body] = server.bodies
    schema = body["response_format"]["json_schema"]
    assert (body["response_format"]["type"], schema["strict"]) == ("json_schema", True)
    assert set(REPLIES[role]) == set(schema["schema"]["required"]) == set(schema["schema"]["properties"])
    [reply] = logged(agents)
    assert json.loads(reply.text) == REPLIES[role]
    assert (reply.finish_reason, reply.input_tokens, reply.output_tokens) == ("stop", 11, 5)


@pytest.mark.parametrize("role", REPLIES)
def test_a_provider_that_refuses_the_schema_is_asked_for_text_and_remembered(tmp_path: Path, role: str) -> None:
    server = Server("refuses")
    with chat_server(server.answer) as url:
        agents = agents_of(url, tmp_path)
        outcomes = [ASK[role](agents) for _ in range(2)]
    assert outcomes[0] == outcomes[1] and not isinstance(outcomes[0], NoReply)
    assert ["response_format" in body for body in server.bodies] == [True, False, False]
    assert [(reply.text, reply.error) for reply in logged(agents)] == [(as_text(role), "")] * 2
    notes = [event.text for event in read_events(agents.log.path) if isinstance(event, Note)]
    assert len(notes) == 1 and "openai:any" in notes[0] and "not supported" in notes[0]


@pytest.mark.parametrize("role", REPLIES)
def test_a_reply_in_text_despite_the_schema_is_read_as_text(tmp_path: Path, role: str) -> None:
    server = Server("ignores")
    with chat_server(server.answer) as url:
        agents = agents_of(url, tmp_path)
        assert not isinstance(ASK[role](agents), NoReply)
    assert len(server.bodies) == 1


def test_a_reply_that_is_cut_off_is_kept_and_asked_for_again(tmp_path: Path) -> None:
    server = Server("cuts")
    with chat_server(server.answer) as url:
        agents = agents_of(url, tmp_path)
        assert ASK["task"](agents) == MEANT["task"]
    cut, whole = logged(agents)
    assert (cut.text, cut.finish_reason, cut.output_tokens) == (json.dumps(TASK), "length", 5)
    assert "cut off" in cut.error and not whole.error


def test_a_refusal_for_another_reason_is_told_as_it_is(tmp_path: Path) -> None:
    server = Server("fails")
    with chat_server(server.answer) as url, pytest.raises(GrsError, match="answers 400"):
        ASK["task"](agents_of(url, tmp_path))
    assert ["response_format" in body for body in server.bodies] == [True, False]


def test_structured_output_can_be_switched_off(tmp_path: Path) -> None:
    server = Server("honours")
    with chat_server(server.answer) as url:
        assert ASK["task"](agents_of(url, tmp_path, structured="off")) == MEANT["task"]
    assert "response_format" not in server.bodies[0]


def test_of_several_models_each_is_asked_as_it_can_be(tmp_path: Path) -> None:
    first, second = Server("fails"), Server("refuses")
    with chat_server(first.answer) as url, chat_server(second.answer) as other:
        fallback = {"model": "openai:second", "base_url": other}
        agents = agents_of(url, tmp_path, fallbacks=[fallback])
        assert [ASK["judge"](agents) for _ in range(2)] == [MEANT["judge"]] * 2
    assert ["response_format" in body for body in second.bodies] == [True, False, False]
    assert [reply.model for reply in logged(agents)] == ["openai:second"] * 2


def test_a_structured_reply_is_used_again_by_a_resumed_run(tmp_path: Path) -> None:
    server = Server("honours")
    with chat_server(server.answer) as url:
        agents = agents_of(url, tmp_path)
        ASK["route"](agents)
        resumed = Agents.resume_from_log(agents.config, agents.log, tmp_path)
        assert ASK["route"](resumed) == MEANT["route"]
    assert len(server.bodies) == 1
    assert sum(isinstance(event, Prompt) for event in read_events(agents.log.path)) == 1


@pytest.mark.parametrize("role", REPLIES)
def test_a_prompt_and_its_schema_name_the_same_fields_and_choices(role: str) -> None:
    schema = dict(reply_schema(role) or {})
    system = read_prompt_template(content.content_path("prompts", role)).system
    rows = schema["properties"].get("segments", {"items": schema})["items"]
    choices = [
        rows["properties"],
        *(field["items"].get("properties", {}) for field in rows["properties"].values() if "items" in field),
    ]
    names = {name for table in choices for name in table} - ({"explanation", "verdict"} if role == "route" else set())
    assert [name for name in names if name not in system] == []
    words = [
        word
        for field in rows["properties"].values()
        for kind in (field, *field.get("anyOf", ()))
        for word in kind.get("enum", ())
    ]
    assert [word for word in words if f"`{word}`" not in system and f'"{word}"' not in system] == []
    block = system.rpartition("```json")[2].partition("```")[0] if role != "route" else ""
    assert set(json.loads(block or "{}")) <= set(rows["properties"])


def test_programs_are_asked_for_in_text() -> None:
    assert [reply_schema(role) for role in ("simulation", "tests", "fix_code", "fix_tests")] == [None] * 4
