"""The tests there must be, read from the source alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sandbox.host.suite_discovery import MAX_SOURCE, discover_tests, parse_program

SOURCE = """
import unittest, numpy as np
from unittest import TestCase
from grs_agents.testing import SimulationTestCase

def check(value): helper(value)
def helper(value): assert value

class Mixin:
    def test_mixed(self): self.assertTrue(1)
class TestA(unittest.TestCase):
    def setUp(self): self.assertTrue(1)
    def test_one(self): self.assertEqual(1, 1)
    def test_two(self): check(1)
    def test_silent(self): print(1)
    def test_np(self): np.testing.assert_allclose(1, 1)
    def helper_test(self): pass
    async def test_later(self): self.fail()
class TestB(Mixin, TestCase): pass
class TestC(TestA):
    def test_one(self): pass
class TestD(SimulationTestCase):
    if True:
        def test_raises(self):
            with self.assertRaises(ValueError): int("x")
class TestNot:
    def test_never(self): pass
if True:
    class TestE(unittest.TestCase):
        def test_nested(self): raise AssertionError
def test_function(): assert True
"""


def test_ids_and_silence() -> None:
    found = discover_tests(parse_program(SOURCE, "test_task_code.py"))
    ids = {
        "TestA": "test_one test_two test_silent test_np test_later",
        "TestB": "test_mixed",
        "TestC": "test_one test_two test_silent test_np test_later",
        "TestD": "test_raises",
        "TestE": "test_nested",
    }
    assert found.ids == tuple(f"{name}.{method}" for name, methods in ids.items() for method in methods.split())
    assert found.without_assertion == {"TestA.test_silent", "TestC.test_silent", "TestC.test_one"}


def test_class_cycles_end() -> None:
    assert discover_tests(parse_program("class A(B): pass\nclass B(A): pass", "x.py")).ids == ()


@pytest.mark.parametrize(
    "source",
    ["def", "x = (" * 300, "\0", "-" * 100_000 + "1", "a" + ".b" * 100_000, "9" * 10_000, "#" * (MAX_SOURCE + 1)],
    ids=["syntax", "parentheses", "null", "minus", "attributes", "digits", "long"],
)
def test_unparseable_source_is_a_syntax_error(source: str) -> None:
    with pytest.raises(SyntaxError):
        parse_program(source, "task_code.py")


@given(st.text(max_size=200))
def test_any_text_parses_or_is_a_syntax_error(source: str) -> None:
    try:
        found = discover_tests(parse_program(source, "task_code.py"))
    except SyntaxError:
        return
    assert all(method.startswith("test") for _, _, method in (name.partition(".") for name in found.ids))


TWICE = """
import unittest
class TestA(unittest.TestCase):
    def test_one(self): self.fail()
    def test_one(self): self.fail()
    @staticmethod
    def test_two(): assert 1
    def test_three(self): assert 1
class TestB(TestA):
    def test_three(self): assert 1
class TestC(unittest.TestCase):
    def test_c(self): assert 1
class TestC(unittest.TestCase):
    def test_c(self): assert 1
@decorated
class TestD(unittest.TestCase):
    def test_d(self): assert 1
"""


def test_names_that_hide_each_other_and_lines() -> None:
    found = discover_tests(parse_program(TWICE, "test_task_code.py"))
    assert found.duplicates == {"TestA.test_one", "TestB.test_one", "TestC.test_c"}
    lines = {
        "TestA.test_one": 5,
        "TestA.test_three": 8,
        "TestB.test_one": 5,
        "TestB.test_three": 10,
        "TestC.test_c": 14,
    }
    assert dict(found.lines) == lines
    assert not found.chooses


@pytest.mark.parametrize(
    ("source", "chooses"),
    [
        ("def load_tests(*args): pass", True),
        ("if True:\n    load_tests = 1", True),
        ("from x import y as load_tests", True),
        ("def f():\n    load_tests = 1", False),
        ("class A:\n    def load_tests(self): pass", False),
        ("load_tests()", False),
    ],
)
def test_a_file_that_chooses_its_tests(source: str, chooses: bool) -> None:
    assert discover_tests(parse_program(source, "test_task_code.py")).chooses == chooses
