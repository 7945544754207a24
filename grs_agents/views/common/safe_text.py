"""Sanitized text for the rerun viewer, whose fonts lack most scripts, and for terminals."""

import re
import unicodedata

from grs_agents.base.control_characters import escape_control_chars

LONGEST = 60_000
"""Characters of a viewer document; the full text is in ``events.jsonl``."""
_SYMBOLS = "–—‘’“”…•×÷±°µ·←↑→↓≤≥≈≠√∞▶■●✓"
_UNDRAWABLE = re.compile(f"[^\t\n\x20-\x7e\xa1-\xac\xae-\xff\u0100-\u017f\u0391-\u03c9\u0410-\u044f{_SYMBOLS}]")
_COLORS = re.compile(r"\x1b\[[0-9;]*m")


def replace_undrawable_chars(text: str) -> str:
    """Replace characters missing from the viewer's fonts by an equivalent or by their code.

    Emoji and CJK abort the headless viewer, so ``"\U0001f600"`` becomes ``"<U+1F600>"``; full-width letters become
    plain letters. Drawable text is unchanged.
    """
    return _UNDRAWABLE.sub(_drawable_replacement, text)


def _drawable_replacement(match: re.Match[str]) -> str:
    """The NFKC equivalent of a character if fonts have it, nothing for an invisible character, else its code."""
    character = match[0]
    simple = unicodedata.normalize("NFKC", character)
    if not _UNDRAWABLE.search(simple):
        return simple
    if character == "\r" or unicodedata.category(character) in ("Cf", "Mn"):
        return ""
    return f"<U+{ord(character):04X}>"


def to_viewer_markdown(text: str) -> str:
    """``text`` as a Markdown document for the viewer: drawable, bounded in length, without fetched pictures."""
    if len(text) > LONGEST:
        text = f"{text[:LONGEST]}\n\n... {len(text) - LONGEST} more characters in events.jsonl"
    return replace_undrawable_chars(text).replace("![", "! [")


def to_markdown_code_block(text: str, language: str = "") -> str:
    """``text`` as a Markdown code block whose fence is longer than any run of backticks inside."""
    fence = "`" * max(3, max((len(run) for run in re.findall(r"`+", text)), default=0) + 1)
    return f"{fence}{language}\n{text.rstrip()}\n{fence}"


def to_markdown_cell(text: object) -> str:
    """``text`` as a cell of a Markdown table."""
    return " ".join(str(text).split()).replace("|", "\\|")


def to_terminal_line(text: str, length: int = 200) -> str:
    """``text`` as a single terminal line of at most ``length`` characters, without colours; control characters are
    escaped."""
    line = escape_control_chars(" ".join(_COLORS.sub("", text).split()))
    return line if len(line) <= length else f"{line[: length - 1]}…"
