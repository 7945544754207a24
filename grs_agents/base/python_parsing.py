"""Parse Python source from any thread."""

import ast
from threading import Lock

_PARSER = Lock()
"""CPython 3.11 counts the depth in a tree over all threads, so concurrent conversions can raise ``SystemError``."""

MOST_CHARACTERS = 1 << 17
"""Of a source, ten times the longest published program. CPython 3.11 takes time quadratic in the fields of an f-string:
1.6 s for 150,000 characters, 12 s for 300,000."""


def parse_python(source: str, filename: str = "<unknown>") -> ast.Module:
    """Parse ``source`` into a syntax tree.

    Raises:
        SyntaxError: it is no Python, or longer than `MOST_CHARACTERS`.
        ValueError, RecursionError, MemoryError: as ``ast.parse``, the last for nesting that is too deep.
    """
    if len(source) > MOST_CHARACTERS:
        raise SyntaxError(f"the program has {len(source)} characters, more than {MOST_CHARACTERS}")
    with _PARSER:
        return ast.parse(source, filename)
