"""Parsers of model replies: cut thoughts, find the fenced block with the answer, and validate it."""

import ast
import json
import re
import reprlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar, cast

from pydantic import BaseModel, ValidationError

from grs_agents.agents.types import RouterReply, Verdict
from grs_agents.base.python_parsing import parse_python

Model = TypeVar("Model", bound=BaseModel)
_PYTHON = re.compile(r"i?py(thon)?[\d.]*")
_JSON = re.compile(r"(x-)?(nd)?json[\w-]*")
_BARE_JSON = re.compile(r"^[ \t]*(?:<\w+>[ \t]*)?(?=\{|\[[ \t]*(?:\{|\n|\]))", re.MULTILINE)
"""Begin of JSON outside of all blocks, perhaps after a tag such as ``<answer>``."""
_VERDICTS: dict[str, Verdict] = {
    "fix_code": "fix_code",
    "fix_test": "fix_test",
    "fix_tests": "fix_test",
    "fix_task": "fix_task",
}
_VERDICT = re.compile(r"\W*(?:verdict\W+)?(fix_(?:code|tests?|task))\W*(?:\((?:(?!fix_)[^()])*\)\W*)?", re.IGNORECASE)
"""A verdict by itself, perhaps after the word and before a reason in brackets."""
_LAST_WORDS = re.compile(
    r"(?!.*(?:\b(?:(?:can)?not|never|neither)\b|n't\b|fix_.*fix_))"
    r".*\b(?:verdict|answer|choice|decision)\b.*\b(fix_(?:code|tests?|task))\W*",
    re.IGNORECASE,
)
"""A sentence that ends in a verdict and calls it that."""
_LONGEST_SENTENCE = 300
_LONGEST = 2**20
"""Characters of a reply, thoughts included: some 250,000 tokens. Hostile text takes 3 s at most."""
_MOST_PROBLEMS = 30
"""Most problems in a message. A reply about the segments of a photo has some 10 objects of 8 fields."""

_THOUGHT_NAMES = "think|thinking|thoughts?|reasoning|antthinking|seed:think|mm:think"
_THOUGHT_MARK = re.compile(
    r"^[ \t]*(?P<fence>`{3,}|~{3,})(?=(?P<info>[^\n]*))"
    rf"|(?P<open><(?:{_THOUGHT_NAMES})[ ]?>|(?-i:\[THINK\])|◁think▷|<\|START_THINKING\|>|<\|begin_of_thought\|>"
    r"|<\|inner_prefix\|>|<\|channel>thought\b|<\|channel\|>(?:analysis|commentary)\b)"
    rf"|(?P<close></(?:{_THOUGHT_NAMES})[ ]?>|(?-i:\[/THINK\])|◁/think▷|<\|END_THINKING\|>|<\|end_of_thought\|>"
    r"|<\|inner_suffix\|>|<channel\|>|<\|channel\|>final\b(?:[^<\n]|<\|constrain\|>)*<\|message\|>)",
    re.MULTILINE | re.IGNORECASE,
)
"""Fences of code, and the marks around thoughts: of DeepSeek, Qwen and most others; Seed-OSS, MiniMax, Magistral, Kimi,
Cohere, OpenThinker, Apertus, Gemma and gpt-oss."""
_UNMARKED = re.compile(
    r"\s*(?:(?:assistant)?(?:analysis|commentary).*?)?assistantfinal"
    r"|\s*Here(?:'s| is) my thought process:.*?Here(?:'s| is) my response:",
    re.DOTALL,
)
"""Begin of a reply of gpt-oss without its special tokens, and of Granite."""
_LEADING_TOKENS = re.compile(r"\s*(?:<\|\w{1,40}\|>(?:assistant\b)?\s*)+")
_TRAILING_TOKENS = re.compile(r"(?:\s*(?:<[|｜][\w▁]{1,40}[|｜]>|</s>|<eos>|<end_of_turn>))+\s*\Z")
_SEARCHED_TAIL = 200
"""Characters at the end of a reply that may hold special tokens."""
_QUOTES = ("'", '"', "`")
_IMPORT = re.compile(r"^(?:import|from)[ \t]+\w", re.MULTILINE)
_MOST_REMARKS = 5
"""Paragraphs after a program without a fence that may be words."""
_BLANK_REST = re.compile(r"[ \t]*(?:\n|\Z)")
_FENCE = re.compile(r"^(?P<indent>[ \t]*)(?P<run>`{3,}|~{3,})(?P<info>[^\n]*)$", re.MULTILINE)
_MOST_INDENT = 3
"""Most columns of indent of a closing fence beyond its opening fence; a deeper fence belongs to the code."""
_LANGUAGE = re.compile(r"[\w+#.-]*\w")
_LONGEST_LANGUAGE = 100
"""Characters of an info string that may hold its first word."""
_TOKEN = re.compile(
    r'"(?P<double>[^"\\]*(?:\\.[^"\\]*)*)"'
    r"|'(?P<single>[^'\\]*(?:\\.[^'\\]*)*)'"
    r"|(?P<comment>//[^\n]*|/\*.*?\*/|\#[^\n]*)"
    r"|(?P<unclosed>[\"']|/\*)"
    r"|(?P<word>[A-Za-z_$][\w$-]*)(?P<colon>[ \t]*:)?"
    r"|(?P<space>\s+)|(?P<number>[\d.+-]+)|.",
    re.DOTALL,
)
_LITERALS = {"True": "true", "False": "false", "None": "null", "undefined": "null"}
_ESCAPED = re.compile(r'\\(.)|"', re.DOTALL)
_NEXT_OBJECT = re.compile(r"\n[ \t]*(?=\{)")
_MOST_FAILURES = 20
"""Values that cannot be read, after which reading ends: each may cost as long as the whole text."""
_SHOWN = 40
"""Characters of invalid JSON that a message shows."""


class ReplyError(ValueError):
    """A reply that does not have the required form; the message tells the model how to correct it."""


def join_problems(problems: Sequence[str]) -> str:
    """Join ``problems`` in a line, up to ``_MOST_PROBLEMS``."""
    more = f"; and {len(problems) - _MOST_PROBLEMS} more" if len(problems) > _MOST_PROBLEMS else ""
    return "; ".join(problems[:_MOST_PROBLEMS]) + more


@dataclass(frozen=True)
class JsonRow(Generic[Model]):
    """A JSON object of a reply."""

    value: Any  # as written; None if it is no JSON
    parsed: Model | None = None  # None if it has ``problems``
    problems: tuple[str, ...] = ()

    @property
    def number(self) -> Any:
        """Its ``id``, if any."""
        return cast("dict[str, Any]", self.value).get("id") if isinstance(self.value, dict) else None


@dataclass(frozen=True)
class FencedBlock:
    """A block of code in a text."""

    language: str  # the first word of its info string, in lower case: ``python`` of ``{.Python title="a.py"}``
    body: str  # to the end of the text if no fence closes it
    start: int  # begin and end in the text, fences included
    end: int


def parse_json(text: str, model: type[Model]) -> Model:
    """The JSON object of the type ``model`` in a fenced block, the last of several, or in the whole reply.

    Raises:
        ReplyError: there is none; the message lists all problems.
    """
    blocks = _read_blocks(text, model)
    whole = [rows[0].parsed for rows in blocks if len(rows) == 1 and rows[0].parsed is not None]
    if whole:
        return whole[-1]
    rows = blocks[-1]
    if len(rows) != 1:
        raise ReplyError(f"the block is not JSON of one object: it holds {len(rows)}")
    raise ReplyError(join_problems(rows[0].problems))


def read_json_rows(text: str, model: type[Model]) -> list[JsonRow[Model]]:
    """Read the JSON objects of all fenced blocks with JSON, or of the whole reply: a sequence, or an array.

    An object of a later block replaces an object of an earlier block with the same ``id``.

    Raises:
        ReplyError: there is no JSON.
    """
    blocks = _read_blocks(text, model)
    rows: dict[Any, JsonRow[Model]] = {}
    for block, block_rows in enumerate(blocks):
        for place, row in enumerate(block_rows):
            rows[(block, place) if row.number is None or len(blocks) == 1 else str(row.number)] = row
    return list(rows.values())


def list_problems(rows: Sequence[JsonRow[Any]]) -> list[str]:
    """All problems of ``rows``; of several rows, each problem names the place and ``id`` of its row."""
    if len(rows) == 1:
        return list(rows[0].problems)
    return [
        f"object {place}{'' if row.number is None else f' (id {row.number!r})'}: {problem}"
        for place, row in enumerate(rows, 1)
        for problem in row.problems
    ]


def extract_python_program(text: str, base: Literal["Task", "TestCase"] = "Task") -> str:
    """Extract the Python program from a reply.

    Of several blocks, a block that defines a class with this base is preferred, then a block tagged as Python, then a
    block without a tag; of equal blocks the last. The tests check the syntax: a broken program is a version with a
    traceback that the router reads.

    Raises:
        ReplyError: no block, or an empty block.
    """
    text = _cut_to_answer(text)
    if text.lstrip().startswith("{"):
        text = _read_only_text(text)
    statements = _read_statements(text) if "import" in text else []
    if any(isinstance(item, ast.Import | ast.ImportFrom | ast.ClassDef) for item in statements):  # no JSON
        return text.rstrip() + "\n"
    defines = re.compile(rf"^[ \t]*class[ \t]+\w+[ \t]*\([^)\n]*\b\w*{base}\b", re.MULTILINE)
    blocks = list(_find_fenced_blocks(text))
    if not blocks and (bare := _IMPORT.search(text)) and defines.search(text, bare.start()) is not None:
        paragraphs = text[bare.start() :].split("\n\n")
        for end in range(len(paragraphs), max(0, len(paragraphs) - _MOST_REMARKS), -1):
            if defines.search(program := "\n\n".join(paragraphs[:end])) and _read_statements(program):
                return program.rstrip() + "\n"
    ranked: list[tuple[int, FencedBlock]] = []
    for block in blocks:
        tag = 2 if _PYTHON.fullmatch(block.language) else 0 if block.language else 1
        ranked.append((4 * bool(defines.search(block.body)) + tag, block))
    best = max((rank for rank, _ in ranked), default=0)
    if not best:
        raise _missing_block_error(text, "python")
    *_, (_, chosen) = (entry for entry in ranked if entry[0] == best)
    body = chosen.body.strip("\n").rstrip()
    if not body:
        raise ReplyError("the python block is empty")
    before = [
        block.body
        for _, block in ranked
        if block.start < chosen.start
        and (statements := _read_statements(block.body))
        and all(isinstance(item, ast.Import | ast.ImportFrom) for item in statements)
    ]
    if before and not _IMPORT.search(body):  # a program in two blocks
        body = f"{before[-1].strip()}\n\n\n{body}"
    return body + "\n"


def _read_statements(text: str) -> list[ast.stmt]:
    """The statements of a program; none if it is no Python."""
    try:
        return parse_python(text).body
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # MemoryError: too deeply nested
        return []


def _read_only_text(text: str) -> str:
    """The text in a JSON object of a single text, such as ``{"code": "..."}``; else ``text``."""
    try:
        value = json.loads(text, strict=False)
    except (ValueError, RecursionError):
        return text
    only: list[Any] = list(cast("dict[str, Any]", value).values()) if isinstance(value, dict) else []
    return only[0] if len(only) == 1 and isinstance(only[0], str) else text


def extract_test_program(text: str) -> str:
    """The program that defines test cases, as ``extract_python_program`` finds it."""
    return extract_python_program(text, "TestCase")


def parse_verdict(text: str) -> RouterReply:
    """Parse the verdict in the last block that holds a verdict (paper, Listing 3), or a reply that is a JSON object.

    Raises:
        ReplyError: there is none.
    """
    text = _cut_to_answer(text)
    if text.lstrip().startswith("{"):
        return parse_json(text, RouterReply)
    blocks = list(_find_fenced_blocks(text))
    verdicts = [found[1].lower() for block in blocks if (found := _VERDICT.fullmatch(block.body.strip()))]
    if not verdicts:
        last = text.strip().rpartition("\n")[2]
        found = _VERDICT.fullmatch(last)
        sentence = _LAST_WORDS.fullmatch(last) if len(last) <= _LONGEST_SENTENCE else None
        if not found and sentence:
            return RouterReply(verdict=_VERDICTS[sentence[1].lower()], explanation=text.strip())
        if found is None:
            raise ReplyError(
                "end with a fenced block that holds exactly one of the verdicts, e.g. fix_code or fix_test"
            )
        return RouterReply(verdict=_VERDICTS[found[1].lower()], explanation=text.strip().removesuffix(last).strip())
    starts, ends = [block.start for block in blocks], [block.end for block in blocks]
    explanation = "".join(text[start:end] for start, end in zip([0, *ends], [*starts, len(text)], strict=True))
    return RouterReply(verdict=_VERDICTS[verdicts[-1]], explanation=explanation.strip())


def _cut_to_answer(text: str) -> str:
    """Remove thoughts and surrounding special tokens from ``text``; lines of the answer end in ``\\n``.

    A mark of thoughts counts only outside of quotes and blocks of code. All text before an unmatched end mark is
    thoughts, as is all text after an unmatched begin mark.

    Raises:
        ReplyError: the answer is empty, or the text far too long.
    """
    if len(text) > _LONGEST:
        raise ReplyError(f"the reply has {len(text):,} characters; at most {_LONGEST:,} are read")
    answer = text.replace("\r\n", "\n").replace("\r", "\n")
    if unmarked := _UNMARKED.match(answer):
        answer = answer[unmarked.end() :]
    answer = _cut_marked_thoughts(answer)
    if leading := _LEADING_TOKENS.match(answer):
        answer = answer[leading.end() :]
    answer = answer[:-_SEARCHED_TAIL] + _TRAILING_TOKENS.sub("", answer[-_SEARCHED_TAIL:])
    if text.strip() and not answer.strip():
        raise ReplyError(f"the reply is thoughts alone, {len(text)} characters; answer after them")
    return answer


def _missing_block_error(text: str, language: str) -> ReplyError:
    if "```" in text or "~~~" in text:
        return ReplyError(f"found no block fenced with ```{language}")
    words = " ".join(text.split())[:300]  # a refusal gives its reason here
    return ReplyError(f"the reply has no block fenced with ```{language}; it says {words!r}")


def _read_blocks(text: str, model: type[Model]) -> list[list[JsonRow[Model]]]:
    """The objects of each block that has objects of the type ``model``, else the last block's.

    Blocks tagged as JSON come before all others.
    """
    text = _cut_to_answer(text)
    blocks = list(_find_fenced_blocks(text))
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
    """True if ``value`` is an object with at least a required key of ``model``, in any spelling."""
    if not isinstance(value, dict):
        return False
    errors = _list_errors(value, model)
    missing = {error["loc"][0] for error in errors if error["type"] == "missing"}
    return len(missing) < sum(field.is_required() for field in model.model_fields.values())


def _read_rows(body: str, model: type[Model]) -> list[JsonRow[Model]]:
    """Read the JSON values in ``body``, in sequence; the items of an array count as separate values.

    Text that is not strict JSON is read in a wider spelling, in which each text still has at most a single meaning. A
    value that cannot be read is replaced by its error, and reading resumes at the next line that begins with an object.
    """
    try:
        decoded = list(_decode_values(body))
    except ValueError:
        decoded = list(_decode_values(_spell_strictly(body), resume=True))
    values: list[Any] = []
    for value in decoded:
        values += cast("list[Any]", value) if isinstance(value, list) else [value]
    if len(values) == 1 and isinstance(values[0], dict) and not _is_meant(values[0], model):
        # A wrapper like {"segments": [...]}: the objects under its only key; or objects by number, {"3": {...}}
        table = cast("dict[str, Any]", values[0])
        inner: list[Any] = list(table.values())
        items = cast("list[Any]", inner[0] if len(inner) == 1 and isinstance(inner[0], list) else inner)
        if items and all(isinstance(item, dict) for item in items):
            by_number = items is inner and all(key.strip().isdecimal() for key in table)
            if by_number or len(inner) == 1:
                values = [{"id": key, **item} for key, item in table.items()] if by_number else items
    rows: list[JsonRow[Model]] = []
    for value in values:
        if isinstance(value, ValueError):
            rows.append(JsonRow(None, None, (f"it is not JSON: {value}",)))
            continue
        problems: list[str] = []
        for error in _list_errors(value, model):
            place = ".".join(str(part) for part in error["loc"]) or "the object"
            if error["type"] == "missing":
                problems.append(f"{place} is missing")
            elif error["type"] == "model_type":
                problems.append(f"{place} is no JSON object but {reprlib.repr(error['input'])}")
            else:
                problems.append(f"{place}: {error['msg']}, not {reprlib.repr(error['input'])}")
        rows.append(JsonRow(value, None if problems else model.model_validate(value), tuple(problems)))
    return rows


def _list_errors(value: Any, model: type[BaseModel]) -> list[Any]:
    try:
        model.model_validate(value)
    except ValidationError as error:
        return cast("list[Any]", error.errors(include_url=False, include_context=False))
    return []


def _cut_marked_thoughts(text: str) -> str:
    kept: list[str] = []
    start = depth = last_close = 0  # begin of the answer; nesting of thoughts; position of their last end mark
    fence = ""  # opening fence of the block of code around the answer
    fences_left = sum(1 for mark in _THOUGHT_MARK.finditer(text) if mark["fence"])
    end, blank, odd_quotes = 0, True, False  # of the last mark; of the line before the next mark
    for mark in _THOUGHT_MARK.finditer(text):
        between = text[end : mark.start()]
        _, new_line, before = between.rpartition("\n")
        quotes = before.count('"') - before.count('\\"')
        blank = (blank or bool(new_line)) and not before.strip()
        odd_quotes = (odd_quotes and not new_line) != bool(quotes % 2)
        end = mark.end()
        if mark["fence"]:
            blank, fences_left = False, fences_left - 1
            if not fence:
                fence = "" if "`" in mark["fence"] and "`" in mark["info"] else mark["fence"]
            elif mark["fence"].startswith(fence) and not mark["info"].strip():
                fence = ""
            continue
        quoted = text[end : end + 1] in _QUOTES and text[mark.start() - 1 : mark.start()] == text[end : end + 1]
        if quoted or (odd_quotes and not blank and not depth):
            continue
        special = mark[0].startswith(("<|", "<channel"))
        if mark["open"]:
            if depth:
                depth += blank and not special
            elif not fence and (blank or special):
                kept.append(text[start : mark.start()])
                depth, last_close = 1, 0
        elif depth:
            depth, last_close = 0 if special else depth - 1, end
            if not depth:
                start, fence = end, ""
        # In code: thoughts that stopped within a draft, unless the code goes on, so that a fence is left over
        elif not fence or (blank and _BLANK_REST.match(text, end) and fences_left % 2 == 0):
            kept.clear()
            start, fence = end, ""
    if not depth:
        kept.append(text[start:])
    elif last_close:  # a begin mark was written twice
        kept.append(_cut_marked_thoughts(text[last_close:]))
    return "".join(kept)


def _find_fenced_blocks(text: str) -> Iterator[FencedBlock]:
    """The fenced blocks of ``text``, whose lines end in ``\\n``.

    More lenient than CommonMark in two respects: blocks may have any indent (in lists), and may begin and end in the
    same line.
    """
    opened: re.Match[str] | None = None
    for fence in _FENCE.finditer(text):
        run, info = fence["run"], fence["info"]
        if opened is not None:
            indent = _count_columns(fence["indent"]) - _count_columns(opened["indent"])
            if run.startswith(opened["run"]) and not info.strip() and indent <= _MOST_INDENT:
                yield _make_block(opened, text[opened.end() + 1 : fence.start()], fence.end())
                opened = None
        elif "`" not in run or "`" not in info:
            opened = fence
        elif info.rstrip().endswith(run):
            body = info.rstrip().rstrip("`").strip()
            language, _, code = body.partition(" ")
            if not code or not _LANGUAGE.fullmatch(language[:_LONGEST_LANGUAGE]):
                language, code = "", body
            yield FencedBlock(language.lower(), code, fence.start(), fence.end())
    if opened is not None:
        body = text[opened.end() + 1 :].rstrip()
        yield _make_block(opened, body.removesuffix(opened["run"]), len(text))


def _make_block(opened: re.Match[str], body: str, end: int) -> FencedBlock:
    indent = _count_columns(opened["indent"])
    body = re.sub(rf"^ {{1,{indent}}}", "", body.expandtabs(4), flags=re.MULTILINE) if indent else body
    word = _LANGUAGE.search(opened["info"][:_LONGEST_LANGUAGE])
    if (
        word and _PYTHON.fullmatch(word[0].lower()) and (glued := _IMPORT.match(opened["info"][word.end() :].strip()))
    ):  # code in the line of the fence
        body = f"{glued.string}\n{body}"
    return FencedBlock(word[0].lstrip(".").lower() if word else "", body, opened.start(), end)


def _count_columns(indent: str) -> int:
    return len(indent.expandtabs(4))


def _decode_values(text: str, resume: bool = False) -> Iterator[Any]:
    """The values in ``text``. Raises ValueError at the first unreadable value; with ``resume`` yields the error."""
    decoder = json.JSONDecoder(strict=False)  # a line break in a string is unambiguous
    separators = re.compile(r"[\s,;\]]*" if resume else r"[\s,]*")
    position, failures = 0, 0
    while True:
        separator = separators.match(text, position)
        position = separator.end() if separator else position
        if position == len(text):
            return
        try:
            value, end = decoder.raw_decode(text, position)
            json.dumps(value, ensure_ascii=False).encode()  # refuses half a surrogate pair, which no file can hold
        # Also numbers of thousands of digits, and values nested too deeply
        except (ValueError, RecursionError) as error:
            if not resume:
                raise ValueError from error
            failures += 1
            if text[position] == "[" and failures < _MOST_FAILURES:  # read its items separately
                position += 1
                continue
            reason, at = (error.msg, error.pos) if isinstance(error, json.JSONDecodeError) else (str(error), position)
            rest = text[at : at + _SHOWN].partition("\n")[0]
            yield ValueError(f"{reason} at {rest!r}" if rest else f"{reason} at the end of a line")
            following = _NEXT_OBJECT.search(text, position)
            if following is None or failures == _MOST_FAILURES:
                return
            position = following.end()
        else:
            yield value
            position = end


def _spell_strictly(text: str) -> str:
    """Convert the known tokens of ``text`` to strict JSON; unknown tokens stay as they are."""
    written: list[str] = []
    comma = -1  # index of a trailing comma, followed by nothing but space
    for token in _TOKEN.finditer(text):
        if token["unclosed"]:
            return "".join(written) + text[token.start() :]
        part = token[0]
        if token["comment"] or token["space"]:
            part = "" if token["comment"] else part
        elif part == ",":
            comma = len(written)
        else:
            if part in ("}", "]") and comma >= 0:
                written[comma] = ""
            comma = -1
        quoted = token["single"] if token["double"] is None else token["double"]
        if quoted is not None:
            part = f'"{_ESCAPED.sub(_escape_for_double_quotes, quoted)}"'
        elif token["word"] and token["colon"]:
            part = f'"{token["word"]}"{token["colon"]}'
        elif token["word"]:
            part = _LITERALS.get(part, part)
        written.append(part)
    return "".join(written)


def _escape_for_double_quotes(match: re.Match[str]) -> str:
    return '\\"' if match[0] == '"' else match[1] if match[1] == "'" else match[0]
