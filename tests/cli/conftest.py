"""A chat-completions server on loopback that answers as a scripted model would."""

import base64
import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest
from langchain_core.messages import HumanMessage

from grs_agents.config import ModelConfig
from grs_agents.models import chat_model


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

    def answer(self, body: dict[str, Any]) -> str:
        """The scripted reply: the rules of the offline model, over the wire of another provider."""
        content = body["messages"][0]["content"]
        parts: list[dict[str, Any]] = [{"type": "text", "text": content}] if isinstance(content, str) else content
        text = "\n".join(part["text"] for part in parts if part["type"] == "text")
        role = text.split("\n", 1)[0].removeprefix("# Role: ").strip()
        urls = [part["image_url"]["url"] for part in parts if part["type"] == "image_url"]
        for url in urls:
            assert base64.b64decode(url.partition("base64,")[2])[:2] == b"\xff\xd8"
        self.roles.append(role)
        self.images[role] = self.images.get(role, 0) + len(urls)
        blocks: list[Any] = [
            {"type": "image", "base64": url.partition("base64,")[2], "mime_type": "image/jpeg"} for url in urls
        ]
        model = chat_model(ModelConfig(model="offline"), 0)
        reply = str(model.invoke([HumanMessage([*blocks, {"type": "text", "text": text}])]).text)
        waiting = self.spoilt.get(role, [])
        return waiting.pop(0).replace("{reply}", reply) if waiting else reply


@pytest.fixture
def scripted_server() -> Iterator[ScriptedServer]:
    """An OpenAI-compatible server on 127.0.0.1."""
    script = ScriptedServer()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            script.bodies.append(json.dumps(body["messages"]))
            script.arrived()
            message = {"role": "assistant", "content": script.answer(body)}
            if refusal := script.refused.get(script.roles[-1]):
                self.send(401, {"error": {"message": refusal}})
                return
            reply = {
                "id": "1",
                "object": "chat.completion",
                "created": 1,
                "model": body["model"],
                "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
                "usage": {
                    "prompt_tokens": 10,
                    "completion_tokens": 5,
                    "total_tokens": 15,
                    "prompt_tokens_details": {"cached_tokens": 4},
                    "cost": 0.25,
                },
            }
            with contextlib.suppress(OSError):  # the client was killed
                self.send(200, reply)

        def send(self, status: int, reply: dict[str, Any]) -> None:
            data = json.dumps(reply).encode()
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
            """Stay silent."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    script.url = f"http://127.0.0.1:{server.server_address[1]}/v1"
    yield script
    server.shutdown()
    thread.join()
    server.server_close()
