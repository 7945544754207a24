"""Every way in which a provider can fail, through each real client: one type, within the deadline, in little memory."""

import contextlib
import json
import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from langchain_core.messages import HumanMessage

from grs_agents.base.config.schema import ModelConfig
from grs_agents.models.answer import Answer, ProviderFailure, ReplyProblem
from grs_agents.models.call import Retries, invoke_with_retries
from grs_agents.models.factory import PROVIDERS, make_chat_model
from tests.needs import needs
from tests.slow import SLOW

Json = dict[str, Any]
PACKAGES = {
    name: provider.module.partition(".")[0]
    for name, provider in PROVIDERS.items()
    if provider.http_client
    and provider.url_argument
    and all(earlier is not provider for earlier in list(PROVIDERS.values())[: list(PROVIDERS).index(name)])
    # two ask their cloud for a token first, the third retries by itself
    and name not in ("bedrock_mantle_openai", "google_anthropic_vertex", "cohere")
}
"""The package of each provider that has a client of its own."""
CLIENTS = [
    pytest.param(name, marks=[needs(package), *([SLOW] * (name != "openai"))]) for name, package in PACKAGES.items()
]
PATHS = {
    "/messages": "anthropic",
    "/api/chat": "ollama",
    "enerateContent": "google",
    "/converse": "bedrock",
    "/responses": "responses",
}
ENDS = {
    "anthropic": {"stop": "end_turn", "length": "max_tokens"},
    "google": {"stop": "STOP", "length": "MAX_TOKENS", "refusal": "SAFETY"},
    "bedrock": {"stop": "end_turn", "length": "max_tokens", "refusal": "guardrail_intervened"},
    "responses": {"stop": "completed", "length": "max_output_tokens", "refusal": "content_filter"},
}


def reply(protocol: str, text: str, end: str) -> Json:
    """A reply as the protocol has it."""
    end = ENDS.get(protocol, {}).get(end, end)
    return REPLIES[protocol](text, end)


def reply_of_anthropic(text: str, end: str) -> Json:
    usage = {"input_tokens": 11, "output_tokens": 5}
    head = {"id": "m", "type": "message", "role": "assistant", "model": "any", "stop_sequence": None}
    return {**head, "content": [{"type": "text", "text": text}] if text else [], "stop_reason": end, "usage": usage}


def reply_of_ollama(text: str, end: str) -> Json:
    message = {"role": "assistant", "content": text}
    counts = {"prompt_eval_count": 11, "eval_count": 5}
    return {"model": "any", "created_at": "", "message": message, "done": True, "done_reason": end, **counts}


def reply_of_google(text: str, end: str) -> Json:
    parts = [{"text": text}] if text else []
    usage = {"promptTokenCount": 11, "candidatesTokenCount": 5, "totalTokenCount": 16}
    candidate = {"content": {"role": "model", "parts": parts}, "finishReason": end, "index": 0}
    return {"candidates": [candidate], "usageMetadata": usage}


def reply_of_bedrock(text: str, end: str) -> Json:
    message = {"role": "assistant", "content": [{"text": text}] if text else []}
    usage = {"inputTokens": 11, "outputTokens": 5, "totalTokens": 16}
    return {"output": {"message": message}, "stopReason": end, "usage": usage, "metrics": {"latencyMs": 1}}


def reply_of_responses(text: str, end: str) -> Json:
    part = {"type": "output_text", "text": text, "annotations": []}
    message = {"type": "message", "id": "m", "role": "assistant", "status": "completed", "content": [part]}
    usage = {"input_tokens": 11, "output_tokens": 5, "total_tokens": 16}
    cut = {} if end == "completed" else {"status": "incomplete", "incomplete_details": {"reason": end}}
    head = {"id": "x", "object": "response", "created_at": 1, "model": "any", "status": "completed"}
    more = {"parallel_tool_calls": False, "tools": [], "tool_choice": "auto"}
    return {**head, **more, "output": [message] if text else [], "usage": usage, **cut}


def reply_of_openai(text: str, end: str) -> Json:
    message = {"role": "assistant", "content": text, **({"refusal": "I cannot"} if end == "refusal" else {})}
    choice = {"index": 0, "message": message, "finish_reason": end}
    usage = {"prompt_tokens": 11, "completion_tokens": 5, "total_tokens": 16}
    head = {"id": "x", "object": "chat.completion", "created": 1, "model": "any", "system_fingerprint": None}
    return {**head, "choices": [choice], "usage": usage}


REPLIES: dict[str, Callable[[str, str], Json]] = {
    "anthropic": reply_of_anthropic,
    "ollama": reply_of_ollama,
    "google": reply_of_google,
    "bedrock": reply_of_bedrock,
    "responses": reply_of_responses,
    "openai": reply_of_openai,
}


def whole(to: BaseHTTPRequestHandler, body: bytes, status: int = 200, kind: str = "application/json") -> None:
    to.send_response(status)
    to.send_header("Content-Type", kind)
    to.send_header("Retry-After", "3600" if status == 429 else "0")
    to.send_header("Content-Length", str(len(body)))
    to.end_headers()
    to.wfile.write(body)


def error(status: int, code: str = "x") -> Callable[[BaseHTTPRequestHandler, str], None]:
    error_json = {"message": "told so", "type": "api_error", "code": code, "status": "X"}
    body = json.dumps({"type": "error", "error": error_json, "message": f"told so {code}"}).encode()
    return lambda to, protocol: whole(to, body, status)


def says(text: str, end: str) -> Callable[[BaseHTTPRequestHandler, str], None]:
    return lambda to, protocol: whole(to, json.dumps(reply(protocol, text, end)).encode())


def reset(to: BaseHTTPRequestHandler, protocol: str) -> None:
    """Begin a body, then reset the connection."""
    to.wfile.write(b'HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 500\r\n\r\n{"id":')
    to.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    to.connection.close()


def drip(to: BaseHTTPRequestHandler, protocol: str) -> None:
    """A byte now and then, without end."""
    to.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n\r\n")
    while not threading.Event().wait(0.05):
        to.wfile.write(b" ")


def pour(piece: bytes) -> Callable[[BaseHTTPRequestHandler, str], None]:
    def send(to: BaseHTTPRequestHandler, protocol: str) -> None:
        to.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n\r\n[")
        while True:
            to.wfile.write(piece * (2**16 // len(piece)))

    return send


MODES: dict[str, tuple[Callable[[BaseHTTPRequestHandler, str], None], str, int]] = {
    # what the server does, the kind of failure, how often it is asked
    "401": (error(401), "credentials", 1),
    "403": (error(403), "credentials", 1),
    "404": (error(404), "not_found", 1),
    "400": (error(400), "refused_request", 1),
    "400 of a filter": (error(400, "content_filter"), "refusal", 1),
    "413": (error(413), "prompt_too_long", 1),
    "429 for an hour": (error(429), "rate_limit", 1),
    "429 for good": (error(429, "insufficient_quota"), "quota", 1),
    "500": (error(500), "server_error", 3),
    "529": (error(529), "server_error", 3),
    "malformed": (lambda to, protocol: whole(to, b'{"id": "x", "choi'), "malformed", 3),
    "page": (lambda to, protocol: whole(to, b"<html>gateway</html>", kind="text/html"), "malformed", 3),
    "empty": (says("", "stop"), "empty", 1),
    "refusal": (says("", "refusal"), "refusal", 1),
    "truncated": (says("half of", "length"), "length", 1),
    "reset": (reset, "broken_off", 3),
    "drip": (drip, "deadline", 1),
    "endless": (pour(b" "), "too_long", 1),
    "endless entries": (pour(b"{},"), "too_long", 1),
}


class Server:
    """A provider on loopback that does as its mode says."""

    def __init__(self) -> None:
        self.mode, self.asked = "", 0
        served = self

        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *args: Any, **named: Any) -> None:
                """Stay silent."""

            def do_POST(self) -> None:
                self.rfile.read(int(self.headers.get("Content-Length", 0)))
                served.asked += 1
                self.close_connection = True
                protocol = next((name for part, name in PATHS.items() if part in self.path), "openai")
                with contextlib.suppress(OSError, ValueError):  # the client, or this side, has hung up
                    MODES[served.mode][0](self, protocol)

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.http.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.http.server_address[1]}"


@contextlib.contextmanager
def serve(mode: str = "") -> Generator[Server]:
    server = Server()
    server.mode = mode
    threading.Thread(target=server.http.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield server
    finally:
        server.http.shutdown()
        server.http.server_close()


@pytest.fixture
def server() -> Iterator[Server]:
    with serve() as running:
        yield running


@pytest.fixture(autouse=True)
def credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    """What clients want to see before they ask anyone."""
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "any")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("OPENAI_API_VERSION", "2024-10-21")
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


def ask(provider: str, url: str, deadline: float = 60.0) -> tuple[Answer | ProviderFailure | ReplyProblem, list[float]]:
    """What comes of a call, and the seconds that were waited between tries."""
    waits: list[float] = []
    config = ModelConfig(model=f"{provider}:any", base_url=url + ("/v1" if provider == "openai" else ""))
    try:
        model = make_chat_model(config, seed=0)
        retries = Retries(deadline=deadline, sleep=waits.append)
        return invoke_with_retries(model, [HumanMessage("hi")], retries), waits
    except (ProviderFailure, ReplyProblem) as failure:
        return failure, waits


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("provider", CLIENTS)
def test_every_failure_has_its_type(provider: str, mode: str, server: Server) -> None:
    server.mode = mode
    failure, waits = ask(provider, server.url, 0.5 if mode == "drip" else 60.0)
    _, kind, requests = MODES[mode]
    assert not isinstance(failure, Answer)
    assert (failure.kind, server.asked) == (kind, requests), failure
    assert len(waits) == requests - 1
    assert isinstance(failure, ReplyProblem) == (kind in ("empty", "refusal", "length"))
    if isinstance(failure, ProviderFailure):
        assert server.url in failure.message and failure.remedy


@pytest.mark.parametrize("provider", CLIENTS)
def test_a_server_that_nobody_runs_is_named(provider: str) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{unused.getsockname()[1]}"
        failure, waits = ask(provider, url)
    assert isinstance(failure, ProviderFailure) and failure.kind == "unreachable"
    assert f"{url} cannot be reached in 3 tries" in failure.message and "start that server" in failure.remedy
    assert waits == [1.0, 2.0]


MEMORY = """
import re, sys
from pathlib import Path
from tests.models.test_failures import ask
urls, providers = sys.argv[1:3], sys.argv[3:]
kinds = [ask(name, url, 60.0)[0].kind for name in providers for url in urls for _ in range(2)]
print(*kinds, int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""


@needs("64-bit linux")
@pytest.mark.parametrize(
    "package",
    [
        pytest.param(package, marks=[needs(package), *([SLOW] * (package != "langchain_openai"))])
        for package in dict.fromkeys(PACKAGES.values())
    ],
)
def test_huge_answers_cost_little_memory(package: str) -> None:
    """All clients of a package in one process, whose peak is that of the worst."""
    providers = [name for name in PACKAGES if PACKAGES[name] == package]
    with serve("endless") as blank, serve("endless entries") as entries:
        done = subprocess.run(
            [sys.executable, "-c", MEMORY, blank.url, entries.url, *providers],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
    *kinds, megabytes = done.stdout.split()
    assert kinds == ["too_long"] * 4 * len(providers)
    assert int(megabytes) < 300
