"""Count the assertions that a test really comes to, not those that merely stand in its source.

The syntax tree of the test program gets a call before each statement that asserts something. Line numbers stay as they
are. An ``if``, ``try`` or loop whose branches raise or fail is an assertion too: it counts when it is reached.
"""

import ast
from collections.abc import Iterator
from typing import cast

COUNTER = "__asserted__"
"""The name that a counted program finds its counter by."""
_FIXTURES = frozenset(f"{prefix}{suffix}" for prefix in ("setUp", "tearDown") for suffix in ("", "Class", "Module")) | {
    "asyncSetUp",
    "asyncTearDown",
}
_BODIES = ("body", "orelse", "finalbody")
_Compound = ast.If | ast.Try | ast.For | ast.AsyncFor | ast.While | ast.With | ast.AsyncWith | ast.Match
_Scope = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda


class Counter:
    """How many assertions were reached since ``count`` was last set to 0."""

    def __init__(self) -> None:
        self.count = 0

    def reached(self) -> None:
        """One more."""
        self.count += 1


def with_counter_calls(tree: ast.Module) -> ast.Module:
    """``tree`` with a call of ``COUNTER`` before each statement that asserts; what ``setUp`` asserts is no test's."""
    return ast.fix_missing_locations(_Marker().visit(tree))


def is_assertion(name: str) -> bool:
    """Whether a function called ``name`` asserts something."""
    return name.lower().startswith("assert") or name in ("fail", "raises")


def called_name(call: ast.Call) -> str:
    """The last part of the name that a call is made by."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


class _Marker(ast.NodeTransformer):
    """Inserts the calls."""

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Mark the statements of each body of ``node``, inner ones first."""
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name in _FIXTURES:
            return node
        for name in _BODIES:
            body = getattr(node, name, None)
            if isinstance(body, list):
                statements = cast(list[ast.stmt], body)
                setattr(node, name, [marked for statement in statements for marked in self._marked(statement)])
        for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
            self.visit(part)
        return node

    def _marked(self, statement: ast.stmt) -> Iterator[ast.stmt]:
        asserts = _asserts(statement)
        self.visit(statement)
        if asserts:
            call = ast.Call(ast.Name(COUNTER, ast.Load()), [], [])
            yield ast.copy_location(ast.Expr(ast.copy_location(call, statement)), statement)
        yield statement


def _asserts(statement: ast.stmt) -> bool:
    """Whether a statement asserts something by itself, without what is inside it."""
    if isinstance(statement, _Compound):
        return any(map(_fails_test, _branches(statement))) or any(map(_calls_assertion, _headers(statement)))
    return isinstance(statement, ast.Assert) or _calls_assertion(statement)


def _branches(statement: ast.AST) -> Iterator[ast.stmt]:
    for name in _BODIES:
        yield from getattr(statement, name, ())
    for part in (*getattr(statement, "handlers", ()), *getattr(statement, "cases", ())):
        yield from part.body


def _headers(statement: _Compound) -> Iterator[ast.expr]:
    for name in ("test", "iter", "subject"):
        if hasattr(statement, name):
            yield getattr(statement, name)
    yield from (item.context_expr for item in getattr(statement, "items", ()))


def _fails_test(statement: ast.stmt) -> bool:
    """Whether a statement ends the test as failed."""
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
        return called_name(statement.value) == "fail"
    return isinstance(statement, ast.Raise)


def _calls_assertion(node: ast.AST) -> bool:
    if isinstance(node, _Scope):
        return False
    if isinstance(node, ast.Call) and is_assertion(called_name(node)):
        return True
    return any(map(_calls_assertion, ast.iter_child_nodes(node)))
