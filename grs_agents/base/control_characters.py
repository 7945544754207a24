"""Escaping of control characters and spreadsheet formulas, for text that people read."""

import re

_HIDDEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # C0 but for tabs and line breaks, DEL, C1
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # the order of letters
    "\u2028\u2029"  # line breaks that editors and terminals treat differently
    "\ud800-\udfff]"  # bytes of a name that is not UTF-8, which no terminal can be sent
)


_FORMULA = re.compile(r"(?!-?\d+(\.\d+)?(e[+-]?\d+)?$)[=+\-@\t\r]")
"""Start of a cell that spreadsheets evaluate; a negative number is none."""


def escape_formula(cell: object) -> object:
    """A cell of a CSV file; text that a spreadsheet would evaluate begins with an apostrophe."""
    return f"'{cell}" if isinstance(cell, str) and _FORMULA.match(cell) else cell


def escape_control_chars(text: str) -> str:
    r"""``text`` with its control characters spelt out, e.g. ``\x1b``; line breaks and tabs stay.

    Visible characters are kept, so the function is idempotent.
    """
    return _HIDDEN.sub(_escape_code_of_match, text.replace("\r\n", "\n"))


def _escape_code_of_match(match: re.Match[str]) -> str:
    code = ord(match[0])
    if 0xDC80 <= code <= 0xDCFF:
        code -= 0xDC00  # the byte that Python keeps so in the name of a file
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
