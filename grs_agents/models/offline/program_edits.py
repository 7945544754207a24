"""Small edits of program text, found by its syntax tree and made in place, so that all else stays as it was."""

import ast
import re
from collections.abc import Iterable, Iterator, Sequence

KNOWN_NAMES = {
    "np": "import numpy as np",
    "numpy": "import numpy",
    "math": "import math",
    "random": "import random",
    "itertools": "import itertools",
    "unittest": "import unittest",
    "os": "import os",
    "Task": "from grs_agents.sim import Task",
    "Environment": "from grs_agents.sim import Environment",
    "utils": "from grs_agents.sim import utils",
    "p": "from grs_agents.sim import p",
}
"""The import that defines each name programs commonly forget."""


def parse_syntax_tree(source: str) -> ast.Module | None:
    """The syntax tree, or None for text that is not Python."""
    try:
        return ast.parse(source)
    except (SyntaxError, ValueError):
        return None


def find_task_class_name(source: str) -> str:
    """The name of the last class in ``source`` that has bases; by pattern where it does not parse."""
    tree = parse_syntax_tree(source)
    if tree is None:
        names = re.findall(r"^class (\w+)", source, re.MULTILINE)
        return str(names[-1]) if names else "Task"
    classes = [node.name for node in tree.body if isinstance(node, ast.ClassDef) and node.bases]
    return classes[-1] if classes else "Task"


def find_asset_names(source: str) -> set[str]:
    """The URDF names that ``source`` spells out."""
    return set(re.findall(r"[\"']([\w./-]+\.urdf)[\"']", source))


def add_import(source: str, name: str) -> str | None:
    """``source`` with the import that defines ``name``; None where it is not a known one or is there already."""
    line = KNOWN_NAMES.get(name)
    if line is None or re.search(rf"^{re.escape(line)}$", source, re.MULTILINE):
        return None
    tree = parse_syntax_tree(source)
    body = tree.body if tree else []
    has_docstring = bool(body) and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant)
    after = (body[0].end_lineno or 0) if has_docstring else 0
    lines = source.splitlines()
    return "\n".join([*lines[:after], line, *lines[after:]]) + "\n"


def set_max_steps(source: str, steps: int) -> str | None:
    """``source`` with another number of steps; None where it assigns none."""
    assignments = [node for node in _find_assignments(source) if _assigned_name(node.targets[0]) == "max_steps"]
    return _replace_expressions(source, ((node.value, str(steps)) for node in assignments)) if assignments else None


def scale_target_sizes(source: str, factor: float) -> str | None:
    """``source`` with the x and y extents of its containers and zones scaled; None where it states none."""
    edits: list[tuple[ast.expr, str]] = []
    for node in _find_assignments(source):
        name, value = _assigned_name(node.targets[0]), node.value
        if not name.endswith("_size") or not isinstance(value, ast.Tuple) or len(value.elts) != 3:
            continue
        for element in value.elts[:2]:
            if isinstance(element, ast.Constant) and isinstance(element.value, float | int):
                edits.append((element, f"{element.value * factor:.3f}"))
    return _replace_expressions(source, edits) if edits else None


def replace_identifier(source: str, wrong: str, right: str) -> str | None:
    """``source`` with attribute or name ``wrong`` spelt ``right``; None where it does not occur."""
    changed = re.sub(rf"\b{re.escape(wrong)}\b", right, source)
    return changed if changed != source else None


def remove_asset(source: str, asset: str) -> str | None:
    """``source`` without the list entries and statements about ``asset``; None where that leaves no whole program.

    Rows of literal lists and dictionaries that name the asset go first; a statement that adds it goes with the list
    entries that mention its variable.
    """
    tree = parse_syntax_tree(source)
    if tree is None:
        return None
    calls = [
        node for node in _find_assignments(source) if isinstance(node.value, ast.Call) and _has_constant(node, asset)
    ]
    variables = {target.id for node in calls for target in node.targets if isinstance(target, ast.Name)}
    changed = _delete_node_lines(
        source, [*calls, *_entries_using_variables(tree, variables), *_entries_naming_asset(tree, asset)]
    )
    return changed if parse_syntax_tree(changed) is not None and asset not in find_asset_names(changed) else None


def _entries_using_variables(tree: ast.Module, variables: set[str]) -> Iterator[ast.expr]:
    """The list entries that use one of ``variables``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.List):
            yield from (row for row in node.elts if variables & _collect_identifiers(row))


def _entries_naming_asset(tree: ast.Module, asset: str) -> Iterator[ast.expr]:
    """The entries of literal lists of several entries that name ``asset``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.List | ast.Tuple) and len(node.elts) > 1 and not isinstance(node.ctx, ast.Store):
            rows = (row for row in node.elts if isinstance(row, ast.Dict | ast.Tuple | ast.List | ast.Constant))
            yield from (row for row in rows if _has_constant(row, asset))


def _find_assignments(source: str) -> list[ast.Assign]:
    tree = parse_syntax_tree(source)
    return [node for node in ast.walk(tree) if isinstance(node, ast.Assign)] if tree else []


def _assigned_name(target: ast.expr) -> str:
    """The variable or attribute that is assigned to; empty for anything else."""
    return target.id if isinstance(target, ast.Name) else target.attr if isinstance(target, ast.Attribute) else ""


def _has_constant(node: ast.AST, text: str) -> bool:
    return any(isinstance(part, ast.Constant) and part.value == text for part in ast.walk(node))


def _collect_identifiers(node: ast.AST) -> set[str]:
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def _delete_node_lines(source: str, nodes: Sequence[ast.expr | ast.stmt]) -> str:
    """``source`` without the lines of ``nodes``."""
    if not nodes:
        return source
    gone = {number for node in nodes for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    return "\n".join(line for number, line in enumerate(source.splitlines(), 1) if number not in gone) + "\n"


def _replace_expressions(source: str, edits: Iterable[tuple[ast.expr, str]]) -> str:
    lines = source.splitlines()
    for node, text in sorted(edits, key=lambda edit: (-edit[0].lineno, -edit[0].col_offset)):
        line = lines[node.lineno - 1].encode()
        if node.end_lineno == node.lineno:
            lines[node.lineno - 1] = (line[: node.col_offset] + text.encode() + line[node.end_col_offset :]).decode()
    return "\n".join(lines) + "\n"
