"""Test discovery by the syntax tree of a source, on the host: the program cannot remove tests from it."""

import ast
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import UnionType

from grs_agents.base.python_parsing import parse_python
from grs_agents.sandbox.harness.assertion_count import called_function_name, is_assertion_name

_Function = ast.FunctionDef | ast.AsyncFunctionDef
MAX_SOURCE = 1 << 20
"""The longest program, in characters, that is looked at."""


@dataclass(frozen=True)
class ExpectedTests:
    """The tests of a file."""

    ids: tuple[str, ...]  # `Class.method` in the order of the file
    without_assertion: frozenset[str]  # tests without assertions, helpers of the same file included
    # tests that a class has twice, or whose class is defined twice: the first definition never runs
    duplicates: frozenset[str] = frozenset()
    # first line of each test, except under decorators that may replace it
    lines: Mapping[str, int] = field(default_factory=dict[str, int])
    chooses: bool = False  # the file has a `load_tests` of its own, which chooses the tests


def parse_program(source: str, filename: str) -> ast.Module:
    """The syntax tree of ``source``; ``SyntaxError`` if it is not Python, too long, or nested too deeply."""
    if len(source) > MAX_SOURCE:
        raise SyntaxError(f"{filename} has {len(source)} characters; the most is {MAX_SOURCE}")
    try:
        return parse_python(source, filename)
    except SyntaxError:
        raise
    except (ValueError, RecursionError, MemoryError) as error:
        raise SyntaxError(f"{filename} cannot be parsed: {error or type(error).__name__}") from error


def discover_tests(tree: ast.Module) -> ExpectedTests:
    """The ``test*`` methods of every module-level class that derives from a ``unittest`` test case."""
    classes = {node.name: node for node in _flatten_statements(tree.body) if isinstance(node, ast.ClassDef)}
    repeated_classes = _find_repeated_names(tree.body, ast.ClassDef)
    methods: dict[str, _Function] = {}
    duplicates: set[str] = set()
    lines: dict[str, int] = {}
    for name, node in classes.items():
        lineage = [node]  # the class and its ancestors within the file, nearest first
        for child in lineage:
            for base in child.bases:
                parent = classes.get(base.id) if isinstance(base, ast.Name) else None
                if parent is not None and parent not in lineage:
                    lineage.append(parent)
        repeated_methods = set[str]().union(*(_find_repeated_names(parent.body, _Function) for parent in lineage))
        decorated = any(parent.decorator_list for parent in lineage)
        for method in _test_methods(lineage, classes):
            item = f"{name}.{method.name}"
            methods[item] = method
            if name in repeated_classes or method.name in repeated_methods:
                duplicates.add(item)
            if not decorated and not method.decorator_list:
                lines[item] = method.lineno
    functions = [node for node in ast.walk(tree) if isinstance(node, _Function)]
    asserting: set[str] = set()
    while more := {node.name for node in functions if node.name not in asserting and _has_assertion(node, asserting)}:
        asserting |= more
    silent = frozenset(item for item, method in methods.items() if not _has_assertion(method, asserting))
    chooses = any(
        (isinstance(node, _Function) and node.name == "load_tests")
        or (isinstance(node, ast.Name) and node.id == "load_tests" and isinstance(node.ctx, ast.Store))
        or (isinstance(node, ast.alias) and (node.asname or node.name) == "load_tests")
        for statement in tree.body
        if not isinstance(statement, ast.ClassDef)
        for node in ([statement] if isinstance(statement, _Function) else ast.walk(statement))
    )
    return ExpectedTests(tuple(methods), silent, frozenset(duplicates), lines, chooses)


def _test_methods(lineage: Sequence[ast.ClassDef], classes: Mapping[str, ast.ClassDef]) -> list[_Function]:
    """The tests of a class with these ancestors, inherited tests included; none if it is no test case."""
    bases = [base for parent in lineage for base in parent.bases]
    names = [base.attr for base in bases if isinstance(base, ast.Attribute)]
    names += [base.id for base in bases if isinstance(base, ast.Name) and base.id not in classes]
    if not any(name.endswith("TestCase") for name in names):
        return []
    functions = (node for parent in reversed(lineage) for node in _flatten_statements(parent.body))
    methods = {node.name: node for node in functions if isinstance(node, _Function)}
    return [method for name, method in methods.items() if name.startswith("test")]


def _find_repeated_names(body: Sequence[ast.stmt], kind: type[ast.ClassDef] | UnionType) -> set[str]:
    """The names that several definitions of this kind have in a body."""
    names = Counter(getattr(node, "name", "") for node in body if isinstance(node, kind))
    return {name for name, count in names.items() if count > 1}


def _flatten_statements(body: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements of a body, those under ``if``, ``try`` and ``with`` included."""
    for node in body:
        yield node
        if isinstance(node, ast.If | ast.Try | ast.With):
            yield from _flatten_statements(node.body)


def _has_assertion(function: _Function, asserting: set[str]) -> bool:
    for node in ast.walk(function):
        if isinstance(node, ast.Assert | ast.Raise):
            return True
        if isinstance(node, ast.Call):
            name = called_function_name(node)
            if is_assertion_name(name) or name in asserting:
                return True
    return False
