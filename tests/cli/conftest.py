"""A chat-completions server on loopback that answers as a scripted model would."""

import base64
import json
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from langchain_core.messages import HumanMessage

from grs_agents.base.config.schema import ModelConfig
from grs_agents.models.factory import make_chat_model
from tests.chat_server import Answer, Json, chat_server, completion


@pytest.fixture(autouse=True)
def _brief_films(brief_films: None) -> None:
    """What a film shows is told by its own tests."""


@dataclass
class ScriptedServer:
    """What the server was asked.

    Attributes:
        url: its base URL.
        roles: role of each request, in order.
        images: how many pictures each role was shown.
        spoilt: replies given to a role before it answers as it should; ``{reply}`` stands for that answer.
        refused: what a role is told with status 401 in place of an answer.
        bodies: what was asked, in order.
        arrived: called with each request before it is answered.
    """

    url: str = ""
    roles: list[str] = field(default_factory=list[str])
    images: dict[str, int] = field(default_factory=dict[str, int])
    spoilt: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    refused: dict[str, str] = field(default_factory=dict[str, str])
    bodies: list[str] = field(default_factory=list[str])
    arrived: Callable[[], None] = lambda: None

    def answer(self, body: Json, _: str) -> Answer:
        """What the server answers: the scripted reply, or that its role is refused."""
        self.bodies.append(json.dumps(body["messages"]))
        self.arrived()
        role, reply = self.reply(body)
        if refusal := self.refused.get(role):
            return 401, {}, json.dumps({"error": {"message": refusal}}).encode()
        usage = {
            "prompt_tokens": 10,
            "completion_tokens": 5,
            "total_tokens": 15,
            "prompt_tokens_details": {"cached_tokens": 4},
            "cost": 0.25,
        }
        return 200, {}, json.dumps(completion({"content": reply}, usage)).encode()

    def reply(self, body: Json) -> tuple[str, str]:
        """The role, and the scripted reply: the rules of the offline model, over the wire of another provider."""
        system, user = body["messages"][:2]
        content: Any = user["content"]
        parts: list[Any] = [{"type": "text", "text": content}] if isinstance(content, str) else content
        text, more = f"{system['content']}\n\n{parts[0]['text']}", parts[1:]
        role = text.split("\n", 1)[0].removeprefix("# Role: ").strip()
        urls = [part["image_url"]["url"] for part in more if part["type"] == "image_url"]
        for url in urls:
            assert base64.b64decode(url.partition("base64,")[2])[:2] == b"\xff\xd8"
        self.roles.append(role)
        self.images[role] = self.images.get(role, 0) + len(urls)
        blocks: list[Any] = [
            {"type": "image", "base64": url.partition("base64,")[2], "mime_type": "image/jpeg"} for url in urls
        ]
        model = make_chat_model(ModelConfig(model="offline"), 0)
        reply = str(model.invoke([HumanMessage([*blocks, {"type": "text", "text": text}])]).text)
        waiting = self.spoilt.get(role, [])
        return role, waiting.pop(0).replace("{reply}", reply) if waiting else reply


@contextmanager
def serve_script() -> Generator[ScriptedServer]:
    """An OpenAI-compatible server on 127.0.0.1."""
    script = ScriptedServer()

    with chat_server(script.answer) as script.url:
        yield script


@pytest.fixture
def scripted_server() -> Iterator[ScriptedServer]:
    """A server for one test."""
    with serve_script() as script:
        yield script
