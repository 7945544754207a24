"""``--where``: an expression over the columns of a batch, evaluated on its syntax tree and never executed."""

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.runs.batch.row import BatchRow

_COMPARE: Final[Mapping[type[ast.cmpop], Callable[[Any, Any], Any]]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda part, whole: part in whole,
    ast.NotIn: lambda part, whole: part not in whole,
}
_REMEDY: Final = "compare columns with and, or, not, in, ==, !=, <, <=, >, >=, as in 'status == \"accepted\"'"


def select_rows(rows: Sequence[BatchRow], expression: str) -> list[BatchRow]:
    """The rows that satisfy ``expression``, such as ``status == "accepted" and fixes < 2``.

    A missing value equals None and fails every order comparison.

    Raises:
        InputError: no comparison of columns.
    """
    try:
        tree = ast.parse(expression, mode="eval").body
        return [row for row in rows if _evaluate_node(tree, row.model_dump())]
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"cannot read the condition {expression[:80]!r}: {error}", _REMEDY) from error


def _evaluate_node(node: ast.expr, row: Mapping[str, Any]) -> Any:
    value: Any
    match node:
        case ast.BoolOp():
            value = (all if isinstance(node.op, ast.And) else any)(_evaluate_node(part, row) for part in node.values)
        case ast.UnaryOp(op=ast.Not()):
            value = not _evaluate_node(node.operand, row)
        case ast.Compare():
            value = _evaluate_comparison(node, row)
        case ast.Constant():
            value = node.value
        case ast.Tuple() | ast.List():
            value = [_evaluate_node(item, row) for item in node.elts]
        case ast.Name() if node.id in row:
            value = row[node.id]
        case ast.Name():
            raise UnknownNameError("column", node.id, row)
        case _:
            raise InputError(f"a condition cannot hold {ast.unparse(node)[:80]!r}", _REMEDY)
    return value


def _evaluate_comparison(node: ast.Compare, row: Mapping[str, Any]) -> bool:
    values = [_evaluate_node(value, row) for value in (node.left, *node.comparators)]
    for test, left, right in zip(node.ops, values, values[1:], strict=False):
        known = _COMPARE.get(type(test))
        if known is None:
            raise InputError(f"a condition cannot hold {ast.unparse(node)[:80]!r}", _REMEDY)
        try:
            if not known(left, right):
                return False
        except TypeError as error:
            if left is None or right is None:
                return False
            raise InputError(f"cannot compare {left!r} with {right!r}", _REMEDY) from error
    return True
