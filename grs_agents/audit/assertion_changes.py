"""Assertions that a fix of the tests removed or added; a weakened assertion shows as both."""

import ast
from collections import Counter

from grs_agents.base.python_parsing import parse_python

MOST = 12
"""Most changes of each kind that are listed."""
_LONGEST = 200


def find_changed_assertions(old: str, new: str) -> tuple[str, ...]:
    """List the changed assertions; messages do not count.

    Returns: lines ``- ...`` for assertions of the old tests alone, then ``+ ...`` for those of the new tests alone if
    any was removed; empty if either program is not Python.
    """
    try:
        before, after = _count_assertions(old), _count_assertions(new)
    except (SyntaxError, ValueError):
        return ()
    gone, come = list((before - after).elements()), list((after - before).elements())
    return tuple([f"- {text}" for text in gone[:MOST]] + [f"+ {text}" for text in come[:MOST] if gone])


def _count_assertions(source: str) -> Counter[str]:
    statements = [node for node in ast.walk(parse_python(source)) if isinstance(node, ast.Assert | ast.Expr)]
    return Counter(text[:_LONGEST] for text in map(_describe_assertion, statements) if text)


def _describe_assertion(statement: ast.Assert | ast.Expr) -> str:
    """Text of an assertion without its message; empty for any other statement."""
    if isinstance(statement, ast.Assert):
        return f"assert {ast.unparse(statement.test)}"
    call = statement.value
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
        return ""
    if not call.func.attr.startswith("assert"):
        return ""
    said = [
        *call.args[:1],
        *(
            part
            for part in call.args[1:]
            if not (isinstance(part, ast.JoinedStr) or (isinstance(part, ast.Constant) and isinstance(part.value, str)))
        ),
    ]
    kept = [word for word in call.keywords if word.arg != "msg"]
    return ast.unparse(ast.Call(ast.Name(call.func.attr, ast.Load()), said, kept))
