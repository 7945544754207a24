"""Ask a chat model with bounded retries within one deadline, and refuse replies that only look complete."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from grs_agents.base.errors import GrsError
from grs_agents.models.answer import Answer, ProviderFailure, answer_from_message, require_complete_answer
from grs_agents.models.reply_limits import ModelHttpCall, call_with_timeout

if TYPE_CHECKING:
    from langchain_core.language_models.chat_models import BaseChatModel
    from langchain_core.messages import AIMessage, BaseMessage
    from langchain_core.runnables import Runnable

DEADLINE = 300.0
_RETURNED = "stop"
"""The finish reason of a reply whose model returned it as a whole and gave none."""


@dataclass(frozen=True)
class Retries:
    """How long to keep trying."""

    tries: int = 3  # calls in all
    # seconds from the first request to the last byte of the reply, all tries and the waits between them together; None
    # for as long as it takes
    deadline: float | None = DEADLINE
    first: float = 1.0  # seconds before the second try, doubled each time, where the provider asks for none
    sleep: Callable[[float], None] = time.sleep  # waits so many seconds


def invoke_with_retries(
    model: "BaseChatModel", messages: Sequence["BaseMessage"], retries: Retries | None = None
) -> Answer:
    """One usable reply, without the keys that this process knows; the model's own retries are switched off.

    Raises:
        ReplyProblem: the reply is empty, refused, cut off or no text.
        ProviderFailure: no reply arrived in so many tries or seconds, or the provider refuses the request for good.
    """
    return require_complete_answer(request_message(model, messages, retries or Retries())[1])


def request_message(
    model: "Runnable[Any, AIMessage]", messages: Sequence["BaseMessage"], retries: Retries
) -> tuple["AIMessage", Answer]:
    """The message that arrives, and what it holds, whole or not. Raises as ``invoke_with_retries`` does."""
    end = time.monotonic() + (float("inf") if retries.deadline is None else retries.deadline)
    for attempt in range(retries.tries):
        call = ModelHttpCall()
        left = None if retries.deadline is None else max(0.0, end - time.monotonic())
        try:
            message = call_with_timeout(left, lambda: model.invoke(list(messages)), call)
            return message, _make_complete_answer(model, message, bytes(call.body))
        except GrsError:
            raise
        except Exception as error:  # each provider raises its own
            from grs_agents.models.provider_errors import classify_provider_error

            failure = classify_provider_error(error, call, attempt + 1)
            if not isinstance(failure, ProviderFailure) or not failure.retryable or attempt + 1 == retries.tries:
                raise failure from error
            pause = retries.first * 2**attempt if failure.retry_after is None else failure.retry_after
            if time.monotonic() + pause >= end:
                raise _add_deadline_to_failure(failure, pause, retries) from error
            retries.sleep(pause)
    raise GrsError("no try was allowed", "set Retries.tries to 1 or more")


def _make_complete_answer(model: "Runnable[Any, AIMessage]", message: "AIMessage", body: bytes) -> Answer:
    """What ``message`` holds; one that ``model`` returned as a whole has ended."""
    answer = answer_from_message(message, body)
    return answer if answer.finish_reason or _may_stream_reply(model) else replace(answer, finish_reason=_RETURNED)


def _may_stream_reply(model: "Runnable[Any, AIMessage]") -> bool:
    """Whether a reply may come in pieces, of which the last can get lost; a class that returns it whole has it all."""
    from langchain_core.language_models.chat_models import BaseChatModel

    made = getattr(model, "bound", model)
    return not isinstance(made, BaseChatModel) or any(
        getattr(type(made), name) is not getattr(BaseChatModel, name) for name in ("_stream", "_astream")
    )


def _add_deadline_to_failure(failure: ProviderFailure, pause: float, retries: Retries) -> ProviderFailure:
    """``failure``, as what ends the call: the next try would begin after its deadline."""
    if failure.retry_after is None:
        return failure
    beyond = f"to be asked again in {pause:.0f} s, beyond the deadline of {retries.deadline:g} s"
    what = f"{failure.message}; it is {beyond}"
    return ProviderFailure(failure.kind, what, failure.remedy, retry_after=failure.retry_after)
