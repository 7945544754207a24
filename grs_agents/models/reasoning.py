"""What a server set apart as the model's reasoning, where the reply itself is empty."""

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from langchain_core.messages import AIMessage

Json = dict[str, Any]
_FIELDS = ("reasoning_content", "reasoning", "thinking")
"""Beside the content of a message: vLLM, SGLang, llama.cpp and DeepSeek; newer vLLM and OpenRouter; Ollama."""
_BLOCKS = ("thinking", "reasoning", "reasoning_content")
"""Types of content blocks: Anthropic, Google and Mistral; OpenAI; Bedrock."""
_TEXTS = ("text", "thinking", "reasoning", "reasoning_content", "summary")
"""Keys of such a block that hold text, or blocks of text."""
_PARSER = (
    "start the server without its reasoning parser (vLLM and SGLang: --reasoning-parser, llama.cpp: --reasoning-format "
    "none), or switch thinking off: models.<role>.arguments.extra_body.chat_template_kwargs.enable_thinking=false"
)


def measure_reasoning(message: "AIMessage", body: bytes) -> tuple[str, int]:
    """The field that holds reasoning in ``message``, else in the JSON ``body`` that the server sent, and its length in
    characters; an empty field and 0 where there is none. Clients drop the fields that are not their provider's own.
    """
    for name in _FIELDS:
        if length := _text_length(message.additional_kwargs.get(name)):
            return name, length
    blocks = [block for block in message.content if isinstance(block, dict)]
    for name in _BLOCKS:
        if length := sum(_text_length(block) for block in blocks if block.get("type") == name):
            return f"blocks of the type {name}", length
    sent = list(_messages_in_body(body))
    for name in _FIELDS:
        if length := sum(_text_length(part.get(name)) for part in sent):
            return name, length
    return "", 0


def reasoning_remedy(field: str) -> str:
    """The setting that ends replies of which all is in ``field``."""
    if field == "thinking":
        return "switch thinking off: models.<role>.arguments.reasoning=false"
    return _PARSER if field in _FIELDS else "raise models.<role>.max_tokens, or ask for less thinking"


def _text_length(value: Any) -> int:
    if isinstance(value, str):
        return len(value)
    if isinstance(value, Mapping):
        return sum(_text_length(cast("Mapping[str, Any]", value).get(name)) for name in _TEXTS)
    return sum(map(_text_length, cast("list[Any]", value))) if isinstance(value, list) else 0


def _messages_in_body(body: bytes) -> Iterator[Mapping[str, Any]]:
    """The messages of an answer: one JSON document, one in each line, or one in each event of a stream."""
    whole = _read_object(body)
    for answer in [whole] if whole else map(_read_object, body.splitlines()):
        choices = answer.get("choices")
        for holder in (answer, *(cast("list[Any]", choices) if isinstance(choices, list) else ())):
            parts = (
                (cast("Json", holder).get(name) for name in ("message", "delta")) if isinstance(holder, dict) else ()
            )
            yield from (cast("Json", part) for part in parts if isinstance(part, dict))


def _read_object(text: bytes) -> Json:
    try:
        value: Any = json.loads(text.removeprefix(b"data:"))
    except (ValueError, RecursionError):
        return {}
    return cast("Json", value) if isinstance(value, dict) else {}
