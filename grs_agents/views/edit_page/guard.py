"""A server of viser on loopback that answers a single person.

viser itself binds to every address, takes the next port for a taken one, checks neither origin nor host, and lets any
client open a public tunnel. Here the socket is bound before viser starts, and each request for the page or its
websocket needs the host and origin of the page and a secret: a token in the first address, then a cookie.
"""

import hmac
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final
from urllib.parse import parse_qs

from grs_agents.base.errors import InputError

VISER: Final = "1.1.1"  # of which the guard is tested: it replaces a call inside viser
_REMEDY = 'pip install "grs-agents[edit]"'
_LOOPBACK: Final = "127.0.0.1"
_LARGEST_MESSAGE = 1 << 20  # bytes from a client: values of fields and poses, no files
_REFUSED_MESSAGES = ("ShareUrlRequest", "ShareUrlDisconnect", "FileTransferStartUpload", "FileTransferPart")
_PATCHING = threading.Lock()
_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
_DOCUMENT_POLICY = (
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; media-src data: blob:; font-src data:; frame-ancestors 'none'"
)
"""Policy of a document: it runs in an origin of its own, which reaches neither page nor websocket."""


def require_viser() -> None:
    """Raises InputError: viser is missing, or of a version that the guard is not tested with."""
    try:
        installed = version("viser")
    except PackageNotFoundError:
        raise InputError("the page needs viser, which is not installed", _REMEDY) from None
    if installed != VISER:
        raise InputError(f"the page needs viser {VISER}, and {installed} is installed", _REMEDY)


class GuardedServer:
    """A server of viser behind the guard.

    Attributes:
        viser: viser's server (`viser.ViserServer`).
        port: on 127.0.0.1.
        address: of the page, with the token.
        documents: HTML pages by path, such as ``/report``, served in a sandbox.
    """

    def __init__(self, port: int) -> None:
        """Serve on 127.0.0.1.

        Args:
            port: 0 for any free port.

        Raises:
            InputError: the port is taken or out of range, or viser is missing.
        """
        require_viser()
        self.documents: dict[str, bytes] = {}
        self._token = secrets.token_urlsafe(32)
        bound = _bind(port)
        self.port: int = bound.getsockname()[1]
        self._hosts = (f"{_LOOPBACK}:{self.port}", f"localhost:{self.port}")
        self._origins = tuple(f"http://{host}" for host in self._hosts)
        self._cookie = f"grs_edit_{self.port}"  # cookies of a host are common to its ports
        sockets = " ".join(f"ws://{host}" for host in self._hosts)
        self._policy = (
            "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
            f"style-src 'self' 'unsafe-inline' data:; connect-src 'self' data: blob: {sockets}; "
            "worker-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )
        self.viser = self._start_viser(bound)

    @property
    def address(self) -> str:
        """The address to open, with the token."""
        return f"http://{self._hosts[0]}/?token={self._token}"

    def stop(self) -> None:
        """Close the page."""
        self.viser.stop()

    def _start_viser(self, bound: socket.socket) -> Any:
        import rich

        rich.reconfigure(quiet=True)  # viser prints a panel whether it is asked to or not
        viser, messages = import_module("viser"), import_module("viser._messages")
        server: Any = import_module("websockets.asyncio.server")
        plain = server.serve

        def serve(handler: Any, host: Any, port: Any, *, process_request: Any, **options: Any) -> Any:
            del host, port
            options |= {"sock": bound, "max_size": _LARGEST_MESSAGE}
            return plain(handler, process_request=self._guard(process_request), **options)

        with _PATCHING:
            server.serve = serve
            try:
                started = viser.ViserServer(host=_LOOPBACK, port=self.port, verbose=False)
            finally:
                server.serve = plain
        for name in _REFUSED_MESSAGES:
            vars(started)["_websock_server"].unregister_handler(getattr(messages, name))
        return started

    def _guard(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def check(connection: Any, request: Any) -> Any:
            headers = request.headers
            path, _, query = request.path.partition("?")
            upgrade = bool(headers.get_all("Upgrade"))
            origins = headers.get_all("Origin")
            if len(headers.get_all("Host")) != 1 or headers["Host"] not in self._hosts:
                return _refuse(connection, HTTPStatus.FORBIDDEN, "this host is not the page's")
            if (upgrade or origins) and (len(origins) != 1 or origins[0] not in self._origins):
                return _refuse(connection, HTTPStatus.FORBIDDEN, "this origin is not the page's")
            if not upgrade and path == "/" and self._is_token(_first(parse_qs(query, max_num_fields=20), "token")):
                reply = _refuse(connection, HTTPStatus.SEE_OTHER, "")
                reply.headers["Location"] = "/"
                reply.headers["Set-Cookie"] = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                return reply
            if not any(self._is_token(value) for value in _cookie_values(headers.get_all("Cookie"), self._cookie)):
                return _refuse(connection, HTTPStatus.FORBIDDEN, "open the address that grs edit printed")
            if not upgrade and path in self.documents:
                reply = connection.respond(HTTPStatus.OK, "")
                reply.body = self.documents[path]
                del reply.headers["Content-Type"], reply.headers["Content-Length"]
                reply.headers["Content-Type"] = "text/html; charset=utf-8"
                reply.headers["Content-Length"] = str(len(reply.body))
                return _add_headers(reply, _DOCUMENT_POLICY)
            if path != "/":
                return _refuse(connection, HTTPStatus.NOT_FOUND, "there is no such page")
            reply = answer(connection, request)
            return None if reply is None else _add_headers(reply, self._policy)

        def guard(connection: Any, request: Any) -> Any:
            try:
                return check(connection, request)
            except ValueError:  # of a malformed query
                return _refuse(connection, HTTPStatus.BAD_REQUEST, "this request is malformed")

        return guard

    def _is_token(self, value: str) -> bool:
        return hmac.compare_digest(value.encode("utf-8", "replace"), self._token.encode())


def _bind(port: int) -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((_LOOPBACK, port))
        bound.listen(16)
    except (OSError, OverflowError) as error:
        bound.close()
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise InputError(
            f"port {port} of {_LOOPBACK} cannot be served: {reason}", "choose another with --port, or 0 for a free one"
        ) from error
    return bound


def _first(fields: Mapping[str, list[str]], name: str) -> str:
    return fields.get(name, [""])[0]


def _cookie_values(lines: list[str], name: str) -> list[str]:
    pairs = [pair.strip().partition("=") for line in lines for pair in line.split(";")]
    return [value for key, _, value in pairs if key == name]


def _refuse(connection: Any, status: HTTPStatus, reason: str) -> Any:
    return _add_headers(connection.respond(status, f"{reason}\n"), "default-src 'none'; frame-ancestors 'none'")


def _add_headers(reply: Any, policy: str) -> Any:
    for name, value in {**_HEADERS, "Content-Security-Policy": policy}.items():
        reply.headers[name] = value
    return reply
