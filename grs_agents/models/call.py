"""A call of a chat model with a total deadline, bounded retries, a bounded reply, and a common error type for
providers."""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from functools import partial
from inspect import signature
from threading import Thread
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar
from urllib.parse import urljoin, urlsplit

from grs_agents.base.errors import GrsError
from grs_agents.base.interrupts import is_interrupt_requested
from grs_agents.models.answer import (
    Answer,
    FailureKind,
    ProviderFailure,
    ReplyProblem,
    answer_from_completion,
    answer_from_message,
    require_complete_answer,
)
from grs_agents.models.key_redaction import redact_keys

if TYPE_CHECKING:
    from langchain_core.language_models.chat_models import BaseChatModel
    from langchain_core.messages import AIMessage, BaseMessage
    from langchain_core.runnables import Runnable

Result = TypeVar("Result")
LONGEST = 16 * 2**20
"""Bytes of an HTTP body, decoded. The longest context windows hold some 4 MB of text; JSON doubles that at worst."""
MOST_MARKS = 200_000
"""Braces, brackets and commas of a JSON document, including those inside its strings. Clients build an object for every
entry: 4 MB of empty entries cost a client 1 GB and 47 s, so ``LONGEST`` alone does not bound memory. The longest
replies hold half as many marks."""
RETRYABLE_STATUS = frozenset({408, 409, 425, 429, 500, 502, 503, 504, 529})
_INTERRUPT_POLL = 0.2
"""Seconds between two checks for an interrupt."""
_LONGEST_ERROR_TEXT = 300
_LONGEST_SERVER = 200
"""Characters of a server's name in a message; the longest host name has 253."""
_REDIRECTS = frozenset({301, 302, 303, 307, 308})
_FIRST_SERVER = "grs_first_server"
"""Extension of an httpx request, which a redirect inherits: the server that the client itself addressed."""

_LATER = "try again later, or name another model to ask then: models.<role> = [FIRST, SECOND]"
_BY_STATUS: Mapping[int, tuple[FailureKind, str]] = {
    401: ("credentials", "the key is not accepted: check the variable that models.<role>.key_variable names"),
    402: ("quota", "check the account"),
    403: ("credentials", "the key may not use this model: check the account"),
    404: ("not_found", "no such model or endpoint: check models.<role>.model and base_url"),
    413: ("prompt_too_long", "the prompt is too long for this model: use another model"),
    429: ("rate_limit", _LATER),
}
_STATUS_OF_LANGCHAIN_ERROR: Mapping[str, int] = {
    "ModelRateLimitError": 429,
    "ModelAPIError": 500,
    "ModelAuthenticationError": 401,
    "ModelPermissionDeniedError": 403,
    "ModelNotFoundError": 404,
    "ModelInvalidRequestError": 400,
}
"""HTTP status of LangChain's error classes, if neither the wire nor the error has a status."""
_NO_CONNECTION = frozenset(
    {"ConnectError", "ConnectTimeout", "ConnectTimeoutError", "ConnectionRefusedError", "gaierror"}
    | {"EndpointConnectionError", "NameResolutionError", "ProxyError"}
)
_TRANSPORT = ("Timeout", "Connect", "Connection", "Protocol", "ReadError", "WriteError", "Transport")
_MALFORMED = (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError)
"""Errors that clients raise over an answer that breaks the provider's protocol."""
_INCOMPLETE = frozenset({"LengthFinishReasonError", "ContentFilterFinishReasonError"})
"""Errors that OpenAI's client raises over an incomplete reply, if a schema was sent."""
_MAY_REFUSE_SCHEMA = ("refused_request", "not_found", "server_error", "client_error")
"""Failures of requests with a JSON schema by servers without structured output: 400 and 422 of most; 404 of routers
without a server for it; 501."""


@dataclass(frozen=True)
class Retries:
    """Limits of the tries of a call."""

    tries: int = 3  # calls in all
    # seconds from the first request to the last byte of the reply, over all tries and pauses; None for no limit
    deadline: float | None = 300.0
    first: float = 1.0  # seconds before the second try, doubled each time, unless the provider asks for a wait
    sleep: Callable[[float], None] = time.sleep  # waits for a number of seconds


@dataclass
class SchemaSupport:
    """Support of a model for replies by a JSON schema; assumed until the model refuses one."""

    refusal: str = ""  # empty while the schema is sent


@dataclass
class ModelHttpCall:
    """State of a running call as seen in its client's HTTP traffic; empty if the client cannot be watched."""

    server: str = ""  # scheme, host and port of the last request
    status: int | None = None  # of its response; None before one arrives
    retry_after: str = ""  # header of that response
    over: bool = False  # the caller has stopped waiting
    problem: ProviderFailure | None = None  # the reason why its body was not read to the end
    body: bytearray = field(default_factory=bytearray)  # bytes read so far


_running_call: ContextVar[ModelHttpCall | None] = ContextVar("running_call", default=None)
_first_server: ContextVar[str] = ContextVar("first_server", default="")
"""The server that a client of ``requests`` itself addressed: its sessions send redirects while they send."""


def invoke_with_retries(
    model: "BaseChatModel",
    messages: Sequence["BaseMessage"],
    retries: Retries | None = None,
    schema: Mapping[str, Any] | None = None,
    support: SchemaSupport | None = None,
) -> Answer:
    """Ask ``model`` for a usable reply, returned without the keys that this process knows.

    The model's own retries are switched off.

    Args:
        schema: JSON schema of the reply, for models with structured output; the others reply as the prompt says.
        support: remembers a refused schema between calls.

    Raises:
        ReplyProblem: the reply is empty, refused, cut off or no text.
        ProviderFailure: no reply arrived in so many tries or seconds, or the provider refuses the request for good.
    """
    limits = retries or Retries()
    if schema is None:
        return require_complete_answer(request_message(model, messages, limits)[1])
    return require_complete_answer(
        request_structured_message(model, messages, limits, schema, support or SchemaSupport())[1]
    )


def request_structured_message(
    model: "BaseChatModel",
    messages: Sequence["BaseMessage"],
    retries: Retries,
    schema: Mapping[str, Any],
    support: SchemaSupport,
) -> tuple["AIMessage", Answer]:
    """Ask ``model`` by its provider's structured output; without it as ``request_message`` does.

    A refused schema costs no reply: the request is repeated without it, and ``support`` keeps the refusal if that
    succeeds.

    Returns:
        The message, whose content is the JSON text, and its content, complete or not.
    """
    if support.refusal:
        return request_message(model, messages, retries)
    strict = {"strict": True} if "strict" in signature(model.with_structured_output).parameters else {}
    try:
        structured = model.with_structured_output(dict(schema), **strict)
    except (NotImplementedError, ValueError, TypeError, ImportError):  # the first of LangChain's base class
        return request_message(model, messages, retries)
    # The model with the schema bound, before its parser. `include_raw` would ask it in a pool of threads, which the
    # process joins at its end even if the user interrupts it.
    asked: Any = getattr(structured, "first", structured)
    try:
        return request_message(asked | _arguments_as_content, messages, retries, _may_stream(model))
    except ProviderFailure as failure:
        if failure.retryable or failure.kind not in _MAY_REFUSE_SCHEMA:
            raise
        reply = request_message(model, messages, retries)  # raises if the schema was not the cause
        support.refusal = failure.message
        return reply


def _arguments_as_content(message: "AIMessage") -> "AIMessage":
    """The message; the arguments of a tool call, by which some providers bind a schema, become its content."""
    if not message.tool_calls and not message.invalid_tool_calls:
        return message
    calls = [json.dumps(call["args"], ensure_ascii=False) for call in message.tool_calls]
    calls += [call["args"] or "" for call in message.invalid_tool_calls]
    return message.model_copy(update={"content": calls[0], "tool_calls": [], "invalid_tool_calls": []})


def _may_stream(model: "BaseChatModel") -> bool:
    from langchain_core.language_models.chat_models import BaseChatModel

    return any(getattr(type(model), name) is not getattr(BaseChatModel, name) for name in ("_stream", "_astream"))


def request_message(
    model: "Runnable[Any, AIMessage]",
    messages: Sequence["BaseMessage"],
    retries: Retries,
    may_stream: bool | None = None,
) -> tuple["AIMessage", Answer]:
    """Ask ``model`` until a message arrives. Raises as ``invoke_with_retries`` does.

    Args:
        may_stream: the reply may be streamed, so that its end can get lost; told from the class of ``model`` if None.

    Returns:
        The message, and its content, complete or not.
    """
    end = time.monotonic() + (float("inf") if retries.deadline is None else retries.deadline)
    for attempt in range(1, retries.tries + 1):
        call = ModelHttpCall()
        left = None if retries.deadline is None else max(0.0, end - time.monotonic())
        try:
            message = call_with_timeout(left, lambda: model.invoke(list(messages)), call)
            answer = answer_from_message(message, bytes(call.body))
            if not answer.finish_reason:
                from langchain_core.language_models.chat_models import BaseChatModel

                bound = getattr(model, "bound", model)
                if may_stream is None:
                    may_stream = not isinstance(bound, BaseChatModel) or _may_stream(bound)
                if not may_stream:  # the last part of a streamed reply can get lost; a whole reply has ended
                    answer = replace(answer, finish_reason="stop")
            return message, answer
        except GrsError:
            raise
        except Exception as error:  # each provider raises its own
            failure = classify_provider_error(error, call, attempt)
            if not isinstance(failure, ProviderFailure) or not failure.retryable or attempt == retries.tries:
                raise failure from error
            requested = failure.retry_after
            pause = retries.first * 2 ** (attempt - 1) if requested is None else requested
            if time.monotonic() + pause >= end:
                if requested is not None:
                    beyond = f"to be asked again in {pause:.0f} s, beyond the deadline of {retries.deadline:g} s"
                    message = f"{failure.message}; it is {beyond}"
                    failure = ProviderFailure(failure.kind, message, failure.remedy, retry_after=requested)
                raise failure from error
            retries.sleep(pause)
    raise GrsError("no try was allowed", "set Retries.tries to 1 or more")


def call_with_timeout(seconds: float | None, ask: Callable[[], Result], call: ModelHttpCall) -> Result:
    """Call ``ask`` and wait at most ``seconds`` in all for its result; None sets no limit.

    A client's time-out holds for each read, so a server that sends single bytes never meets it. The call runs in a
    thread, which ends with the first bytes that arrive after the time-out.

    Args:
        call: filled in from its HTTP traffic.

    Raises:
        TimeoutError: no result arrived in time.
        ProviderFailure: the body was too long, or a redirect was refused.
    """
    future = Future[Result]()
    context = copy_context()
    context.run(_running_call.set, call)

    def resolve_future_with_reply() -> None:
        try:
            future.set_result(context.run(ask))
        except BaseException as error:  # raised again by future.result()
            future.set_exception(error)
            if not isinstance(error, Exception):
                raise

    try:
        if seconds is None:
            return context.run(ask)
        Thread(target=resolve_future_with_reply, name="model-call", daemon=True).start()
        end = time.monotonic() + seconds
        while not wait([future], timeout=max(0.0, min(_INTERRUPT_POLL, end - time.monotonic()))).done:
            if is_interrupt_requested():  # the signal reaches the main thread alone
                raise KeyboardInterrupt
            if time.monotonic() >= end:
                raise TimeoutError
        return future.result()
    except Exception as error:
        if call.problem is not None:
            raise call.problem from error
        if seconds is not None and not future.done():
            raise TimeoutError(f"no whole reply in {seconds:.3g} s") from error
        raise
    finally:
        call.over = True


def classify_provider_error(error: Exception, call: ModelHttpCall, tries: int) -> ProviderFailure | ReplyProblem:
    """Convert an error of a provider's client.

    Args:
        error: as the client raised it.
        call: the HTTP traffic of that call.
        tries: number of calls made, including this call.
    """
    if type(error).__name__ in _INCOMPLETE:
        try:
            require_complete_answer(answer_from_completion(bytes(call.body)))
        except ReplyProblem as problem:
            return problem
    server = f"the model's server {call.server}".rstrip()
    after = f" in {tries} tries" if tries > 1 else ""
    status = _http_status_code(error, call)
    if status is not None:
        message = f"{server} answers {status}{after}: {_redacted_error_text(error)}"
        details = f"{error} {getattr(error, 'code', '')} {getattr(error, 'body', '')}"
        if status in (400, 403) and ("content_filter" in details or "content_policy" in details):
            return ReplyProblem("refusal", f"the model refused to answer: {message}", "rephrase the prompt")
        if "insufficient_quota" in details:
            return ProviderFailure("quota", message, "check the account")
        retryable = status in RETRYABLE_STATUS
        default: tuple[FailureKind, str] = ("server_error", _LATER)
        if not retryable and status < 500:
            default = ("refused_request", "check the model's name, its arguments and what it can read")
        kind, remedy = _BY_STATUS.get(status, default)
        return ProviderFailure(
            kind, message, remedy, retryable, retry_after_seconds(error, call) if retryable else None
        )

    chain: list[BaseException] = [error]
    while (cause := chain[-1].__cause__ or chain[-1].__context__) is not None:
        chain.append(cause)
    root = _redacted_error_text(chain[-1])
    if {type(cause).__name__ for cause in chain} & _NO_CONNECTION:
        remedy = "start that server, or check the network and models.<role>.base_url"
        return ProviderFailure("unreachable", f"{server} cannot be reached{after}: {root}", remedy, retryable=True)
    kinds = [kind.__name__ for cause in chain for kind in type(cause).__mro__]
    if any("Timeout" in name for name in kinds):
        message = f"{server} gives no answer{after}: {_redacted_error_text(error)}"
        remedy = "raise models.<role>.timeout, or use a faster model"
        return ProviderFailure("deadline", message, remedy, retryable=True)
    if isinstance(error, OSError) or any(word in name for name in kinds for word in _TRANSPORT):
        return ProviderFailure("broken_off", f"{server} breaks off its answer{after}: {root}", _LATER, retryable=True)

    described = f"{type(error).__name__}: {_redacted_error_text(error)}"
    if call.status is not None or isinstance(error, _MALFORMED):  # an answer came, and the client could not read it
        message = f"{server} sends what is no reply, malformed{after} ({described})"
        return ProviderFailure("malformed", message, "check models.<role>.base_url", retryable=True)
    return ProviderFailure(
        "client_error", f"the model cannot be asked ({described})", "see the provider's documentation"
    )


def _http_status_code(error: Exception, call: ModelHttpCall) -> int | None:
    classes = {kind.__name__ for kind in type(error).__mro__}
    if "ContextOverflowError" in classes:
        return 413
    if call.status is not None and call.status >= 400:
        return call.status
    for name in ("status_code", "code", "http_status"):
        value = getattr(error, name, None)
        if isinstance(value, int) and value >= 400:
            return value
    return next((status for name, status in _STATUS_OF_LANGCHAIN_ERROR.items() if name in classes), None)


def _redacted_error_text(error: BaseException) -> str:
    """The message of ``error`` without keys, which are removed before the text is cut, since a cut may halve a key."""
    text = " ".join(redact_keys(str(error)).split())
    return text[:_LONGEST_ERROR_TEXT] or type(error).__name__


def retry_after_seconds(error: BaseException, call: ModelHttpCall) -> float | None:
    """The seconds that the response's ``Retry-After`` header asks for, or None."""
    headers: Any = getattr(getattr(error, "response", None), "headers", None)
    value = (call.retry_after or str((headers.get("retry-after") if headers is not None else "") or "")).strip()
    if not value:
        return None
    with suppress(ValueError):
        return max(0.0, float(value))
    try:
        moment = parsedate_to_datetime(value)
    except ValueError:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())


def limit_and_record_http_client(client: Any, by_line: bool = False) -> None:
    """Record the requests and responses of ``client`` in the running ``ModelHttpCall``, and bound the bodies it reads.

    Redirects to another server are refused: clients repeat the whole prompt with its pictures there, and all headers
    but ``Authorization``.

    Args:
        client: of httpx, of its successor httpx2, of botocore, or a maker of requests sessions (``get_session_fn``).
        by_line: each line of a body is a JSON document.
    """
    if hasattr(client, "meta"):
        client.meta.events.register("before-send", partial(_send_botocore_request, client), unique_id="grs")
    elif hasattr(client, "get_session_fn"):
        client.get_session_fn = partial(_make_watched_session, client.get_session_fn, by_line)
    else:
        client.headers["accept-encoding"] = "gzip, deflate"  # these grow at most 1000 times, so a chunk stays small
        hooks: dict[str, list[Any]] = client.event_hooks
        if _record_httpx_request not in hooks["request"]:  # LangChain shares a client among models

            def limit_response(response: Any) -> None:
                _record_response(response)
                response.iter_bytes = partial(_read_limited_chunks, response.iter_bytes, by_line)

            client.event_hooks = {
                "request": [*hooks["request"], _record_httpx_request],
                "response": [*hooks["response"], limit_response],
            }


def _record_httpx_request(request: Any) -> None:
    server = f"{request.url.scheme}://{request.url.netloc.decode()}"
    _record_request(server, request.extensions.setdefault(_FIRST_SERVER, server))


def _make_watched_session(make_session: Callable[[], Any], by_line: bool) -> Any:
    session = make_session()
    send_unwatched = session.send

    def send(request: Any, **named: Any) -> Any:
        url = urlsplit(str(request.url))
        default = ":443" if url.scheme == "https" else ":80"
        server = f"{url.scheme}://{url.netloc.rpartition('@')[2].lower().removesuffix(default)}"
        first = _first_server.get() or server
        _record_request(server, first)
        token = _first_server.set(first)
        try:
            return send_unwatched(request, **named)
        finally:
            _first_server.reset(token)

    def limit_response(response: Any, **_: Any) -> None:
        _record_response(response)
        response.iter_content = partial(_read_limited_chunks, response.iter_content, by_line)

    session.headers["accept-encoding"] = "gzip, deflate"
    session.hooks["response"].append(limit_response)
    session.send = send
    return session


def _send_botocore_request(client: Any, request: Any, **_: Any) -> Any:
    """Send in botocore's place: it reads a body as a whole, however long, before it reports a response."""
    server: str = client.meta.endpoint_url
    _record_request(server, server)
    request.stream_output = True
    response = client._endpoint.http_session.send(request)
    if response.status_code in _REDIRECTS:  # botocore follows none
        target = urlsplit(urljoin(request.url, response.headers.get("location") or ""))
        _refuse_redirect(server, f"{target.scheme}://{target.netloc}")
    _record_response(response)
    response.raw.stream = partial(_read_limited_chunks, response.raw.stream, False)  # which response.content reads
    return response


def _current_call() -> ModelHttpCall:
    return _running_call.get() or ModelHttpCall()


def _record_request(server: str, first: str) -> None:
    if server not in (first, first.replace("http://", "https://", 1)):
        _refuse_redirect(first, server)
    call = _current_call()
    call.server, call.status, call.retry_after = server, None, ""


def _record_response(response: Any) -> None:
    call = _current_call()
    call.status, call.retry_after = response.status_code, response.headers.get("retry-after") or ""


def _refuse_redirect(first: str, server: str) -> NoReturn:
    """Raises ProviderFailure, also kept in the call, since some clients replace it by another error."""
    message = f"the model's server {first} redirects to {redact_keys(server)[:_LONGEST_SERVER]}, which was sent nothing"
    problem = ProviderFailure("redirected", message, "name that server with models.<role>.base_url if you trust it")
    _current_call().problem = problem
    raise problem


def _read_limited_chunks(
    read: Callable[..., Iterator[bytes]], by_line: bool, *sizes: int, **named: int
) -> Iterator[bytes]:
    call = _current_call()
    call.body.clear()  # of an earlier response
    length = marks = 0
    for chunk in read(*sizes, **named):
        length += len(chunk)
        line = chunk.rfind(b"\n") if by_line else -1
        marks = (marks if line < 0 else 0) + sum(chunk.count(mark, line + 1) for mark in (b"{", b"[", b","))
        if length > LONGEST or marks > MOST_MARKS:
            most = f"{LONGEST / 2**20:.0f} MB" if length > LONGEST else f"{MOST_MARKS:,} JSON entries"
            message = f"the model's server {call.server} sends more than {most} in one reply"
            call.problem = ProviderFailure("too_long", message, "check models.<role>.base_url, or use another model")
            raise call.problem
        if call.over:
            raise TimeoutError("nobody waits for this reply any more")
        call.body += chunk
        yield chunk
