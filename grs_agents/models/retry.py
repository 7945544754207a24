"""Ask a chat model with bounded retries, and refuse replies that only look complete."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any

from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import BaseMessage

from grs_agents.errors import GrsError
from grs_agents.models.answer import Answer, ReplyProblem, answer_from_message, require_complete_answer
from grs_agents.models.key_redaction import redact_keys
from grs_agents.models.reply_limits import call_with_timeout

RETRYABLE_STATUS = frozenset({408, 409, 425, 429, 500, 502, 503, 504, 529})
_PERMANENT = {
    400: "the provider refuses the request: check the model's name and what it can read",
    401: "the key is not accepted: check the key variable",
    403: "the key may not use this model: check the account",
    404: "no such model or endpoint: check models.<role>.model and base_url",
    413: "the prompt is too long for this model: use another model",
    422: "the provider refuses the request: check the model's name and base_url",
}
_TRANSPORT = ("Timeout", "Connect", "Connection", "RemoteProtocol", "ReadError", "WriteError", "Transport")
_MALFORMED = (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError)
"""What clients raise over an answer that is not what the provider's protocol says."""
DEADLINE = 120.0


@dataclass(frozen=True)
class Retries:
    """How long to keep trying."""

    tries: int = 3  # calls in all
    # seconds for each call, from the request to the last byte of the reply; None for as long as it takes
    deadline: float | None = DEADLINE
    first: float = 1.0  # seconds before the second try; doubled each time
    longest: float = 30.0  # the most seconds ever waited, whatever a Retry-After says
    sleep: Callable[[float], None] = time.sleep  # waits so many seconds

    def wait_before_retry(self, attempt: int, error: BaseException) -> None:
        """Wait before try ``attempt + 1`` (the first is 0), as long as the provider asks, within bounds."""
        asked = retry_after_seconds(error)
        self.sleep(min(self.longest, self.first * 2**attempt if asked is None else asked))


def invoke_with_retries(
    model: BaseChatModel, messages: Sequence[BaseMessage], retries: Retries | None = None
) -> Answer:
    """One usable reply, without the keys that this process knows; the model's own retries are switched off.

    Raises:
        ReplyProblem: the reply is empty, refused, cut off, too long or not what the provider's protocol says.
        GrsError: the provider cannot be reached in so many tries, or refuses the request for good.
    """
    bounds = retries or Retries()
    for attempt in range(bounds.tries):
        try:
            message = call_with_timeout(bounds.deadline, lambda: model.invoke(list(messages)))
            return require_complete_answer(answer_from_message(message))
        except GrsError:
            raise
        except Exception as error:  # each provider raises its own; all but the retryable end in one line
            if not _is_retryable_error(error):
                raise _make_permanent_error(error) from error
            if attempt + 1 == bounds.tries:
                raise _make_exhausted_error(error, bounds.tries) from error
            bounds.wait_before_retry(attempt, error)
    raise GrsError("no try was allowed", "set Retries.tries to 1 or more")


def retry_after_seconds(error: BaseException) -> float | None:
    """The seconds that a ``Retry-After`` header of the error's response asks for, or None."""
    headers: Any = getattr(getattr(error, "response", None), "headers", None)
    value = str(headers.get("retry-after") or "").strip() if headers is not None else ""
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


def _http_status_code(error: BaseException) -> int | None:
    for name in ("status_code", "code", "http_status"):
        value = getattr(error, name, None)
        if isinstance(value, int):
            return value
    return None


def _is_retryable_error(error: BaseException) -> bool:
    status = _http_status_code(error)
    if status is not None:
        quota = "insufficient_quota" in f"{error} {getattr(error, 'code', '')} {getattr(error, 'body', '')}"
        return status in RETRYABLE_STATUS and not quota
    names = [kind.__name__ for kind in type(error).__mro__]
    transport = any(word in name for name in names for word in _TRANSPORT) or isinstance(error, OSError)
    return transport or isinstance(error, _MALFORMED)


def _make_permanent_error(error: Exception) -> GrsError:
    status = _http_status_code(error)
    remedy = _PERMANENT.get(status or 0, "see the provider's documentation")
    what = f"the model's provider answers {status}" if status else f"the model cannot be asked ({type(error).__name__})"
    return GrsError(f"{what}: {_redacted_error_text(error)}", remedy)


def _make_exhausted_error(error: Exception, tries: int) -> GrsError:
    status = _http_status_code(error)
    if status is None and isinstance(error, _MALFORMED):
        said = f"{type(error).__name__}: {_redacted_error_text(error)}"
        what = f"the provider's answer is malformed in {tries} tries ({said})"
        return ReplyProblem("malformed", what, "check models.<role>.base_url")
    what = f"answers {status}" if status else f"gives no answer ({type(error).__name__})"
    return GrsError(
        f"the model's provider {what} in {tries} tries: {_redacted_error_text(error)}",
        "try again later, or use another model",
    )


def _redacted_error_text(error: Exception) -> str:
    """What ``error`` says, without keys: these are removed before the text is cut, which might leave half of one."""
    text = " ".join(redact_keys(str(error)).split())
    return text[:300] or type(error).__name__
