"""Text made safe to show: in the rerun viewer, whose fonts lack most scripts, and in a terminal."""

import re
import unicodedata

from grs_agents.base.terminal.control_characters import escape_control_chars

LONGEST = 60_000
"""Characters of one document that the viewer is given; the whole text is in ``events.jsonl``."""
_SYMBOLS = "–—‘’“”…•×÷±°µ·←↑→↓≤≥≈≠√∞▶■●✓"
_UNDRAWABLE = re.compile(f"[^\t\n\x20-\x7e\xa1-\xac\xae-\xff\u0100-\u017f\u0391-\u03c9\u0410-\u044f{_SYMBOLS}]")
_COLORS = re.compile(r"\x1b\[[0-9;]*m")


def replace_undrawable_chars(text: str) -> str:
    """``text`` with every character that the viewer's fonts cannot draw replaced by an equivalent or its code.

    Emoji and CJK abort the headless viewer, so ``"\U0001f600"`` becomes ``"<U+1F600>"``; full-width letters become
    plain ones. Drawable text is returned as it is.
    """
    return _UNDRAWABLE.sub(_drawable_replacement, text)


def _drawable_replacement(match: re.Match[str]) -> str:
    """An equivalent of one character that fonts have, nothing for invisible ones, or its code."""
    character = match[0]
    simple = unicodedata.normalize("NFKC", character)
    if not _UNDRAWABLE.search(simple):
        return simple
    if character == "\r" or unicodedata.category(character) in ("Cf", "Mn"):
        return ""
    return f"<U+{ord(character):04X}>"


def to_viewer_markdown(text: str) -> str:
    """``text`` as a Markdown document for the viewer: drawable, of bounded length, and fetching no pictures."""
    if len(text) > LONGEST:
        text = f"{text[:LONGEST]}\n\n... {len(text) - LONGEST} more characters in events.jsonl"
    return replace_undrawable_chars(text).replace("![", "! [")


def to_markdown_code_block(text: str, language: str = "") -> str:
    """``text`` as a Markdown code block that no run of backticks inside can close."""
    fence = "`" * max(3, max((len(run) for run in re.findall(r"`+", text)), default=0) + 1)
    return f"{fence}{language}\n{text.rstrip()}\n{fence}"


def to_markdown_cell(text: object) -> str:
    """``text`` as one cell of a Markdown table."""
    return " ".join(str(text).split()).replace("|", "\\|")


def to_terminal_line(text: str, length: int = 200) -> str:
    """``text`` as one line for a terminal, of at most ``length`` characters: no colours, nothing hidden."""
    line = escape_control_chars(" ".join(_COLORS.sub("", text).split()))
    return line if len(line) <= length else f"{line[: length - 1]}…"
