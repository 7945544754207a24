"""An agent asks its model, reads the reply strictly, and asks again when the reply cannot be used."""

import base64
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
from langchain_core.messages import AIMessage, HumanMessage

from grs_agents.agents import roles
from grs_agents.agents.agent import IMAGE_SIDES, Agents
from grs_agents.agents.roles import JudgedPrograms
from grs_agents.agents.types import NoReply, RouterReply, TaskDefinition
from grs_agents.base.config.schema import Config, ModelConfig
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.trace.events import Prompt, Reply
from grs_agents.base.trace.log import EventLog, read_events
from tests.chat_server import Answer, Json, chat_server, completion
from tests.needs import needs
from tests.scripted import ScriptedAgents, say, scripted

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})
GOOD, BAD = "The oracle falls short.\n```\nfix_code\n```", "I would rather fix both."


class RefusedKey(Exception):
    """What a provider's client raises for a wrong key."""

    status_code = 401


def ask(agents: ScriptedAgents) -> RouterReply | NoReply:
    """Put the router's question."""
    judged = JudgedPrograms(TASK, "{}", "", "", "failed: 0 of 1 tests passed", ["fix_code: version 2"])
    return roles.decide_what_to_fix(agents, judged, ("fix_code", "fix_test"))


def exchanges(agents: ScriptedAgents) -> list[tuple[Prompt, Reply]]:
    """The prompts in the log, each with its reply."""
    events = read_events(agents.log.path)
    replies = {event.call: event for event in events if isinstance(event, Reply)}
    return [(event, replies[event.call]) for event in events if isinstance(event, Prompt)]


def test_a_usable_reply_is_parsed_and_the_whole_exchange_is_logged(tmp_path: Path) -> None:
    agents = scripted(tmp_path, [GOOD])
    assert ask(agents) == RouterReply(verdict="fix_code", explanation="The oracle falls short.")
    [(prompt, reply)] = exchanges(agents)
    assert (prompt.role, reply.role) == ("route", "route")
    assert "fix_code: version 2" in prompt.text
    assert [message.type for message in agents.script.asked[0]] == ["system", "human"]
    assert all(str(message.text).strip() in prompt.text for message in agents.script.asked[0])
    assert (reply.text, reply.input_tokens, reply.output_tokens, reply.error) == (GOOD, 11, 5, "")


@pytest.mark.parametrize("reason", ["stop", "end_turn"])
def test_the_log_keeps_the_finish_reason(tmp_path: Path, reason: str) -> None:
    agents = scripted(tmp_path, [say(GOOD, reason)])
    ask(agents)
    assert [reply.finish_reason for _, reply in exchanges(agents)] == [reason]


def test_after_an_unusable_reply_the_model_is_shown_it_with_what_is_wrong(tmp_path: Path) -> None:
    agents = scripted(tmp_path, [BAD, GOOD])
    assert isinstance(ask(agents), RouterReply)
    first, second = agents.script.asked
    *question, custom, complaint = second
    assert question == first
    assert isinstance(custom, AIMessage) and custom.text == BAD
    assert isinstance(complaint, HumanMessage) and "fix_code or fix_test" in complaint.text
    asked = "\n\n".join(str(message.text).strip() for message in question)
    assert [prompt.text for prompt, _ in exchanges(agents)] == [asked, complaint.text]
    assert [reply.text for _, reply in exchanges(agents)] == [BAD, GOOD]


def test_of_two_unusable_replies_the_model_is_shown_both(tmp_path: Path) -> None:
    agents = scripted(tmp_path, [BAD, "Neither.", GOOD])
    ask(agents)
    last = agents.script.asked[2]
    assert [message.text for message in last if isinstance(message, AIMessage)] == [BAD, "Neither."]
    assert [message.type for message in last] == ["system", "human", "ai", "human", "ai", "human"]


@pytest.mark.parametrize("unusable", [say(""), say("half of a rep", "length")], ids=["empty", "cut off"])
def test_a_reply_that_is_not_whole_is_asked_for_again(tmp_path: Path, unusable: AIMessage) -> None:
    agents = scripted(tmp_path, [unusable, GOOD])
    assert isinstance(ask(agents), RouterReply)
    assert [message.type for message in agents.script.asked[1]] == ["system", "human", "ai", "human"]
    [(_, first), (_, second)] = exchanges(agents)
    assert first.error and first.error in str(agents.script.asked[1][-1].text)
    assert (second.text, second.error) == (GOOD, "")


@pytest.mark.parametrize("retries", [0, 2])
def test_a_model_that_gives_no_usable_reply_is_an_outcome(tmp_path: Path, retries: int) -> None:
    agents = scripted(tmp_path, [BAD] * 9, Config(reply_retries=retries))
    outcome = ask(agents)
    assert isinstance(outcome, NoReply)
    assert (outcome.role, outcome.tries) == ("route", retries + 1)
    assert "fix_code or fix_test" in outcome.problem
    assert len(agents.script.asked) == len(exchanges(agents)) == retries + 1


def test_roles_are_asked_from_several_threads(tmp_path: Path) -> None:
    agents = scripted(tmp_path, [BAD, GOOD] * 40)
    with ThreadPoolExecutor(8) as threads:
        outcomes = list(threads.map(lambda _: ask(agents), range(20)))
    assert all(isinstance(outcome, RouterReply | NoReply) for outcome in outcomes)
    assert len(exchanges(agents)) == len(agents.script.asked)
    events = read_events(agents.log.path)
    assert [event.sequence for event in events] == list(range(2 * len(agents.script.asked)))


def test_a_provider_that_refuses_the_key_ends_it_at_once(tmp_path: Path) -> None:
    agents = scripted(tmp_path, [RefusedKey("no such key"), GOOD])
    with pytest.raises(GrsError, match=r"401.*no such key"):
        ask(agents)
    assert len(agents.script.asked) == 1


@pytest.mark.parametrize(("side", "shown"), [(3000, IMAGE_SIDES[1]), (40, IMAGE_SIDES[0]), (600, 600)])
def test_pictures_are_sent_once_after_the_text_and_as_large_as_needed(tmp_path: Path, side: int, shown: int) -> None:
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((side // 2, side, 3), 90, np.uint8))
    task = '```json\n{"task-name": "t", "task-description": "d", "assets-used": ["a"]}\n```'
    agents = scripted(tmp_path, ["no", task])
    assert roles.author_task(agents, {"objects": [{"asset": "a"}]}, [], ["photo.png"]) == TASK
    _, question, _, complaint = agents.script.asked[1]
    text, image = (block for block in question.content if isinstance(block, dict))
    assert (text["type"], image["type"]) == ("text", "image")
    sent = cv2.imdecode(np.frombuffer(base64.b64decode(image["base64"]), np.uint8), cv2.IMREAD_COLOR)
    assert sent is not None and sent.shape == (shown // 2, shown, 3)
    assert isinstance(complaint.content, str)
    assert [prompt.images for prompt, _ in exchanges(agents)] == [("photo.png",), ()]


@pytest.mark.parametrize(
    ("pictures", "profile", "sent"),
    [
        ("auto", None, True),
        ("auto", {"image_inputs": True}, True),
        ("auto", {"image_inputs": False}, False),
        (True, {"image_inputs": False}, True),
        (False, {"image_inputs": True}, False),
    ],
)
def test_pictures_are_sent_to_models_that_take_them(
    tmp_path: Path, pictures: bool | Literal["auto"], profile: Any, sent: bool
) -> None:
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((300, 300, 3), 90, np.uint8))
    task = '```json\n{"task-name": "t", "task-description": "d", "assets-used": ["a"]}\n```'
    config = Config(models={"default": ModelConfig(model="openai:any", pictures=pictures)})
    agents = scripted(tmp_path, [task], config)
    agents.script.profile = profile
    assert agents.sees_pictures("task") == sent
    assert roles.author_task(agents, {"objects": [{"asset": "a"}]}, [], ["photo.png"]) == TASK
    [[_, question]] = agents.script.asked
    assert [block["type"] for block in question.content if isinstance(block, dict)] == ["text", "image"][: 1 + sent]
    [(prompt, _)] = exchanges(agents)
    assert prompt.images == (("photo.png",) if sent else ())


@needs("langchain_openai")
def test_of_several_models_those_without_sight_get_the_text_alone(tmp_path: Path) -> None:
    asked: list[Any] = []

    def answer(body: Json, _: str) -> Answer:
        asked.append(body["messages"][1]["content"])
        reply = json.dumps({"task-name": "t", "task-description": "d", "assets-used": ["a"]})
        status = 200 if len(asked) == 2 else 401
        return status, {}, json.dumps(completion({"content": f"```json\n{reply}\n```"}, {})).encode()

    cv2.imwrite(str(tmp_path / "photo.png"), np.full((300, 300, 3), 90, np.uint8))
    with chat_server(answer) as url:
        first = {"model": "openai:a", "base_url": url, "structured": "off"}
        second = {**first, "model": "openai:b", "pictures": False}
        config = Config.model_validate({"models": {"default": {**first, "fallbacks": [second]}}})
        agents = Agents(config, EventLog(tmp_path / "events.jsonl"), tmp_path)
        assert roles.author_task(agents, {"objects": [{"asset": "a"}]}, [], ["photo.png"]) == TASK
    assert isinstance(asked[0], list) and len(asked[0]) == 2
    assert isinstance(asked[1], str) and asked[1].strip() == asked[0][0]["text"].strip()


def test_a_picture_that_cannot_be_read_is_the_users_affair(tmp_path: Path) -> None:
    (tmp_path / "photo.png").write_text("no picture")
    agents = scripted(tmp_path, [GOOD])
    with pytest.raises(InputError, match=r"photo\.png"):
        roles.author_task(agents, {"objects": []}, [], ["photo.png"])
    assert not agents.script.asked


def test_a_role_without_a_model_of_its_own_is_served_by_the_default(tmp_path: Path) -> None:
    local = ModelConfig(model="openai:any", base_url="http://127.0.0.1:9/v1")
    config = Config(models={"default": ModelConfig(model="offline"), "simulation": local})
    agents = Agents(config, EventLog(tmp_path / "events.jsonl"), tmp_path)
    assert agents.chat_model_for_role("route") is agents.chat_model_for_role("tests")
    assert agents.chat_model_for_role("simulation") is not agents.chat_model_for_role("route")
