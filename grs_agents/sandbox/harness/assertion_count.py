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

    def increment(self) -> None:
        """One more."""
        self.count += 1


def insert_counter_calls(tree: ast.Module) -> ast.Module:
    """``tree`` with a call of ``COUNTER`` before each statement that asserts; what ``setUp`` asserts is no test's."""
    return ast.fix_missing_locations(_Marker().visit(tree))


def is_assertion_name(name: str) -> bool:
    """Whether a function called ``name`` asserts something."""
    return name.lower().startswith("assert") or name in ("fail", "raises")


def called_function_name(call: ast.Call) -> str:
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
                setattr(
                    node, name, [marked for statement in statements for marked in self._prepend_counter_call(statement)]
                )
        for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
            self.visit(part)
        return node

    def _prepend_counter_call(self, statement: ast.stmt) -> Iterator[ast.stmt]:
        asserts = _is_asserting_statement(statement)
        self.visit(statement)
        if asserts:
            call = ast.Call(ast.Name(COUNTER, ast.Load()), [], [])
            yield ast.copy_location(ast.Expr(ast.copy_location(call, statement)), statement)
        yield statement


def _is_asserting_statement(statement: ast.stmt) -> bool:
    """Whether a statement asserts something by itself, without what is inside it."""
    if isinstance(statement, _Compound):
        return any(map(_is_fail_or_raise, _iterate_branch_statements(statement))) or any(
            map(_contains_assertion_call, _iterate_header_expressions(statement))
        )
    return isinstance(statement, ast.Assert) or _contains_assertion_call(statement)


def _iterate_branch_statements(statement: ast.AST) -> Iterator[ast.stmt]:
    for name in _BODIES:
        yield from getattr(statement, name, ())
    for part in (*getattr(statement, "handlers", ()), *getattr(statement, "cases", ())):
        yield from part.body


def _iterate_header_expressions(statement: _Compound) -> Iterator[ast.expr]:
    for name in ("test", "iter", "subject"):
        if hasattr(statement, name):
            yield getattr(statement, name)
    yield from (item.context_expr for item in getattr(statement, "items", ()))


def _is_fail_or_raise(statement: ast.stmt) -> bool:
    """Whether a statement ends the test as failed."""
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
        return called_function_name(statement.value) == "fail"
    return isinstance(statement, ast.Raise)


def _contains_assertion_call(node: ast.AST) -> bool:
    if isinstance(node, _Scope):
        return False
    if isinstance(node, ast.Call) and is_assertion_name(called_function_name(node)):
        return True
    return any(map(_contains_assertion_call, ast.iter_child_nodes(node)))
