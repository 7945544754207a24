"""Parsers of what models reply: thoughts are cut, and the block that defines what is asked for is checked."""

import re
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar, cast

from pydantic import BaseModel, ValidationError

from grs_agents.agents.fences import FencedBlock, find_fenced_blocks
from grs_agents.agents.thoughts import cut_thoughts
from grs_agents.agents.tolerant_json import read_json_values
from grs_agents.agents.types import RouterReply, Verdict
from grs_agents.base.python_parsing import parse_python

Model = TypeVar("Model", bound=BaseModel)
_PYTHON = re.compile(r"i?py(thon)?[\d.]*")
_JSON = re.compile(r"(x-)?(nd)?json[\w-]*")
_BARE_JSON = re.compile(r"^[ \t]*(?:<\w+>[ \t]*)?(?=\{|\[[ \t]*(?:\{|\n|\]))", re.MULTILINE)
"""Where JSON outside of all blocks begins, perhaps after a tag such as ``<answer>``."""
_VERDICTS: dict[str, Verdict] = {
    "fix_code": "fix_code",
    "fix_test": "fix_test",
    "fix_tests": "fix_test",
    "fix_task": "fix_task",
}
_LONGEST = 2**20
"""Characters of a reply, thoughts included: some 250,000 tokens. Hostile text takes 3 s at most."""
_MOST_PROBLEMS = 30
"""Problems that one message tells. A reply about the segments of a photo has some 10 objects of 8 fields."""


class ReplyError(ValueError):
    """A reply that does not have the form asked for; the message tells the model what to mend."""


def join_problems(problems: Sequence[str]) -> str:
    """All ``problems`` in one line, if there are not too many."""
    more = f"; and {len(problems) - _MOST_PROBLEMS} more" if len(problems) > _MOST_PROBLEMS else ""
    return "; ".join(problems[:_MOST_PROBLEMS]) + more


@dataclass(frozen=True)
class JsonRow(Generic[Model]):
    """A JSON object of a reply."""

    value: Any  # as it was written; None where it is no JSON
    parsed: Model | None = None  # None where it has ``problems``
    problems: tuple[str, ...] = ()

    @property
    def number(self) -> Any:
        """The ``id`` that it bears, if any."""
        return cast("dict[str, Any]", self.value).get("id") if isinstance(self.value, dict) else None


def parse_json(text: str, model: type[Model]) -> Model:
    """The JSON object of the type ``model`` in a fenced block, the last of several, or in the whole reply.

    Raises:
        ReplyError: there is none, with all that is wrong with it.
    """
    blocks = _read_blocks(text, model)
    whole = [rows[0].parsed for rows in blocks if len(rows) == 1 and rows[0].parsed is not None]
    if whole:
        return whole[-1]
    rows = blocks[-1]
    if len(rows) != 1:
        raise ReplyError(f"the block is not JSON of one object: it holds {len(rows)}")
    raise ReplyError(join_problems(rows[0].problems))


def parse_json_rows(text: str, model: type[Model]) -> list[Model]:
    """The JSON objects as ``read_json_rows`` finds them. Raises ReplyError: one of them is no ``model``."""
    rows = read_json_rows(text, model)
    if problems := list_problems(rows):
        raise ReplyError(join_problems(problems))
    return [row.parsed for row in rows if row.parsed is not None]


def read_json_rows(text: str, model: type[Model]) -> list[JsonRow[Model]]:
    """The JSON objects in all fenced blocks that hold such, or in the whole reply: one after the other, or an array.

    An object of a later block takes the place of one of an earlier block with the same ``id``.

    Raises:
        ReplyError: there is no JSON.
    """
    blocks = _read_blocks(text, model)
    rows: dict[Any, JsonRow[Model]] = {}
    for block, found in enumerate(blocks):
        for place, row in enumerate(found):
            rows[(block, place) if row.number is None or len(blocks) == 1 else str(row.number)] = row
    return list(rows.values())


def list_problems(rows: Sequence[JsonRow[Any]]) -> list[str]:
    """All problems of ``rows``; those of one among several name its place and ``id``."""
    if len(rows) == 1:
        return list(rows[0].problems)
    return [
        f"object {place}{'' if row.number is None else f' (id {row.number!r})'}: {problem}"
        for place, row in enumerate(rows, 1)
        for problem in row.problems
    ]


def extract_python_program(text: str, base: Literal["Task", "TestCase"] = "Task") -> str:
    """The Python program in the reply: of several blocks the one that defines a class with this base, then one tagged
    as Python, then one without a tag; of equal ones the last. Its syntax is left to the tests: a broken program is a
    version like any other, with a traceback that the router reads.

    Raises:
        ReplyError: no block, or an empty one.
    """
    text = _cut_to_answer(text)
    if _is_python_source(text):
        return text.rstrip() + "\n"
    defines = re.compile(rf"^[ \t]*class[ \t]+\w+[ \t]*\([^)\n]*\b\w*{base}\b", re.MULTILINE)
    ranked = [
        (4 * bool(defines.search(block.body)) + _rank(block, _PYTHON), block) for block in find_fenced_blocks(text)
    ]
    best = max((rank for rank, _ in ranked), default=0)
    if not best:
        raise _missing_block_error(text, "python")
    body = [block.body for rank, block in ranked if rank == best][-1]
    if not body.strip():
        raise ReplyError("the python block is empty")
    return body.strip("\n").rstrip() + "\n"


def extract_test_program(text: str) -> str:
    """The program that defines test cases, as ``extract_python_program`` finds it."""
    return extract_python_program(text, "TestCase")


def parse_verdict(text: str) -> RouterReply:
    """The verdict in the last block that holds one (paper, Listing 3). Raises ReplyError: none does."""
    text = _cut_to_answer(text)
    blocks = list(find_fenced_blocks(text))
    verdicts = [said for block in blocks if (said := block.body.strip().strip("\"'`").lower()) in _VERDICTS]
    if not verdicts:
        raise ReplyError("end with a fenced block that holds exactly one of the verdicts, e.g. fix_code or fix_test")
    starts, ends = [block.start for block in blocks], [block.end for block in blocks]
    explanation = "".join(text[start:end] for start, end in zip([0, *ends], [*starts, len(text)], strict=True))
    return RouterReply(verdict=_VERDICTS[verdicts[-1]], explanation=explanation.strip())


def _cut_to_answer(text: str) -> str:
    """What the reply says after all thoughts. Raises ReplyError: it says nothing, or far too much."""
    if len(text) > _LONGEST:
        raise ReplyError(f"the reply has {len(text):,} characters; at most {_LONGEST:,} are read")
    answer = cut_thoughts(text)
    if text.strip() and not answer.strip():
        raise ReplyError(f"the reply is thoughts alone, {len(text)} characters; answer after them")
    return answer


def _rank(block: FencedBlock, language: re.Pattern[str]) -> int:
    return 2 if language.fullmatch(block.language) else 0 if block.language else 1


def _missing_block_error(text: str, language: str) -> ReplyError:
    if "```" in text or "~~~" in text:
        return ReplyError(f"found no block fenced with ```{language}")
    said = " ".join(text.split())[:300]  # a refusal gives its reason here
    return ReplyError(f"the reply has no block fenced with ```{language}; it says {said!r}")


def _read_blocks(text: str, model: type[Model]) -> list[list[JsonRow[Model]]]:
    """The objects of each block that has some of the type ``model``; where none has, those of the last block.

    Blocks tagged as JSON come before all others.
    """
    text = _cut_to_answer(text)
    blocks = list(find_fenced_blocks(text))
    tagged = [block.body for block in blocks if _JSON.fullmatch(block.language)]
    others = [block.body for block in blocks if not _JSON.fullmatch(block.language)]
    bare = _BARE_JSON.search(text)
    outside = [text[bare.end() : max(text.rfind("}"), text.rfind("]")) + 1]] if bare else []
    groups = [tagged, [body for body in others if body.lstrip().startswith(("{", "["))], outside]
    if bare and not text[: bare.start()].strip():
        groups = [outside, *groups[:-1]]  # a text in it may hold fences
    read = [[_read_rows(body, model) for body in group] for group in groups]
    for blocks_of_rows in read:
        if fitting := [rows for rows in blocks_of_rows if any(_is_meant(row.value, model) for row in rows)]:
            return fitting
    unfit = [rows for blocks_of_rows in read for rows in blocks_of_rows[-1:] if rows]
    if unfit:
        return unfit[:1]
    if tagged:
        raise ReplyError("the JSON block is empty")
    raise _missing_block_error(text, "json")


def _is_meant(value: Any, model: type[BaseModel]) -> bool:
    """Whether ``value`` is an object with one of the keys that a ``model`` must have, in whatever spelling."""
    if not isinstance(value, dict):
        return False
    errors = _list_errors(value, model)
    missing = {error["loc"][0] for error in errors if error["type"] == "missing"}
    return len(missing) < sum(field.is_required() for field in model.model_fields.values())


def _read_rows(body: str, model: type[Model]) -> list[JsonRow[Model]]:
    values: list[Any] = list(read_json_values(body))
    if len(values) == 1 and isinstance(values[0], dict) and not _is_meant(values[0], model):
        values = _unwrap(cast("dict[str, Any]", values[0]))
    rows: list[JsonRow[Model]] = []
    for value in values:
        if isinstance(value, ValueError):
            rows.append(JsonRow(None, None, (f"it is not JSON: {value}",)))
        elif problems := [_describe_error(error) for error in _list_errors(value, model)]:
            rows.append(JsonRow(value, None, tuple(problems)))
        else:
            rows.append(JsonRow(value, model.model_validate(value)))
    return rows


def _unwrap(value: dict[str, Any]) -> list[Any]:
    """The objects under the only key of ``value``, where there are such: a wrapper like ``{"segments": [...]}``."""
    inner: Any = next(iter(value.values())) if len(value) == 1 else None
    items = cast("list[Any]", inner if isinstance(inner, list) else [inner])
    return items if items and all(isinstance(item, dict) for item in items) else [value]


def _list_errors(value: Any, model: type[BaseModel]) -> list[Any]:
    try:
        model.model_validate(value)
    except ValidationError as error:
        return cast("list[Any]", error.errors(include_url=False, include_context=False))
    return []


def _describe_error(error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"]) or "the object"
    if error["type"] == "missing":
        return f"{where} is missing"
    if error["type"] == "model_type":
        return f"{where} is no JSON object but {reprlib.repr(error['input'])}"
    return f"{where}: {error['msg']}, not {reprlib.repr(error['input'])}"


def _is_python_source(text: str) -> bool:
    if "import" not in text:
        return False
    try:
        parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # the last is the parser's word for too deep
        return False
    return True
