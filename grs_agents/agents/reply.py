"""Strict parsers of what models reply."""

import json
import re
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ValidationError

from grs_agents.agents.types import RouterReply, Verdict
from grs_agents.python_parsing import parse_python

Model = TypeVar("Model", bound=BaseModel)
_FENCE = re.compile(r"^```[ \t]*([\w+-]*)[ \t]*\r?\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
_VERDICTS: dict[str, Verdict] = {
    "fix_code": "fix_code",
    "fix_test": "fix_test",
    "fix_tests": "fix_test",
    "fix_task": "fix_task",
}


class ReplyError(ValueError):
    """A reply that does not have the form asked for; the message tells the model what to mend."""


def extract_fenced_block(text: str, language: str) -> str:
    """The last closed block fenced in ``language`` (or in none). Raises ReplyError: there is no such block."""
    blocks = [body for tag, body in _FENCE.findall(text) if tag.lower() in (language, "", language[:2])]
    if blocks:
        return cast(str, blocks[-1])
    if "```" in text:
        raise ReplyError(f"found no closed block fenced with ```{language}")
    said = " ".join(text.split())[:300]  # a refusal gives its reason here
    raise ReplyError(f"the reply has no block fenced with ```{language}; it says {said!r}")


def parse_json(text: str, model: type[Model]) -> Model:
    """The JSON object in the fenced block, or the whole reply. Raises ReplyError: it is no ``model``."""
    values = parse_json_rows(text, model)
    if len(values) != 1:
        raise ReplyError(f"the block is not JSON of one object: it holds {len(values)}")
    return values[0]


def parse_json_rows(text: str, model: type[Model]) -> list[Model]:
    """The JSON objects in the fenced block, or in the whole reply: one after the other, or an array of them.

    Raises:
        ReplyError: one of them is no ``model``.
    """
    body = (text if text.lstrip().startswith("{") else extract_fenced_block(text, "json")).strip()
    values: list[Any] = []
    try:
        while body:
            value, end = json.JSONDecoder().raw_decode(body)
            json.dumps(value, ensure_ascii=False).encode()  # refuses half a surrogate pair, which no file can hold
            values += cast("list[Any]", value) if isinstance(value, list) else [value]
            body = body[end:].lstrip(" ,\r\n\t")
    except (ValueError, RecursionError) as error:  # also numbers of thousands of digits, and what is nested too deeply
        raise ReplyError(f"the block is not JSON: {error}") from error
    try:
        return [model.model_validate(value) for value in values]
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the object"
        raise ReplyError(f"{where}: {first['msg']}") from error


def extract_python_program(text: str) -> str:
    """The Python program in the reply's fenced block. Its syntax is left to the tests: a broken program is a
    version like any other, with a traceback that the router reads.

    Raises:
        ReplyError: no block, or an empty one.
    """
    body = text if _is_python_source(text) else extract_fenced_block(text, "python")
    if not body.strip():
        raise ReplyError("the python block is empty")
    return body.rstrip() + "\n"


def parse_verdict(text: str) -> RouterReply:
    """The verdict in the last block that holds one (paper, Listing 3). Raises ReplyError: none does."""
    blocks = [cast(str, body).strip().strip("\"'`") for _, body in _FENCE.findall(text)]
    verdicts = [block for block in blocks if block in _VERDICTS]
    if not verdicts:
        raise ReplyError("end with a fenced block that holds exactly one of the verdicts, e.g. fix_code or fix_test")
    explanation = _FENCE.sub("", text).strip()
    return RouterReply(verdict=_VERDICTS[verdicts[-1]], explanation=explanation)


def _is_python_source(text: str) -> bool:
    if "```" in text or "import" not in text:
        return False
    try:
        parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # the last is the parser's word for too deep
        return False
    return True
