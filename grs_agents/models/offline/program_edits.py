"""Small in-place edits of program text, located by its syntax tree."""

import ast
import itertools
import re
from collections.abc import Iterable

from grs_agents.base.python_parsing import parse_python


def parse_syntax_tree(source: str) -> ast.Module | None:
    """The syntax tree, or None for text that is not Python."""
    try:
        return parse_python(source)
    except (SyntaxError, ValueError):
        return None


def find_task_class_name(source: str) -> str:
    """The name of the last class in ``source`` that has bases; by pattern if it does not parse."""
    tree = parse_syntax_tree(source)
    if tree is None:
        names = re.findall(r"^class (\w+)", source, re.MULTILINE)
        return str(names[-1]) if names else "Task"
    classes = [node.name for node in tree.body if isinstance(node, ast.ClassDef) and node.bases]
    return classes[-1] if classes else "Task"


def find_asset_names(source: str) -> set[str]:
    """The URDF names that ``source`` spells out."""
    return set(re.findall(r"[\"']([\w./-]+\.urdf)[\"']", source))


def scale_target_sizes(source: str, factor: float) -> str | None:
    """``source`` with the x and y extents of its containers and zones scaled; None if it has none."""
    edits: list[tuple[ast.expr, str]] = []
    for node in _find_assignments(source):
        name, value = _name_of_assigned_target(node.targets[0]), node.value
        if not name.endswith("_size") or not isinstance(value, ast.Tuple) or len(value.elts) != 3:
            continue
        for element in value.elts[:2]:
            if isinstance(element, ast.Constant) and isinstance(element.value, float | int):
                edits.append((element, f"{element.value * factor:.3f}"))
    return replace_nodes(source, edits) if edits else None


def replace_identifier(source: str, wrong: str, right: str) -> str | None:
    """``source`` with attribute or name ``wrong`` replaced by ``right``; None if it does not occur."""
    changed = re.sub(rf"\b{re.escape(wrong)}\b", right, source)
    return changed if changed != source else None


def remove_variable(source: str, name: str) -> str | None:
    """``source`` without variable ``name``: its assignment, and the list entries that use it.

    None if it is also used elsewhere, or a list becomes empty.
    """
    tree = parse_syntax_tree(source)
    if tree is None:
        return None
    edits: list[tuple[ast.expr, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.List) and name in _collect_identifiers(node):
            kept = [part for part in node.elts if name not in _collect_identifiers(part)]
            texts = [ast.get_source_segment(source, part) or "" for part in kept]
            text = f"[{', '.join(texts)}]"
            if node.lineno != node.end_lineno and kept:  # an entry per line
                indent = " " * kept[0].col_offset
                text = "[\n" + "".join(f"{indent}{entry},\n" for entry in texts) + f"{indent[4:]}]"
            edits.append((node, text))
    removed = [(node, "") for node in _find_assignments(source) if name in map(_name_of_assigned_target, node.targets)]
    changed = replace_nodes(source, [*edits, *removed])
    left = _collect_identifiers(parse_syntax_tree(changed) or tree)
    return None if name in left or "[]" in [text for _, text in edits] else changed


def _find_assignments(source: str) -> list[ast.Assign]:
    tree = parse_syntax_tree(source)
    return [node for node in ast.walk(tree) if isinstance(node, ast.Assign)] if tree else []


def _name_of_assigned_target(target: ast.expr) -> str:
    """Name of an assigned variable or attribute; empty for any other target."""
    return target.id if isinstance(target, ast.Name) else target.attr if isinstance(target, ast.Attribute) else ""


def _collect_identifiers(node: ast.AST) -> set[str]:
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def replace_nodes(source: str, edits: Iterable[tuple[ast.expr | ast.stmt, str]]) -> str:
    """``source`` with the text of each node replaced; lines left blank are removed."""
    data = source.encode()
    starts = [0, *itertools.accumulate(len(line) for line in data.splitlines(keepends=True))]
    for node, text in sorted(edits, key=lambda edit: (-edit[0].lineno, -edit[0].col_offset)):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
        if not text and data[end : end + 1] in (b"", b"\n", b",") and not data[starts[node.lineno - 1] : begin].strip():
            begin, end = starts[node.lineno - 1], data.find(b"\n", end) + 1 or len(data)
        data = data[:begin] + text.encode() + data[end:]
    return data.decode()
