"""Count the assertions that a test executes, not those in its source.

The syntax tree of the test program gets a call before each statement that asserts something. Line numbers stay as they
are. An ``if``, ``try`` or loop whose branches raise or fail is an assertion too: it counts when it is reached.
"""

import ast
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
    """Number of assertions executed since ``count`` was last set to 0."""

    def __init__(self) -> None:
        self.count = 0

    def increment(self) -> None:
        """Count an assertion."""
        self.count += 1


def insert_counter_calls(tree: ast.Module) -> ast.Module:
    """Insert a call of ``COUNTER`` before each asserting statement of ``tree``; assertions in ``setUp`` do not
    count."""
    return ast.fix_missing_locations(_Marker().visit(tree))


def is_assertion_name(name: str) -> bool:
    """True if a function called ``name`` asserts."""
    return name.lower().startswith("assert") or name in ("fail", "raises")


def called_function_name(call: ast.Call) -> str:
    """The last part of the name that a call is made by."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


class _Marker(ast.NodeTransformer):
    """Inserts the calls."""

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Mark the statements of each body of ``node``, innermost first."""
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name in _FIXTURES:
            return node
        for name in _BODIES:
            body = getattr(node, name, None)
            if isinstance(body, list):
                marked: list[ast.stmt] = []
                for statement in cast(list[ast.stmt], body):
                    asserts = _is_asserting_statement(statement)
                    self.visit(statement)
                    if asserts:
                        call = ast.Call(ast.Name(COUNTER, ast.Load()), [], [])
                        marked.append(ast.copy_location(ast.Expr(ast.copy_location(call, statement)), statement))
                    marked.append(statement)
                setattr(node, name, marked)
        for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
            self.visit(part)
        return node


def _is_asserting_statement(statement: ast.stmt) -> bool:
    """True if a statement itself asserts, apart from its inner statements."""
    if isinstance(statement, _Compound):
        branches: list[list[ast.stmt]] = [getattr(statement, name, []) for name in _BODIES]
        branches += [part.body for part in (*getattr(statement, "handlers", ()), *getattr(statement, "cases", ()))]
        headers: list[ast.expr] = [
            getattr(statement, name) for name in ("test", "iter", "subject") if hasattr(statement, name)
        ]
        headers += [item.context_expr for item in getattr(statement, "items", ())]
        fails = any(
            isinstance(inner, ast.Raise)
            or (
                isinstance(inner, ast.Expr)
                and isinstance(inner.value, ast.Call)
                and called_function_name(inner.value) == "fail"
            )
            for branch in branches
            for inner in branch
        )
        return fails or any(map(_contains_assertion_call, headers))
    return isinstance(statement, ast.Assert) or _contains_assertion_call(statement)


def _contains_assertion_call(node: ast.AST) -> bool:
    if isinstance(node, _Scope):
        return False
    if isinstance(node, ast.Call) and is_assertion_name(called_function_name(node)):
        return True
    return any(map(_contains_assertion_call, ast.iter_child_nodes(node)))
