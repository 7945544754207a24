"""Whole runs against servers whose replies have every usual shape: all of them say the same."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.trace.events import Reply
from grs_agents.base.trace.log import read_events
from tests.chat_server import Answer, Json, chat_server, completion
from tests.cli.command import grs
from tests.cli.conftest import ScriptedServer
from tests.needs import needs
from tests.slow import SLOW

pytestmark = needs("langchain_openai")
DRAFT = '```json\n{"id": 1, "is_object": false, "description": "a draft", "color": "red", "shape": "bag"}\n```'
THOUGHTS = f"<think>\nLet me draft.\n{DRAFT}\n```\nfix_code\n```\nNo, that is wrong.\n</think>\n\n"


def strip_fence(reply: str) -> str:
    """The JSON in a reply without its fence; another reply as it is."""
    found = re.search(r"```json\n(.*?)```", reply, re.DOTALL)
    return found[1] if found else reply


SHAPES: dict[str, Callable[[str], tuple[Json, str]]] = {
    "thoughts": lambda reply: ({"content": THOUGHTS + strip_fence(reply)}, "stop"),
    "CRLF": lambda reply: ({"content": reply.replace("\n", "\r\n")}, "COMPLETE"),
    "other tags": lambda reply: (
        {"content": reply.replace("```python", "```python3").replace("```json", "```jsonl")},
        "end_turn",
    ),
    "list content": lambda reply: (
        {
            "content": [
                {"type": "thinking", "thinking": [{"type": "text", "text": DRAFT}]},
                {"type": "text", "text": reply},
            ]
        },
        "stop",
    ),
    "unopened thoughts": lambda reply: ({"content": THOUGHTS.removeprefix("<think>\n") + reply}, "stop"),
    "an example after it": lambda reply: ({"content": f"{reply}\n\nExpected output:\n```\nOK\n```\n"}, "stop"),
    "another finish reason": lambda reply: ({"content": reply}, "eos_token"),
    "reasoning apart": lambda reply: ({"content": reply, "reasoning_content": DRAFT}, "stop"),
}


@dataclass
class ShapedServer(ScriptedServer):
    """A scripted server each of whose replies has the next of ``SHAPES``, from the one of this number on."""

    first: int = 0

    def answer(self, body: Json, _: str) -> Answer:
        shape = list(SHAPES.values())[(self.first + len(self.roles)) % len(SHAPES)]
        message, finish = shape(self.reply(body)[1])
        usage = {"prompt_tokens": 10, "completion_tokens": 5, "total_tokens": 15}
        return 200, {}, json.dumps(completion(message, usage, finish)).encode()


def run(scene: Path, folder: Path, url: str) -> tuple[int, dict[str, Any]]:
    """The exit status of a run in ``folder``, and what it says of itself."""
    model = ("--model", "openai:any", "--set", f"models.base_url={url}")
    done = grs("run", str(scene), "--out", "run", "--json", *model, folder=folder)
    return done.returncode, json.loads(done.stdout)


# Of 7 calls: with both, words and programs have each shape that matters.
@pytest.mark.parametrize("first", [0, pytest.param(4, marks=SLOW)])
def test_replies_of_all_shapes_are_accepted(small_scene: Path, tmp_path: Path, first: int) -> None:
    server = ShapedServer(first=first)
    with chat_server(server.answer) as url:
        status, said = run(small_scene, tmp_path, url)
    assert (status, said["status"]) == (0, "accepted"), said
    replies = [event for event in read_events(tmp_path / "run" / "events.jsonl") if isinstance(event, Reply)]
    assert len(replies) == len(server.roles)
    assert {reply.error for reply in replies} == {""}


@pytest.mark.parametrize("field", ["reasoning_content", "reasoning"])
def test_replies_that_are_reasoning_alone_end_the_run_with_the_setting_that_helps(
    known_scene: Path, tmp_path: Path, field: str
) -> None:
    message = {"content": None, field: "I think so."}
    body = json.dumps(completion(message, {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2})).encode()
    with chat_server(lambda *_: (200, {}, body)) as url:
        status, said = run(known_scene, tmp_path, url)
    assert (status, said["status"]) == (1, "rejected")
    assert f"the server put 11 characters into {field}" in said["reason"]
    assert "--reasoning-parser" in said["reason"] and "enable_thinking=false" in said["reason"]
