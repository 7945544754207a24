"""Whom a request reaches, how much a provider may send, how long it may take, and what was seen on the wire."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, field
from functools import partial
from threading import Thread
from typing import Any, NoReturn, TypeVar
from urllib.parse import urljoin, urlsplit

from grs_agents.base.interrupts import is_interrupt_requested
from grs_agents.models.answer import ProviderFailure
from grs_agents.models.key_redaction import redact_keys

Result = TypeVar("Result")
_LOOK = 0.2
"""Seconds between two looks at whether the run was asked to end."""
LONGEST = 16 * 2**20
"""Bytes of one HTTP body, decoded. The longest context windows hold some 4 MB of text; JSON doubles that at worst."""
MOST_MARKS = 200_000
"""Braces, brackets and commas of one JSON document, those in its texts included. Clients make an object of every entry:
4 MB of empty ones cost a client 1 GB and 47 s. The longest replies hold half as many marks."""
_REDIRECTS = frozenset({301, 302, 303, 307, 308})
_FIRST_SERVER = "grs_first_server"
"""Extension of an httpx request, which a redirect inherits: the server that the client itself addressed."""
_LONGEST_SERVER = 200
"""Characters of a server's name in a message; the longest host name has 253."""


@dataclass
class ModelHttpCall:
    """A call that is under way, and what its client's HTTP traffic showed; nothing where that cannot be watched."""

    server: str = ""  # whom the last request went to: scheme, host and port
    status: int | None = None  # of its response; None before one arrives
    retry_after: str = ""  # that header
    over: bool = False  # whether nobody waits for it any more
    problem: ProviderFailure | None = None  # why its body was not read to the end
    body: bytearray = field(default_factory=bytearray)  # what was read of it


_call: ContextVar[ModelHttpCall | None] = ContextVar("call", default=None)
_first_server: ContextVar[str] = ContextVar("first_server", default="")
"""The server that the client of requests itself addressed: its sessions send redirects while they send."""


def limit_and_record_http_client(client: Any, by_line: bool = False) -> None:
    """Note what ``client`` sends and gets, and bound what it reads.

    It is one of httpx, of its successor httpx2, or of botocore, or makes sessions of requests (``get_session_fn``).

    Redirects to another server are refused: clients repeat the whole prompt with its pictures there, and all but the
    ``Authorization`` header.

    Args:
        by_line: each line of a body is a JSON document of its own.
    """
    if hasattr(client, "meta"):
        client.meta.events.register("before-send", partial(_send_botocore_request, client), unique_id="grs")
        return
    if hasattr(client, "get_session_fn"):
        client.get_session_fn = partial(_make_watched_session, client.get_session_fn, by_line)
        return
    client.headers["accept-encoding"] = "gzip, deflate"  # these grow at most 1000 times, so a chunk stays small
    hooks: dict[str, list[Any]] = client.event_hooks
    if _store_server_url not in hooks["request"]:  # LangChain shares a client among models
        watch = partial(_limit_and_record_response, by_line)
        client.event_hooks = {
            "request": [*hooks["request"], _store_server_url],
            "response": [*hooks["response"], watch],
        }


def _store_server_url(request: Any) -> None:
    server = f"{request.url.scheme}://{request.url.netloc.decode()}"
    first: str = request.extensions.setdefault(_FIRST_SERVER, server)
    if server not in (first, first.replace("http://", "https://", 1)):
        _refuse_redirect(first, server)
    if (call := _call.get()) is not None:
        call.server, call.status, call.retry_after = server, None, ""


def _refuse_redirect(first: str, server: str) -> NoReturn:
    """Raises ProviderFailure, also where the client makes something else of it."""
    message = f"the model's server {first} redirects to {redact_keys(server)[:_LONGEST_SERVER]}, which was sent nothing"
    problem = ProviderFailure("redirected", message, "name that server with models.<role>.base_url if you trust it")
    if (call := _call.get()) is not None:
        call.problem = problem
    raise problem


def _limit_and_record_response(by_line: bool, response: Any) -> None:
    if (call := _call.get()) is not None:
        call.status, call.retry_after = response.status_code, response.headers.get("retry-after") or ""
    response.iter_bytes = partial(_read_limited_chunks, response.iter_bytes, by_line)


def _make_watched_session(make: Callable[[], Any], by_line: bool) -> Any:
    session = make()
    session.headers["accept-encoding"] = "gzip, deflate"
    session.hooks["response"].append(partial(_limit_and_record_requests_response, by_line))
    session.send = partial(_store_server_url_and_send, session.send)
    return session


def _store_server_url_and_send(send: Callable[..., Any], request: Any, **named: Any) -> Any:
    url = urlsplit(str(request.url))
    default = ":443" if url.scheme == "https" else ":80"
    server = f"{url.scheme}://{url.netloc.rpartition('@')[2].lower().removesuffix(default)}"
    first = _first_server.get() or server
    if server not in (first, first.replace("http://", "https://", 1)):
        _refuse_redirect(first, server)
    if (call := _call.get()) is not None:
        call.server, call.status, call.retry_after = server, None, ""
    token = _first_server.set(first)
    try:
        return send(request, **named)
    finally:
        _first_server.reset(token)


def _limit_and_record_requests_response(by_line: bool, response: Any, **_: Any) -> None:
    if (call := _call.get()) is not None:
        call.status, call.retry_after = response.status_code, response.headers.get("retry-after") or ""
    response.iter_content = partial(_read_limited_chunks, response.iter_content, by_line)


def _send_botocore_request(client: Any, request: Any, **_: Any) -> Any:
    """Send in botocore's place: it reads a body as a whole, however long, before it tells anyone."""
    call = _call.get() or ModelHttpCall()
    call.server, call.status, call.retry_after = client.meta.endpoint_url, None, ""
    request.stream_output = True
    response = client._endpoint.http_session.send(request)
    if response.status_code in _REDIRECTS:  # botocore follows none
        target = urlsplit(urljoin(request.url, response.headers.get("location") or ""))
        _refuse_redirect(call.server, f"{target.scheme}://{target.netloc}")
    call.status, call.retry_after = response.status_code, response.headers.get("retry-after") or ""
    response._content = b"".join(_read_limited_chunks(response.raw.stream, False))
    return response


def _read_limited_chunks(
    read: Callable[..., Iterator[bytes]], by_line: bool, *sizes: int, **named: int
) -> Iterator[bytes]:
    call = _call.get()
    if call is not None:
        call.body.clear()  # of an earlier response
    length = marks = 0
    for chunk in read(*sizes, **named):
        length += len(chunk)
        line = chunk.rfind(b"\n") if by_line else -1
        marks = (marks if line < 0 else 0) + sum(chunk.count(mark, line + 1) for mark in (b"{", b"[", b","))
        if length > LONGEST or marks > MOST_MARKS:
            most = f"{LONGEST / 2**20:.0f} MB" if length > LONGEST else f"{MOST_MARKS:,} JSON entries"
            message = f"the model's server {call.server if call else ''} sends more than {most} in one reply"
            problem = ProviderFailure("too_long", message, "check models.<role>.base_url, or use another model")
            if call is not None:
                call.problem = problem
            raise problem
        if call is not None and call.over:
            raise TimeoutError("nobody waits for this reply any more")
        if call is not None:
            call.body += chunk
        yield chunk


def call_with_timeout(seconds: float | None, ask: Callable[[], Result], call: ModelHttpCall) -> Result:
    """What ``ask`` returns, waiting at most so many seconds in all; None waits as long as it takes.

    A client's own time-out holds for each read, so a server that sends a byte now and then never meets it. The call
    runs in a thread; after a time-out that thread ends with the next bytes that arrive.

    Args:
        call: filled in with what was seen of it.

    Raises:
        TimeoutError: it took longer.
        ProviderFailure: the body was too long, whatever the client made of that.
    """
    future = Future[Result]()
    context = copy_context()
    context.run(_call.set, call)

    def resolve_future_with_reply() -> None:
        try:
            future.set_result(context.run(ask))
        except BaseException as error:  # raised again where the result is waited for
            future.set_exception(error)
            if not isinstance(error, Exception):
                raise

    try:
        if seconds is None:
            return context.run(ask)
        Thread(target=resolve_future_with_reply, name="model-call", daemon=True).start()
        return _wait_for_result(future, seconds)
    except Exception as error:
        if call.problem is not None:
            raise call.problem from error
        if seconds is not None and not future.done():
            raise TimeoutError(f"no whole reply in {seconds:.3g} s") from error
        raise
    finally:
        call.over = True


def _wait_for_result(future: Future[Result], seconds: float) -> Result:
    """The result within so many seconds, unless the run was asked to end: of that only the main thread is told."""
    end = time.monotonic() + seconds
    while not wait([future], timeout=max(0.0, min(_LOOK, end - time.monotonic()))).done:
        if is_interrupt_requested():
            raise KeyboardInterrupt
        if time.monotonic() >= end:
            raise TimeoutError
    return future.result()
