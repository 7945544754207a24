"""Which tests a source contains, read from its syntax tree on the host: the program cannot take any away."""

import ast
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from grs_agents.sandbox.harness.assertion_count import called_name, is_assertion

_Function = ast.FunctionDef | ast.AsyncFunctionDef
MAX_SOURCE = 1 << 20
"""The longest program, in characters, that is looked at."""


@dataclass(frozen=True)
class ExpectedTests:
    """The tests of one file.

    Attributes:
        ids: ``Class.method`` in the order of the file.
        without_assertion: those whose body, helpers of the same file included, asserts nothing.
        duplicates: those that a class has twice, or whose class is there twice: the first of them never runs.
        lines: where the code of each begins, but for those that a decorator may have put something in front of.
        chooses: whether the file has a ``load_tests`` of its own, which says what there is to run.
    """

    ids: tuple[str, ...]
    without_assertion: frozenset[str]
    duplicates: frozenset[str] = frozenset()
    lines: Mapping[str, int] = field(default_factory=dict[str, int])
    chooses: bool = False


def parse(source: str, filename: str) -> ast.Module:
    """The syntax tree of ``source``.

    Raises:
        SyntaxError: it is not Python, too long, or nested too deeply.
    """
    if len(source) > MAX_SOURCE:
        raise SyntaxError(f"{filename} has {len(source)} characters; the most is {MAX_SOURCE}")
    try:
        return ast.parse(source, filename)
    except SyntaxError:
        raise
    except (ValueError, RecursionError, MemoryError) as error:
        raise SyntaxError(f"{filename} cannot be parsed: {error or type(error).__name__}") from error


def expected_tests(tree: ast.Module) -> ExpectedTests:
    """The ``test*`` methods of every module-level class that derives from a ``unittest`` test case."""
    classes = {node.name: node for node in _statements(tree.body) if isinstance(node, ast.ClassDef)}
    asserting = _asserting_names(tree)
    silent: set[str] = set()
    duplicates: set[str] = set()
    lines: dict[str, int] = {}
    ids: list[str] = []
    twice = _repeated([node for node in tree.body if isinstance(node, ast.ClassDef)])
    for name, node in classes.items():
        lineage = _lineage(node, classes)
        if not any(_is_test_case(base, classes) for one in lineage for base in one.bases):
            continue
        methods = {method.name: method for one in reversed(lineage) for method in _methods(one)}
        again = {
            two for one in lineage for two in _repeated([item for item in one.body if isinstance(item, _Function)])
        }
        plain = not any(one.decorator_list for one in lineage)
        for method in methods.values():
            if not method.name.startswith("test"):
                continue
            item = f"{name}.{method.name}"
            ids.append(item)
            if not _asserts(method, asserting):
                silent.add(item)
            if name in twice or method.name in again:
                duplicates.add(item)
            if plain and not method.decorator_list:
                lines[item] = method.lineno
    return ExpectedTests(tuple(ids), frozenset(silent), frozenset(duplicates), lines, _chooses(tree))


def _repeated(definitions: Sequence[_Function | ast.ClassDef]) -> set[str]:
    """The names that are defined more than once."""
    return {name for name, count in Counter(one.name for one in definitions).items() if count > 1}


def _chooses(tree: ast.Module) -> bool:
    """Whether a module has something called ``load_tests``."""
    return any(
        (isinstance(node, _Function) and node.name == "load_tests")
        or (isinstance(node, ast.Name) and node.id == "load_tests" and isinstance(node.ctx, ast.Store))
        or (isinstance(node, ast.alias) and (node.asname or node.name) == "load_tests")
        for statement in tree.body
        if not isinstance(statement, ast.ClassDef)
        for node in ([statement] if isinstance(statement, _Function) else ast.walk(statement))
    )


def _statements(body: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements of a body, those under ``if``, ``try`` and ``with`` included."""
    for node in body:
        yield node
        if isinstance(node, ast.If | ast.Try | ast.With):
            yield from _statements(node.body)


def _methods(node: ast.ClassDef) -> list[_Function]:
    return [one for one in _statements(node.body) if isinstance(one, _Function)]


def _lineage(node: ast.ClassDef, classes: dict[str, ast.ClassDef]) -> list[ast.ClassDef]:
    """``node`` and its ancestors within the file, nearest first."""
    found = [node]
    for one in found:
        for base in one.bases:
            parent = classes.get(base.id) if isinstance(base, ast.Name) else None
            if parent is not None and parent not in found:
                found.append(parent)
    return found


def _is_test_case(base: ast.expr, classes: dict[str, ast.ClassDef]) -> bool:
    if isinstance(base, ast.Attribute):
        return base.attr.endswith("TestCase")
    return isinstance(base, ast.Name) and base.id not in classes and base.id.endswith("TestCase")


def _asserting_names(tree: ast.Module) -> set[str]:
    """The functions of the file that assert something, directly or through each other."""
    functions = [node for node in ast.walk(tree) if isinstance(node, _Function)]
    asserting: set[str] = set()
    while found := {one.name for one in functions if one.name not in asserting and _asserts(one, asserting)}:
        asserting |= found
    return asserting


def _asserts(function: _Function, asserting: set[str]) -> bool:
    for node in ast.walk(function):
        if isinstance(node, ast.Assert | ast.Raise):
            return True
        if isinstance(node, ast.Call):
            name = called_name(node)
            if is_assertion(name) or name in asserting:
                return True
    return False
