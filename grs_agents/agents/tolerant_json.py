"""JSON as models write it: with Python's literals, single quotes, comments, bare keys and trailing commas."""

import json
import re
from collections.abc import Iterator
from typing import Any

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
"""Characters of what is no JSON that a message shows."""


def read_json_values(text: str) -> Iterator[Any | ValueError]:
    """The JSON values in ``text``, one after the other; the items of an array count as values of their own.

    Text that JSON itself does not read is read in the wider spelling, in which each text still has one meaning at
    most. In place of a value that cannot be read stands the error, and reading goes on with the next line that begins
    with an object.
    """
    try:
        values = list(_decode_values(text))
    except ValueError:
        values = list(_decode_values(_spell_strictly(text), resume=True))
    for value in values:
        yield from value if isinstance(value, list) else [value]


def _decode_values(text: str, resume: bool = False) -> Iterator[Any]:
    """The values in ``text``. Raises ValueError at the first that cannot be read, unless it may ``resume`` after it."""
    decoder = json.JSONDecoder(strict=False)  # a line break in a text has one meaning
    separators = re.compile(r"[\s,;\]]*" if resume else r"[\s,]*")
    position, failures = 0, 0
    while (position := _end_of_match(separators, text, position)) < len(text):
        try:
            value, end = decoder.raw_decode(text, position)
            json.dumps(value, ensure_ascii=False).encode()  # refuses half a surrogate pair, which no file can hold
        # Also numbers of thousands of digits, and what is nested too deeply
        except (ValueError, RecursionError) as error:
            if not resume:
                raise ValueError from error
            failures += 1
            if text[position] == "[" and failures < _MOST_FAILURES:  # the items are read one by one
                position += 1
                continue
            yield ValueError(_describe_failure(error, text, position))
            following = _NEXT_OBJECT.search(text, position)
            if following is None or failures == _MOST_FAILURES:
                return
            position = following.end()
        else:
            yield value
            position = end


def _end_of_match(pattern: re.Pattern[str], text: str, position: int) -> int:
    found = pattern.match(text, position)
    return found.end() if found else position


def _describe_failure(error: Exception, text: str, position: int) -> str:
    said, position = (error.msg, error.pos) if isinstance(error, json.JSONDecodeError) else (str(error), position)
    rest = text[position : position + _SHOWN].partition("\n")[0]
    return f"{said} at {rest!r}" if rest else f"{said} at the end of a line"


def _spell_strictly(text: str) -> str:
    """``text`` in the spelling of JSON, as far as its tokens are known; what is unknown stays as it is."""
    written: list[str] = []
    comma = -1  # where the last comma stands that nothing but space follows
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


def _escape_for_double_quotes(found: re.Match[str]) -> str:
    return '\\"' if found[0] == '"' else found[1] if found[1] == "'" else found[0]
