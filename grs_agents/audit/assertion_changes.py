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
    removed, added = list((before - after).elements()), list((after - before).elements())
    return tuple([f"- {text}" for text in removed[:MOST]] + [f"+ {text}" for text in added[:MOST] if removed])


def _count_assertions(source: str) -> Counter[str]:
    """Count assertions by their text without the message."""
    texts: list[str] = []
    for statement in ast.walk(parse_python(source)):
        if isinstance(statement, ast.Assert):
            texts.append(f"assert {ast.unparse(statement.test)}")
        if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Call):
            continue
        call = statement.value
        if isinstance(call.func, ast.Attribute) and call.func.attr.startswith("assert"):
            arguments = call.args[:1]
            for part in call.args[1:]:
                plain_text = isinstance(part, ast.Constant) and isinstance(part.value, str)
                if not plain_text and not isinstance(part, ast.JoinedStr):
                    arguments.append(part)
            keywords = [word for word in call.keywords if word.arg != "msg"]
            texts.append(ast.unparse(ast.Call(ast.Name(call.func.attr, ast.Load()), arguments, keywords)))
    return Counter(text[:_LONGEST] for text in texts)
