"""Ask a chat model with bounded retries, and refuse replies that only look complete."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any, Literal

from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, BaseMessage

from grs_agents.errors import GrsError

RETRYABLE_STATUS = frozenset({408, 409, 425, 429, 500, 502, 503, 504, 529})
_PERMANENT = {
    400: "the provider refuses the request: check the model's name and what it can read",
    401: "the key is not accepted: check the key variable",
    403: "the key may not use this model: check the account",
    404: "no such model or endpoint: check models.<role>.model and base_url",
    413: "the prompt is too long for this model: use another model",
    422: "the provider refuses the request: check the model's name and base_url",
}
_COMPLETE = frozenset({"stop", "end_turn", "stop_sequence", "eos"})
_CUT_OFF = frozenset({"length", "max_tokens"})
_TRANSPORT = ("Timeout", "Connect", "Connection", "RemoteProtocol", "ReadError", "WriteError", "Transport")
_MALFORMED = (ValueError, TypeError, KeyError, IndexError, AttributeError)

Kind = Literal["empty", "refusal", "length", "unfinished"]


class ReplyProblem(GrsError):
    """A reply that arrived but cannot be used; asking again may help.

    Attributes:
        kind: ``empty``, ``refusal``, ``length`` or ``unfinished`` (no finish reason: the stream was cut off).
    """

    def __init__(self, kind: Kind, message: str, remedy: str = "") -> None:
        super().__init__(message, remedy)
        self.kind = kind


@dataclass(frozen=True)
class Retries:
    """How long to keep trying.

    Attributes:
        tries: calls in all.
        first: seconds before the second try; doubled each time.
        longest: the most seconds ever waited, whatever a Retry-After says.
        sleep: waits so many seconds.
    """

    tries: int = 3
    first: float = 1.0
    longest: float = 30.0
    sleep: Callable[[float], None] = time.sleep

    def wait(self, attempt: int, error: BaseException) -> None:
        """Wait before try ``attempt + 1`` (the first is 0), as long as the provider asks, within bounds."""
        asked = retry_after(error)
        self.sleep(min(self.longest, self.first * 2**attempt if asked is None else asked))


def invoke(model: BaseChatModel, messages: Sequence[BaseMessage], retries: Retries | None = None) -> AIMessage:
    """One usable reply.

    Args:
        model: its own retries switched off.
        messages: the conversation.
        retries: bounds; by default three tries.

    Returns:
        The reply, with ``usage_metadata`` where the provider counts tokens.

    Raises:
        ReplyProblem: the reply is empty, refused, cut off at the length limit or has no finish reason.
        GrsError: the provider cannot be reached in so many tries, or refuses the request for good.
    """
    bounds = retries or Retries()
    for attempt in range(bounds.tries):
        try:
            return checked(model.invoke(list(messages)))
        except GrsError:
            raise
        except Exception as error:  # each provider raises its own; all but the retryable end in one line
            if not _retryable(error):
                raise _final(error) from error
            if attempt + 1 == bounds.tries:
                raise _gave_up(error, bounds.tries) from error
            bounds.wait(attempt, error)
    raise GrsError("no try was allowed", "set Retries.tries to 1 or more")


def checked(message: AIMessage) -> AIMessage:
    """``message`` if it is whole.

    Raises:
        ReplyProblem: it is not.
    """
    metadata = message.response_metadata
    reason = str(metadata.get("finish_reason") or metadata.get("stop_reason") or metadata.get("done_reason") or "")
    refusal = message.additional_kwargs.get("refusal")
    text = str(message.text)
    if refusal or reason.lower() in ("refusal", "content_filter", "safety", "prohibited_content", "blocklist"):
        raise ReplyProblem("refusal", f"the model refused to answer: {refusal or reason}", "rephrase the prompt")
    if reason.lower() in _CUT_OFF:
        raise ReplyProblem(
            "length", f"the reply was cut off after {len(text)} characters", "raise models.<role>.max_tokens"
        )
    if not text.strip():
        raise ReplyProblem("empty", f"the reply is empty (finish reason {reason or 'missing'})", "ask again")
    if reason.lower() not in _COMPLETE:
        raise ReplyProblem(
            "unfinished", f"the reply has finish reason {reason or 'none'}, so it may be cut off", "ask again"
        )
    return message


def retry_after(error: BaseException) -> float | None:
    """The seconds that a ``Retry-After`` header of the error's response asks for, or None."""
    headers: Any = getattr(getattr(error, "response", None), "headers", None)
    value = str(headers.get("retry-after") or "").strip() if headers is not None else ""
    if not value:
        return None
    try:
        return max(0.0, float(value))
    except ValueError:
        pass
    try:
        moment = parsedate_to_datetime(value)
    except ValueError:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())


def _status(error: BaseException) -> int | None:
    for name in ("status_code", "code", "http_status"):
        value = getattr(error, name, None)
        if isinstance(value, int):
            return value
    return None


def _retryable(error: BaseException) -> bool:
    status = _status(error)
    if status is not None:
        quota = "insufficient_quota" in f"{error} {getattr(error, 'code', '')} {getattr(error, 'body', '')}"
        return status in RETRYABLE_STATUS and not quota
    names = [kind.__name__ for kind in type(error).__mro__]
    transport = any(word in name for name in names for word in _TRANSPORT) or isinstance(error, OSError)
    return transport or isinstance(error, _MALFORMED)


def _final(error: Exception) -> GrsError:
    status = _status(error)
    remedy = _PERMANENT.get(status or 0, "see the provider's documentation")
    what = f"the model's provider answers {status}" if status else f"the model cannot be asked ({type(error).__name__})"
    return GrsError(f"{what}: {_short(error)}", remedy)


def _gave_up(error: Exception, tries: int) -> GrsError:
    status = _status(error)
    what = f"answers {status}" if status else f"gives no answer ({type(error).__name__})"
    return GrsError(
        f"the model's provider {what} in {tries} tries: {_short(error)}", "try again later, or use another model"
    )


def _short(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text[:300] or type(error).__name__
