"""Fenced blocks of code in Markdown, as CommonMark reads them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

_FENCE = re.compile(r"^(?P<indent>[ \t]*)(?P<run>`{3,}|~{3,})(?P<info>[^\n]*)$", re.MULTILINE)
_MOST_INDENT = 3
"""Columns that a closing fence may be indented by beyond the opening one; further in it belongs to the code."""
_LANGUAGE = re.compile(r"[\w+#.-]*\w")
_LONGEST_LANGUAGE = 100
"""Characters of an info string that its first word is looked for in."""


@dataclass(frozen=True)
class FencedBlock:
    """A block of code in a text."""

    language: str  # the first word of its info string, in lower case: ``python`` of ``{.Python title="a.py"}``
    body: str  # as far as the text goes where no fence closes it
    start: int  # where it begins and ends in the text, with its fences
    end: int


def find_fenced_blocks(text: str) -> Iterator[FencedBlock]:
    """The fenced blocks of ``text``, whose lines end in ``\\n``.

    More lenient than CommonMark in two things: blocks may be indented as deeply as they like (in lists), and may begin
    and end in one line.
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
    return FencedBlock(word[0].lstrip(".").lower() if word else "", body, opened.start(), end)


def _count_columns(indent: str) -> int:
    return len(indent.expandtabs(4))
