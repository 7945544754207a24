"""What each error of a provider's client comes to: one type, whoever's client raised it."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any

from langchain_core import exceptions as langchain_errors

from grs_agents.models.answer import FailureKind, ProviderFailure, ReplyProblem
from grs_agents.models.key_redaction import redact_keys
from grs_agents.models.reply_limits import ModelHttpCall

RETRYABLE_STATUS = frozenset({408, 409, 425, 429, 500, 502, 503, 504, 529})
_LATER = "try again later, or name another model to ask then: models.<role> = [FIRST, SECOND]"
_URL = "start that server, or check the network and models.<role>.base_url"
_BY_STATUS: Mapping[int, tuple[FailureKind, str]] = {
    401: ("credentials", "the key is not accepted: check the variable that models.<role>.key_variable names"),
    402: ("quota", "check the account"),
    403: ("credentials", "the key may not use this model: check the account"),
    404: ("not_found", "no such model or endpoint: check models.<role>.model and base_url"),
    413: ("prompt_too_long", "the prompt is too long for this model: use another model"),
    429: ("rate_limit", _LATER),
}
_BY_TYPE: Mapping[type[Exception], int] = {
    langchain_errors.ModelRateLimitError: 429,
    langchain_errors.ModelAPIError: 500,
    langchain_errors.ModelAuthenticationError: 401,
    langchain_errors.ModelPermissionDeniedError: 403,
    langchain_errors.ModelNotFoundError: 404,
    langchain_errors.ModelInvalidRequestError: 400,
}
"""What LangChain's own errors say where nothing else tells a status."""
_NO_CONNECTION = frozenset(
    {"ConnectError", "ConnectTimeout", "ConnectTimeoutError", "ConnectionRefusedError", "gaierror"}
    | {"EndpointConnectionError", "NameResolutionError", "ProxyError"}
)
_TRANSPORT = ("Timeout", "Connect", "Connection", "Protocol", "ReadError", "WriteError", "Transport")
_MALFORMED = (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError)
"""What clients raise over an answer that is not what the provider's protocol says."""


def classify_provider_error(error: Exception, call: ModelHttpCall, tries: int) -> ProviderFailure | ReplyProblem:
    """What ``error`` comes to.

    Args:
        error: what a client raised.
        call: what was seen of that call on the wire.
        tries: how many calls were made, this one included.
    """
    server = f"the model's server {call.server}".rstrip()
    status = 413 if isinstance(error, langchain_errors.ContextOverflowError) else _http_status_code(error, call)
    after = f" in {tries} tries" if tries > 1 else ""
    if status is not None:
        return _classify_status(status, f"{server} answers {status}{after}: {_redacted_error_text(error)}", error, call)
    failure = _classify_transport_error(error, server, after)
    if failure is not None:
        return failure
    said = f"{type(error).__name__}: {_redacted_error_text(error)}"
    if call.status is not None or isinstance(error, _MALFORMED):  # an answer came, and the client could not read it
        what = f"{server} sends what is no reply, malformed{after} ({said})"
        return ProviderFailure("malformed", what, "check models.<role>.base_url", retryable=True)
    return ProviderFailure("client_error", f"the model cannot be asked ({said})", "see the provider's documentation")


def _classify_transport_error(error: Exception, server: str, after: str) -> ProviderFailure | None:
    """The failure where the connection is at fault; None where it is not."""
    chain = list(_error_chain(error))
    names = {type(one).__name__ for one in chain}
    said = _redacted_error_text(chain[-1])
    if names & _NO_CONNECTION:
        return ProviderFailure("unreachable", f"{server} cannot be reached{after}: {said}", _URL, retryable=True)
    kinds = [kind.__name__ for one in chain for kind in type(one).__mro__]
    if any("Timeout" in name for name in kinds):
        remedy = "raise models.<role>.timeout, or use a faster model"
        what = f"{server} gives no answer{after}: {_redacted_error_text(error)}"
        return ProviderFailure("deadline", what, remedy, retryable=True)
    if isinstance(error, OSError) or any(word in name for name in kinds for word in _TRANSPORT):
        return ProviderFailure("broken_off", f"{server} breaks off its answer{after}: {said}", _LATER, retryable=True)
    return None


def _classify_status(status: int, what: str, error: Exception, call: ModelHttpCall) -> ProviderFailure | ReplyProblem:
    details = f"{error} {getattr(error, 'code', '')} {getattr(error, 'body', '')}"
    if status in (400, 403) and ("content_filter" in details or "content_policy" in details):
        return ReplyProblem("refusal", f"the model refused to answer: {what}", "rephrase the prompt")
    if "insufficient_quota" in details:
        return ProviderFailure("quota", what, "check the account")
    retryable = status in RETRYABLE_STATUS
    other: tuple[FailureKind, str] = ("refused_request", "check the model's name, its arguments and what it can read")
    kind, remedy = _BY_STATUS.get(status, ("server_error", _LATER) if retryable or status >= 500 else other)
    return ProviderFailure(kind, what, remedy, retryable, retry_after_seconds(error, call) if retryable else None)


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


def _http_status_code(error: BaseException, call: ModelHttpCall) -> int | None:
    if call.status is not None and call.status >= 400:
        return call.status
    for name in ("status_code", "code", "http_status"):
        value = getattr(error, name, None)
        if isinstance(value, int) and value >= 400:
            return value
    return next((status for kind, status in _BY_TYPE.items() if isinstance(error, kind)), None)


def _error_chain(error: BaseException | None) -> Iterator[BaseException]:
    """``error``, and what it was raised from, down to the root."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _redacted_error_text(error: BaseException) -> str:
    """What ``error`` says, without keys: these are removed before the text is cut, which might leave half of one."""
    text = " ".join(redact_keys(str(error)).split())
    return text[:300] or type(error).__name__
