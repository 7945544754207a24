"""Assertions count when they are reached; the program otherwise does what it did."""

import ast
import importlib
from pathlib import Path

import pytest

from grs_agents.sandbox.harness.assertion_count import COUNTER, Counter, insert_counter_calls

SOURCE = '''
"""A docstring."""
from __future__ import annotations
def f(x):
    """Another."""
    if x > 5:
        raise ValueError(x)
    assert x < 5, x
    for item in range(x):
        assert item < x
    return x
def g():
    later = lambda: assertTrue(False)
    def inner(): assert False
async def asyncSetUp():
    assert True
def setUp():
    assert True
'''


AWAITED = "try: asyncSetUp().send(None)\nexcept StopIteration: pass"


def run(source: str) -> tuple[dict[str, object], Counter]:
    counter = Counter()
    scope: dict[str, object] = {COUNTER: counter.increment}
    exec(compile(insert_counter_calls(ast.parse(source)), "x.py", "exec"), scope)
    return scope, counter


@pytest.mark.parametrize(("call", "count"), [("f(0)", 2), ("f(3)", 5), ("setUp()", 0), ("g()", 0), (AWAITED, 0)])
def test_what_is_reached_is_counted(call: str, count: int) -> None:
    assert run(f"{SOURCE}\n{call}")[1].count == count


def test_lines_and_docstrings_stay() -> None:
    scope, _ = run(SOURCE)
    assert scope["__doc__"] == "A docstring."
    tree, marked = ast.parse(SOURCE), insert_counter_calls(ast.parse(SOURCE))
    lines = {node.lineno for node in ast.walk(tree) if isinstance(node, ast.stmt)}
    assert {node.lineno for node in ast.walk(marked) if isinstance(node, ast.stmt)} == lines
    with pytest.raises(AssertionError) as caught:
        run(SOURCE + "f(5)")
    assert caught.traceback[-1].lineno == 7  # of the assertion, counted from 0


@pytest.mark.parametrize("name", ["sandbox", "sim", "library"])
def test_any_program_of_our_own_still_compiles(name: str) -> None:
    folder = Path(importlib.import_module(f"grs_agents.{name}").__file__ or "").parent
    files = list(folder.rglob("*.py"))
    compiled = [compile(insert_counter_calls(ast.parse(file.read_text("utf-8"))), file.name, "exec") for file in files]
    assert [code.co_filename for code in compiled] == [file.name for file in files] != []
