"""Redirects of a provider, through each real client: followed on its own server, refused to any other."""

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
import requests

from grs_agents.models.answer import Answer, ProviderFailure
from grs_agents.models.call import ModelHttpCall, call_with_timeout, limit_and_record_http_client
from tests.models.test_failures import CLIENTS, PATHS, ask, credentials, reply

__all__ = ["credentials"]

Redirect = Callable[[str], str | None]
"""The location that a path is redirected to; None where it is answered."""
KEY = "sk-0123456789-of-mine"


class Server:
    """A provider on loopback, which keeps what it is sent."""

    def __init__(self, status: int, redirect: Redirect) -> None:
        self.bodies: list[bytes] = []
        kept = self.bodies

        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *args: Any, **named: Any) -> None:
                """Stay silent."""

            def do_POST(self) -> None:
                kept.append(self.rfile.read(int(self.headers.get("Content-Length", 0))))
                location = redirect(self.path)
                protocol = next((name for part, name in PATHS.items() if part in self.path), "openai")
                data = json.dumps(reply(protocol, "hello", "stop")).encode()
                self.close_connection = True
                with contextlib.suppress(OSError):
                    self.send_response(200 if location is None else status)
                    if location is not None:
                        self.send_header("Location", location)
                    self.send_header("Content-Type", "application/json")
                    self.send_header("Content-Length", str(len(data)))
                    self.end_headers()
                    self.wfile.write(data)

            def do_GET(self) -> None:
                self.do_POST()  # clients repeat a POST as a GET after 301, 302 and 303

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.http.daemon_threads = True
        self.port = self.http.server_address[1]


Serve = Callable[[int, Redirect], Server]


@pytest.fixture
def serve() -> Iterator[Serve]:
    running: list[Server] = []

    def start(status: int, redirect: Redirect) -> Server:
        server = Server(status, redirect)
        running.append(server)
        threading.Thread(target=server.http.serve_forever, args=(0.01,), daemon=True).start()
        return server

    yield start
    for server in running:
        server.http.shutdown()
        server.http.server_close()


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
@pytest.mark.parametrize("provider", CLIENTS)
def test_another_server_is_sent_nothing(provider: str, status: int, serve: Serve) -> None:
    elsewhere = serve(status, lambda path: None)
    first = serve(status, lambda path: f"http://127.0.0.1:{elsewhere.port}{path}")
    failure, waits = ask(provider, f"http://127.0.0.1:{first.port}")
    assert (len(first.bodies), elsewhere.bodies, waits) == (1, [], [])
    assert isinstance(failure, ProviderFailure), failure
    if (provider, status) != ("bedrock", 303):  # on which its client fails before anybody sees the location
        assert failure.kind == "redirected", failure
        assert f"http://127.0.0.1:{first.port} redirects to http://127.0.0.1:{elsewhere.port}" in failure.message
        assert "base_url" in failure.remedy


@pytest.mark.parametrize(
    "location",
    [
        "http://localhost:{port}{path}",
        "//localhost:{port}{path}",
        "https://127.0.0.1.example.org{path}",
        "http://[::1]:{port}{path}",
        "https://127.0.0.1:1{path}",
        "http://127.0.0.1:{port}@localhost:{port}{path}",
    ],
)
@pytest.mark.parametrize("provider", CLIENTS)
def test_another_name_is_another_server(provider: str, location: str, serve: Serve) -> None:
    first = serve(307, lambda path: location.format(port=first.port, path=path))
    failure, _ = ask(provider, f"http://127.0.0.1:{first.port}")
    assert isinstance(failure, ProviderFailure) and failure.kind == "redirected", failure
    assert len(first.bodies) == 1


@pytest.mark.parametrize("status", [307, 308])
@pytest.mark.parametrize(
    "location", ["{path}?again", "http://127.0.0.1:{port}{path}?again", "//127.0.0.1:{port}{path}?again"]
)
@pytest.mark.parametrize("provider", [client for client in CLIENTS if client.values != ("bedrock",)])
def test_the_same_server_may_redirect(provider: str, location: str, status: int, serve: Serve) -> None:
    def redirect(path: str) -> str | None:
        return None if "again" in path else location.format(port=server.port, path=path.partition("?")[0])

    server = serve(status, redirect)
    answer, _ = ask(provider, f"http://127.0.0.1:{server.port}")
    assert isinstance(answer, Answer) and answer.text == "hello", answer
    first, second = server.bodies
    assert first == second


def test_a_second_hop_leads_nowhere_else_either(serve: Serve) -> None:
    elsewhere = serve(307, lambda path: None)

    def redirect(path: str) -> str:
        return f"http://127.0.0.1:{elsewhere.port}{path}" if "again" in path else f"{path}?again"

    server = serve(307, redirect)
    failure, _ = ask("openai", f"http://127.0.0.1:{server.port}")
    assert isinstance(failure, ProviderFailure) and failure.kind == "redirected"
    assert (len(server.bodies), elsewhere.bodies) == (2, [])


def test_a_key_in_the_name_of_a_server_is_not_repeated(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    server = serve(307, lambda path: f"http://{KEY}.example.org{path}")
    failure, _ = ask("openai", f"http://127.0.0.1:{server.port}")
    assert isinstance(failure, ProviderFailure) and failure.kind == "redirected"
    assert KEY not in str(failure)


class RequestsClient:
    """A client that makes sessions of requests, as that of ``nvidia``."""

    get_session_fn = requests.Session


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
@pytest.mark.parametrize("hops", [1, 2])
def test_a_session_of_requests_is_not_led_to_another_server(status: int, hops: int, serve: Serve) -> None:
    elsewhere = serve(status, lambda path: None)

    def redirect(path: str) -> str:
        return "/again" if path != "/again" and hops == 2 else f"http://127.0.0.1:{elsewhere.port}/"

    first = serve(status, redirect)
    client = RequestsClient()
    limit_and_record_http_client(client)
    address = f"http://127.0.0.1:{first.port}/first"
    call = ModelHttpCall()
    with pytest.raises(ProviderFailure, match=f"redirects to http://127.0.0.1:{elsewhere.port}") as raised:
        call_with_timeout(30, lambda: client.get_session_fn().post(address, data=b"the prompt"), call)
    assert raised.value.kind == "redirected"
    assert (len(first.bodies), elsewhere.bodies) == (hops, [])


def test_a_session_of_requests_follows_on_its_own_server(serve: Serve) -> None:
    server = serve(307, lambda path: None if path == "/again" else "/again")
    client = RequestsClient()
    limit_and_record_http_client(client)
    session = client.get_session_fn()
    for name in ("127.0.0.1", "localhost"):  # each request has a first server of its own
        assert session.post(f"http://{name}:{server.port}/first", data=b"the prompt").status_code == 200
    assert server.bodies == [b"the prompt"] * 4
