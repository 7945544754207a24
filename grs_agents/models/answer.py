"""What a model answered, as far as GRS uses it, and why an answer cannot be used."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

from grs_agents.base.errors import GrsError
from grs_agents.models.key_redaction import redact_keys
from grs_agents.models.reasoning import measure_reasoning, reasoning_remedy

if TYPE_CHECKING:
    from langchain_core.messages import AIMessage

_SPELLINGS = (
    *("finish_reason", "stop_reason", "done_reason", "stopReason", "finishReason", "completionReason"),
    "status",
)
"""Metadata keys of the finish reason, in the order in which they are tried: OpenAI and most others; Anthropic; Ollama;
Bedrock's three; OpenAI's Responses API."""
_CUT_OFF = frozenset(
    {"length", "max_length", "max_tokens", "max_new_tokens", "max_output_tokens", "max_completion_tokens"}
    | {"token_limit", "limit", "error_limit", "model_length", "incomplete"}
    | {"model_context_window_exceeded", "context_window_exceeded", "context_length_exceeded"}
)
_BROKEN_OFF = frozenset(
    {"error", "failed", "abort", "aborted", "cancelled", "canceled", "user_cancel", "timeout", "time_limit"}
    | {"network_error", "insufficient_system_resource", "not_finished", "in_progress", "queued", "pause_turn"}
    | {"malformed_model_output", "malformed_response", "malformed_tool_use", "malformed_function_call"}
    | {"unexpected_tool_call", "too_many_tool_calls", "load", "unload"}
)
_REFUSED = frozenset(
    {"refusal", "content_filter", "content_filtered", "guardrail_intervened", "safety", "prohibited_content"}
    | {"blocklist", "recitation", "spii", "language", "model_armor", "image_safety", "error_toxic", "sensitive"}
)
"""The names that providers have for a reply that is not whole, in lower case. All others are whole: servers write
`stop`, `end_turn`, `eos_token`, `COMPLETE`, `endoftext` or what they like."""
_MOST_TOKENS = 2**53
ASKED = "grs_asked"
"""Where a message's metadata tell which of several models answered, and which had failed."""

ReplyKind = Literal["empty", "refusal", "length", "unfinished", "malformed"]
"""``unfinished``: no finish reason, or that of an error; ``malformed``: what was written is no text."""
FailureKind = Literal[
    "unreachable",  # no connection could be made
    "broken_off",  # the connection ended in the middle of an answer
    "deadline",  # no whole reply in time
    "rate_limit",  # asked too often
    "server_error",  # the provider's own trouble
    "credentials",  # the key is not accepted, or may not use this model
    "quota",  # nothing is left of what was paid for
    "not_found",  # no such model or endpoint
    "redirected",  # to another server, which is not asked
    "prompt_too_long",
    "refused_request",  # for another reason
    "malformed",  # the answer is not what the provider's protocol says
    "too_long",  # the answer is larger than any reply
    "client_error",  # the client's package failed before anything was asked
]


@dataclass(frozen=True)
class Answer:
    """One reply."""

    text: str  # what the model wrote
    reasoning: int = 0  # characters that the server, or its client, set apart as the model's reasoning
    reasoning_field: str = ""  # where it put them, such as `reasoning_content`
    finish_reason: str = ""  # why it ended, in the provider's words; empty where it does not tell
    refusal: str = ""  # why the model refuses, where the provider tells that apart from the text
    encodable: bool = True  # whether UTF-8 can hold what the model wrote
    # input_tokens, output_tokens, cached_tokens: as the provider counts; 0 where it does not tell
    input_tokens: int = 0
    output_tokens: int = 0
    cached_tokens: int = 0
    cost: float | None = None  # US dollars; None where the provider does not tell
    model: str = ""  # which of several models answered; empty where there is one
    failed: tuple[str, ...] = ()  # those asked before it, each with what went wrong


class ProviderFailure(GrsError):
    """No reply arrived: the provider, not the model, is at fault, so telling the model what is wrong cannot help."""

    def __init__(
        self,
        kind: FailureKind,
        message: str,
        remedy: str = "",
        retryable: bool = False,
        retry_after: float | None = None,
    ) -> None:
        super().__init__(message, remedy)
        self.kind: FailureKind = kind
        self.retryable = retryable  # whether the same may go well a little later
        self.retry_after = retry_after  # seconds that the provider wants to be left alone; None where it says nothing


class ReplyProblem(GrsError):
    """A reply that arrived but cannot be used; asking again may help. ``answer`` is what could be read of it."""

    def __init__(self, kind: ReplyKind, message: str, remedy: str = "", answer: Answer | None = None) -> None:
        super().__init__(message, remedy)
        self.kind: ReplyKind = kind
        self.answer = answer


def answer_from_message(message: "AIMessage", body: bytes = b"") -> Answer:
    """What ``message`` holds, without keys. A client may have left out a part of the ``body`` that the server sent."""
    text, usage = str(message.text), message.usage_metadata
    metadata: Mapping[str, Any] = message.response_metadata
    reason = next((metadata[name] for name in _SPELLINGS if metadata.get(name)), "")
    if isinstance(reason, Mapping):  # SGLang's own interface
        reason = cast("Mapping[str, Any]", reason).get("type", "")
    if isinstance(details := metadata.get("incomplete_details"), Mapping):  # OpenAI's Responses API
        reason = cast("Mapping[str, Any]", details).get("reason") or reason
    field, reasoning = ("", 0) if text.strip() else measure_reasoning(message, body)
    asked: Mapping[str, Any] = metadata.get(ASKED, {})
    return Answer(
        text=redact_keys(text),
        reasoning=reasoning,
        reasoning_field=field,
        finish_reason=redact_keys(str(reason)),
        refusal=redact_keys(str(message.additional_kwargs.get("refusal") or "")),
        encodable=not any("\ud800" <= letter <= "\udfff" for letter in text),
        input_tokens=_valid_token_count(usage["input_tokens"]) if usage else 0,
        output_tokens=_valid_token_count(usage["output_tokens"]) if usage else 0,
        cached_tokens=_valid_token_count(usage.get("input_token_details", {}).get("cache_read", 0)) if usage else 0,
        cost=_cost_from_metadata(metadata),
        model=asked.get("model", ""),
        failed=tuple(asked.get("failed", ())),
    )


def require_complete_answer(answer: Answer) -> Answer:
    """``answer`` if it is whole, else a ``ReplyProblem`` is raised."""
    reason = answer.finish_reason.rpartition(".")[2].lower().replace("-", "_")  # also FinishReason.MAX_TOKENS
    apart = (
        f": the server put {answer.reasoning:,} characters into {answer.reasoning_field}" if answer.reasoning else ""
    )
    if answer.refusal or reason in _REFUSED:
        what = f"the model refused to answer: {answer.refusal or answer.finish_reason}"
        raise ReplyProblem("refusal", what, "rephrase the prompt", answer)
    if reason in _CUT_OFF:
        what = f"the reply was cut off after {len(answer.text)} characters{apart}"
        raise ReplyProblem("length", what, "raise models.<role>.max_tokens", answer)
    if reason in _BROKEN_OFF:
        what = f"the reply has finish reason {answer.finish_reason}, so it may be cut off"
        raise ReplyProblem("unfinished", what, "ask again", answer)
    if not answer.text.strip():
        what = f"the reply is empty (finish reason {answer.finish_reason or 'missing'}){apart}"
        remedy = reasoning_remedy(answer.reasoning_field) if answer.reasoning else "ask again"
        raise ReplyProblem("empty", what, remedy, answer)
    if not answer.encodable:
        raise ReplyProblem("malformed", "the reply holds half a surrogate pair, which is no text", "ask again", answer)
    if not reason:
        what = "the reply has no finish reason, so it may be cut off"
        raise ReplyProblem("unfinished", what, "ask again", answer)
    return answer


def _valid_token_count(count: int | None) -> int:
    return count if count is not None and 0 <= count < _MOST_TOKENS else 0


def _cost_from_metadata(metadata: Mapping[str, Any]) -> float | None:
    usage = metadata.get("token_usage")
    cost = cast(Mapping[str, Any], usage).get("cost") if isinstance(usage, Mapping) else None
    try:
        return float(cost) if isinstance(cost, int | float) and math.isfinite(cost) else None
    except OverflowError:  # a whole number beyond every float
        return None
