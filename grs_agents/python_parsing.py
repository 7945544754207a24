"""Parse Python source from any thread."""

import ast
from threading import Lock

_PARSER = Lock()
"""CPython 3.11 counts how deep it is in a tree for all threads together: where two convert trees at once, one of them
gets a ``SystemError``."""


def parse_python(source: str, filename: str = "<unknown>") -> ast.Module:
    """The syntax tree of ``source``. Raises what ``ast.parse`` does: SyntaxError, ValueError, RecursionError and
    MemoryError, the last for what is nested too deeply.
    """
    with _PARSER:
        return ast.parse(source, filename)
