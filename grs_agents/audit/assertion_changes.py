"""Which assertions a fix of the tests took out or put in: one that asks for less shows as both."""

import ast
from collections import Counter

from grs_agents.base.python_parsing import parse_python

MOST = 12
"""So many of each are told."""
_LONGEST = 200


def find_changed_assertions(old: str, new: str) -> tuple[str, ...]:
    """Lines ``- ...`` for what the old tests assert and the new ones do not; and ``+ ...`` the other way round, if any
    was taken out. Messages do not count. Empty where one of them is not Python.
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
    """What a statement asserts, without its message; empty where it asserts nothing."""
    if isinstance(statement, ast.Assert):
        return f"assert {ast.unparse(statement.test)}"
    call = statement.value
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
        return ""
    if not call.func.attr.startswith("assert"):
        return ""
    said = [*call.args[:1], *(part for part in call.args[1:] if not _is_text_literal(part))]
    kept = [word for word in call.keywords if word.arg != "msg"]
    return ast.unparse(ast.Call(ast.Name(call.func.attr, ast.Load()), said, kept))


def _is_text_literal(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
