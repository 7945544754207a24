"""The answer of a model, as far as GRS uses it, and the reasons why an answer cannot be used."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

from grs_agents.base.errors import GrsError
from grs_agents.base.trace.events import MOST_COST
from grs_agents.models.key_redaction import redact_keys

if TYPE_CHECKING:
    from langchain_core.messages import AIMessage

Json = dict[str, Any]
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
"""Finish reasons of incomplete replies, by provider, in lower case. All others are complete: servers write `stop`,
`end_turn`, `eos_token`, `COMPLETE`, `endoftext` and more."""
_MOST_TOKENS = 2**53
ASKED = "grs_asked"
"""Key of a message's metadata for the model that answered, and the models that had failed before."""
_REASONING_FIELDS = ("reasoning_content", "reasoning", "thinking")
"""Beside the content of a message: vLLM, SGLang, llama.cpp and DeepSeek; newer vLLM and OpenRouter; Ollama."""
_REASONING_BLOCKS = ("thinking", "reasoning", "reasoning_content")
"""Types of content blocks: Anthropic, Google and Mistral; OpenAI; Bedrock."""
_REASONING_TEXTS = ("text", "thinking", "reasoning", "reasoning_content", "summary")
"""Keys of such a block that hold text, or blocks of text."""
_PARSER_REMEDY = (
    "start the server without its reasoning parser (vLLM and SGLang: --reasoning-parser, llama.cpp: --reasoning-format "
    "none), or switch thinking off: models.<role>.arguments.extra_body.chat_template_kwargs.enable_thinking=false"
)

ReplyKind = Literal["empty", "refusal", "length", "unfinished", "malformed"]
"""``unfinished``: no finish reason, or an error's; ``malformed``: the reply is not valid text."""
FailureKind = Literal[
    "unreachable",  # no connection could be made
    "broken_off",  # the connection ended in the middle of an answer
    "deadline",  # no whole reply in time
    "rate_limit",  # asked too often
    "server_error",  # the provider's own trouble
    "credentials",  # the key is not accepted, or may not use this model
    "quota",  # the account is used up
    "not_found",  # no such model or endpoint
    "redirected",  # to another server, which is not asked
    "prompt_too_long",
    "refused_request",  # for another reason
    "malformed",  # the answer breaks the provider's protocol
    "too_long",  # the answer is larger than any reply
    "client_error",  # the client's package failed before anything was asked
]


@dataclass(frozen=True)
class Answer:
    """A model's reply."""

    text: str
    reasoning: int = 0  # characters that the server, or its client, set apart as the model's reasoning
    reasoning_field: str = ""  # that holds them, such as `reasoning_content`
    finish_reason: str = ""  # in the provider's words; empty if not given
    refusal: str = ""  # why the model refuses, if the provider separates that from the text
    encodable: bool = True  # in UTF-8
    # input_tokens, output_tokens, cached_tokens: as the provider counts; 0 if not given
    input_tokens: int = 0
    output_tokens: int = 0
    cached_tokens: int = 0
    cost: float | None = None  # US dollars; None if not given
    model: str = ""  # that answered, out of several; empty for a single model
    failed: tuple[str, ...] = ()  # models asked before it, each with its error


class ProviderFailure(GrsError):
    """No reply arrived: the provider, not the model, is at fault, so a correction sent to the model cannot help."""

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
        self.retryable = retryable  # the same request may succeed a little later
        self.retry_after = retry_after  # seconds that the provider asks to wait; None if not given


class ReplyProblem(GrsError):
    """A reply that arrived but cannot be used; asking again may help. ``answer`` is its readable part."""

    def __init__(self, kind: ReplyKind, message: str, remedy: str = "", answer: Answer | None = None) -> None:
        super().__init__(message, remedy)
        self.kind: ReplyKind = kind
        self.answer = answer


def answer_from_message(message: "AIMessage", body: bytes = b"") -> Answer:
    """Read ``message``, with keys removed; ``body``, as the server sent it, may hold fields that the client dropped."""
    text, usage = str(message.text), message.usage_metadata
    metadata: Mapping[str, Any] = message.response_metadata
    reason = next((metadata[name] for name in _SPELLINGS if metadata.get(name)), "")
    if isinstance(reason, Mapping):  # SGLang's own interface
        reason = cast("Mapping[str, Any]", reason).get("type", "")
    if isinstance(details := metadata.get("incomplete_details"), Mapping):  # OpenAI's Responses API
        reason = cast("Mapping[str, Any]", details).get("reason") or reason
    field, reasoning = ("", 0) if text.strip() else measure_reasoning(message, body)
    fallback: Mapping[str, Any] = metadata.get(ASKED, {})
    token_usage = metadata.get("token_usage")
    value = cast(Mapping[str, Any], token_usage).get("cost") if isinstance(token_usage, Mapping) else None
    cost = float(value) if isinstance(value, int | float) and 0 <= value <= MOST_COST else None
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
        cost=cost,
        model=fallback.get("model", ""),
        failed=tuple(fallback.get("failed", ())),
    )


def answer_from_completion(body: bytes) -> Answer:
    """Read the body of a chat completion in OpenAI's protocol, for replies that its client gives no message of."""
    from langchain_core.messages import AIMessage
    from langchain_core.messages.ai import UsageMetadata

    completion = _parse_json_object(body)
    choices = completion.get("choices")
    first = cast("list[Any]", choices)[0] if isinstance(choices, list) and choices else None
    choice = cast("Json", first) if isinstance(first, dict) else {}
    sent, usage = choice.get("message"), completion.get("usage")
    text = cast("Json", sent).get("content") if isinstance(sent, dict) else ""
    counts = cast("Json", usage) if isinstance(usage, dict) else {}
    read, wrote = (
        count if isinstance(count := counts.get(name), int) else 0 for name in ("prompt_tokens", "completion_tokens")
    )
    message = AIMessage(
        text if isinstance(text, str) else "",
        usage_metadata=UsageMetadata(input_tokens=read, output_tokens=wrote, total_tokens=read + wrote),
        response_metadata={"finish_reason": choice.get("finish_reason") or "", "token_usage": usage},
    )
    return answer_from_message(message)


def require_complete_answer(answer: Answer) -> Answer:
    """Return ``answer``. Raises ReplyProblem: it is incomplete."""
    reason = answer.finish_reason.rpartition(".")[2].lower().replace("-", "_")  # also FinishReason.MAX_TOKENS
    apart = (
        f": the server put {answer.reasoning:,} characters into {answer.reasoning_field}" if answer.reasoning else ""
    )
    if answer.refusal or reason in _REFUSED:
        message = f"the model refused to answer: {answer.refusal or answer.finish_reason}"
        raise ReplyProblem("refusal", message, "rephrase the prompt", answer)
    if reason in _CUT_OFF:
        message = f"the reply was cut off after {len(answer.text)} characters{apart}"
        raise ReplyProblem("length", message, "raise models.<role>.max_tokens", answer)
    if reason in _BROKEN_OFF:
        message = f"the reply has finish reason {answer.finish_reason}, so it may be cut off"
        raise ReplyProblem("unfinished", message, "ask again", answer)
    if not answer.text.strip():
        remedy = "ask again"
        if answer.reasoning_field == "thinking":
            remedy = "switch thinking off: models.<role>.arguments.reasoning=false"
        elif answer.reasoning_field in _REASONING_FIELDS:
            remedy = _PARSER_REMEDY
        elif answer.reasoning:
            remedy = "raise models.<role>.max_tokens, or ask for less thinking"
        message = f"the reply is empty (finish reason {answer.finish_reason or 'missing'}){apart}"
        raise ReplyProblem("empty", message, remedy, answer)
    if not answer.encodable:
        raise ReplyProblem("malformed", "the reply holds half a surrogate pair, which is no text", "ask again", answer)
    if not reason:
        message = "the reply has no finish reason, so it may be cut off"
        raise ReplyProblem("unfinished", message, "ask again", answer)
    return answer


def _valid_token_count(count: int | None) -> int:
    return count if count is not None and 0 <= count < _MOST_TOKENS else 0


def measure_reasoning(message: "AIMessage", body: bytes) -> tuple[str, int]:
    """Find reasoning in ``message``, else in the JSON ``body`` that the server sent.

    Clients drop the fields of other providers.

    Returns:
        Its field and length in characters; an empty field and 0 if there is none.
    """
    for name in _REASONING_FIELDS:
        if length := _text_length(message.additional_kwargs.get(name)):
            return name, length
    blocks = [block for block in message.content if isinstance(block, dict)]
    for name in _REASONING_BLOCKS:
        if length := sum(_text_length(block) for block in blocks if block.get("type") == name):
            return f"blocks of the type {name}", length
    whole = _parse_json_object(body)  # else JSON lines, or a stream of events
    sent: list[Json] = []
    for answer in [whole] if whole else map(_parse_json_object, body.splitlines()):
        choices = answer.get("choices")
        for holder in (answer, *(cast("list[Any]", choices) if isinstance(choices, list) else ())):
            if isinstance(holder, dict):
                parts = (cast("Json", holder).get(name) for name in ("message", "delta"))
                sent += [cast("Json", part) for part in parts if isinstance(part, dict)]
    for name in _REASONING_FIELDS:
        if length := sum(_text_length(part.get(name)) for part in sent):
            return name, length
    return "", 0


def _text_length(value: Any) -> int:
    if isinstance(value, str):
        return len(value)
    if isinstance(value, Mapping):
        return sum(_text_length(cast("Mapping[str, Any]", value).get(name)) for name in _REASONING_TEXTS)
    return sum(map(_text_length, cast("list[Any]", value))) if isinstance(value, list) else 0


def _parse_json_object(text: bytes) -> Json:
    try:
        value: Any = json.loads(text.removeprefix(b"data:"))
    except (ValueError, RecursionError):
        return {}
    return cast("Json", value) if isinstance(value, dict) else {}
