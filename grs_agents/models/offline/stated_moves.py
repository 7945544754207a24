"""Where a program of the offline author moves its objects to, read from its source."""

import ast
import math
from dataclasses import dataclass
from typing import Any

from grs_agents.models.offline import program_edits


@dataclass(frozen=True)
class StatedMove:
    """One row of the program's ``moves``."""

    asset: str
    number: int  # which of the objects of that asset, from 0, in the order in which they are added
    support: int | None  # which of the fixed things it goes to, from 0; None for a place on the table
    place: tuple[float, float] | None  # x, y in the frame of that thing or of the robot, metres; None: drawn at random
    extent: tuple[float, float] | None  # the extents of a zone around that thing that will do; None: just there
    turned: float  # by how much that thing is turned about z against the frame of place and extents, rad


def parse_stated_moves(source: str) -> list[StatedMove]:
    """The moves in their order; none in a program that is written another way."""
    tree = program_edits.parse_syntax_tree(source) or ast.Module([], [])
    values = {ast.unparse(node.targets[0]): node.value for node in ast.walk(tree) if isinstance(node, ast.Assign)}
    rows, added = values.get("moves"), _find_added_objects(tree)
    if not isinstance(rows, ast.List):
        return []
    is_zone = "metric='zone'" in [ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.keyword)]
    moves = [_parse_move_row(row, values, added, is_zone) for row in rows.elts if isinstance(row, ast.Tuple)]
    return [move for move in moves if move is not None]


def _find_added_objects(tree: ast.Module) -> list[tuple[str, str, str]]:
    """The variable, asset and pose of each ``env.add_object`` in order, as source; no variable for fixed things."""
    calls = sorted(
        (node for node in ast.walk(tree) if isinstance(node, ast.Assign | ast.Expr) and _is_adding_object(node.value)),
        key=lambda node: node.lineno,
    )
    added: list[tuple[str, str, str]] = []
    for node in calls:
        call: Any = node.value
        variable = ast.unparse(node.targets[0]) if isinstance(node, ast.Assign) else ""
        added.append((variable, ast.unparse(call.args[0]).strip("'"), ast.unparse(call.args[1])))
    return added


def _is_adding_object(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "env.add_object" and len(node.args) > 1


def _parse_move_row(
    row: ast.Tuple, values: dict[str, ast.expr], added: list[tuple[str, str, str]], is_zone: bool
) -> StatedMove | None:
    """A row ``(variable, label, place, pose, size, offset, rotation)``; None where it is another one."""
    if len(row.elts) != 7:
        return None
    item, _, _, pose, size, offset, _ = row.elts
    variable = ast.unparse(item)
    asset = next((asset for name, asset, _ in added if name == variable), None)
    if asset is None:
        return None
    alike = [name for name, other, _ in added if other == asset]
    support = _find_support_at_pose(ast.unparse(pose), added)
    # A size by its name is that of the whole zone; one in numbers is that of the object's own spot, as its place is.
    extents = _parse_literal(values.get(size.id)) if is_zone and isinstance(size, ast.Name) else None
    place = _compute_move_target(_parse_literal(values.get(ast.unparse(pose))), _parse_literal(offset), support)
    extent = (extents[0], extents[1]) if extents else None
    return StatedMove(asset, alike.index(variable), support, place, extent, _find_yaw_of_support(support, added))


def _find_support_at_pose(pose: str, added: list[tuple[str, str, str]]) -> int | None:
    """Which of the fixed things stands at a pose, from 0."""
    fixed = [where for variable, _, where in added if not variable]
    return next((index for index, where in enumerate(fixed) if where.lstrip("(").startswith(pose)), None)


def _find_yaw_of_support(support: int | None, added: list[tuple[str, str, str]]) -> float:
    """The yaw of a fixed thing whose pose has a rotation of its own; 0 where it lies as its place does."""
    where = [where for variable, _, where in added if not variable][support] if support is not None else ""
    pose = ast.parse(where or "None", mode="eval").body
    rotation = _parse_literal(pose.elts[1]) if isinstance(pose, ast.Tuple) and len(pose.elts) == 2 else None
    if rotation is None:
        return 0.0
    x, y, z, w = rotation
    return round(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), 4)


def _compute_move_target(origin: Any, offset: Any, support: int | None) -> tuple[float, float] | None:
    """Where a move goes: from the thing that it goes to, else from the robot; None where that is drawn at random."""
    if offset is None or (support is None and origin is None):
        return None
    x, y = (0.0, 0.0) if support is not None else origin[0][:2]
    return x + offset[0], y + offset[1]


def _parse_literal(node: ast.expr | None) -> Any:
    """The numbers of a literal; None for what is computed."""
    try:
        return None if node is None else ast.literal_eval(node)
    except ValueError:
        return None
