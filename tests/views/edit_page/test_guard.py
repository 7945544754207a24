"""The page of `grs edit` answers the person who was given its address, and nobody else."""

import http.client
import socket
from collections.abc import Generator, Mapping
from urllib.parse import urlsplit

import pytest

from grs_agents.base.errors import InputError
from grs_agents.views.edit_page import guard
from grs_agents.views.edit_page.guard import GuardedServer
from tests.needs import needs

pytestmark = needs("viser")


@pytest.fixture(scope="module")
def server() -> Generator[GuardedServer]:
    started = GuardedServer(0)
    yield started
    started.stop()


def get(server: GuardedServer, path: str, **headers: str) -> http.client.HTTPResponse:
    """The answer to GET; ``Host`` and others may be given, underscores stand for hyphens."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    answer.read()
    connection.close()
    return answer


def cookie(server: GuardedServer) -> str:
    parts = urlsplit(server.address)
    return get(server, f"{parts.path}?{parts.query}").headers["Set-Cookie"].partition(";")[0]


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    "Sec_WebSocket_Protocol": f"viser-v{guard.VISER}",
}


def test_the_token_becomes_a_cookie_that_no_script_reads(server: GuardedServer) -> None:
    parts = urlsplit(server.address)
    answer = get(server, f"{parts.path}?{parts.query}")
    assert (answer.status, answer.headers["Location"]) == (303, "/")
    assert "HttpOnly" in answer.headers["Set-Cookie"] and "SameSite=Strict" in answer.headers["Set-Cookie"]
    page = get(server, "/", Cookie=cookie(server))
    assert page.status == 200
    assert "frame-ancestors 'none'" in page.headers["Content-Security-Policy"]
    assert page.headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=x", "/?token=é", "/index.html", "/report", "/../guard.py"])
def test_a_request_without_token_is_refused(server: GuardedServer, path: str) -> None:
    assert get(server, path.replace("é", "%C3%A9")).status == 403
    assert get(server, path.replace("é", "%FF"), Cookie=f"grs_edit_{server.port}=wrong").status == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:1"},
    ],
    ids=str,
)
@pytest.mark.parametrize("upgrade", [{}, UPGRADE], ids=["page", "websocket"])
def test_a_foreign_origin_or_host_is_refused(
    server: GuardedServer, upgrade: Mapping[str, str], headers: Mapping[str, str]
) -> None:
    known = {"Cookie": cookie(server), "Origin": f"http://127.0.0.1:{server.port}"}
    assert get(server, "/", **{**known, **upgrade, **headers}).status == 403
    assert get(server, "/", **{**known, **upgrade}).status == (101 if upgrade else 200)


def test_the_websocket_needs_origin_and_cookie(server: GuardedServer) -> None:
    origin = f"http://127.0.0.1:{server.port}"
    assert get(server, "/", Cookie=cookie(server), **UPGRADE).status == 403
    assert get(server, "/", Origin=origin, **UPGRADE).status == 403
    assert get(server, urlsplit(server.address).path + "?" + urlsplit(server.address).query, **UPGRADE).status == 403


@pytest.mark.parametrize("path", ["/index.html", "/../guard.py", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd"])
def test_no_path_is_served_but_the_page(server: GuardedServer, path: str) -> None:
    assert get(server, path, Cookie=cookie(server)).status == 404


def test_a_document_is_served_in_a_sandbox(server: GuardedServer) -> None:
    server.documents["/report"] = b"<h1>report</h1>"
    try:
        answer = get(server, "/report", Cookie=cookie(server))
        assert answer.status == 200
        assert answer.headers["Content-Security-Policy"].startswith("sandbox allow-scripts")
        assert get(server, "/report").status == 403
    finally:
        del server.documents["/report"]


def test_no_client_opens_a_tunnel_or_sends_a_file(server: GuardedServer) -> None:
    handled = {kind.__name__ for kind in vars(vars(server.viser)["_websock_server"])["_incoming_handlers"]}
    assert "GuiUpdateMessage" in handled
    assert not handled & {"ShareUrlRequest", "ShareUrlDisconnect", "FileTransferStartUpload", "FileTransferPart"}


def test_a_taken_port_is_named(server: GuardedServer, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=f"port {server.port} of 127.0.0.1 cannot be served"):
        GuardedServer(server.port)
    with pytest.raises(InputError, match="port 65536"):
        GuardedServer(65536)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        monkeypatch.setenv("_VISER_PORT_OVERRIDE", str(free.getsockname()[1]))
        with pytest.raises(InputError, match=f"port {server.port}"):
            GuardedServer(server.port)


def test_another_version_of_viser_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "version", lambda _: "1.2.0")
    with pytest.raises(InputError, match=r"needs viser 1\.1\.1, and 1\.2\.0 is installed"):
        GuardedServer(0)
