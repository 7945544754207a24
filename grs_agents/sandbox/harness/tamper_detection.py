"""Detects changes of the verdict machinery since before the program was loaded.

Only lasting replacements are detected. A replacement that is undone before a test ends goes unseen, as does an attack
on this module itself: ``channel`` explains why that decides nothing.
"""

import builtins
import contextlib
import importlib
import sys
import unittest
from collections.abc import Callable, Iterator, Mapping
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE, RaisedIn

_UNITTEST = ("unittest", "unittest.case", "unittest.result", "unittest.suite", "unittest.util")
_STANDARD = ("json", "json.encoder", "contextlib", "traceback")
_NUMPY = ("numpy.testing", "numpy.testing._private.utils")
_OWN = (
    "grs_agents.sandbox.harness.captured_error",
    "grs_agents.sandbox.harness.channel",
    "grs_agents.sandbox.harness.assertion_count",
    "grs_agents.sandbox.harness.suite_runner",
    "grs_agents.sandbox.protocol.tracebacks",
    "grs_agents.sandbox.protocol.wire",
)
_OFTEN_PATCHED = frozenset({"print", "input", "open", "breakpoint", "exit", "quit"})
"""Built-in functions that honest tests replace and put back, and that no verdict hangs on."""
_USERS = frozenset({"setUp", "tearDown", "setUpClass", "tearDownClass", "id", "shortDescription"})
_PARTS = (FunctionType, classmethod, staticmethod, property, type)
MACHINERY = {
    name for name, part in vars(unittest.TestCase).items() if isinstance(part, _PARTS) and not name.startswith("__")
} - _USERS | {"__call__", "__getattribute__"}
"""Methods of unittest that a test class must not override."""


class Integrity:
    """The verdict machinery as it is when this is made; the assertions of ``numpy.testing`` too, if asked to import."""

    def __init__(self, with_numpy: bool) -> None:
        names = (*_UNITTEST, *_STANDARD, *_OWN, *(_NUMPY if with_numpy else ()))
        self._modules = {name: importlib.import_module(name) for name in names}
        parts = [part for name, module in self._modules.items() for part in _iterate_module_definitions(name, module)]
        parts += [
            _Definition("builtins", vars(builtins), name, value)
            for name, value in vars(builtins).items()
            if callable(value) and name not in _OFTEN_PATCHED and name != "_"
        ]
        self._parts = [(part, _code_and_defaults(part.value)) for part in parts]

    def find_replaced_definition(self) -> tuple[str, RaisedIn | None] | None:
        """The first replaced definition, and the program of the replacement; None if all is intact."""
        for part, content in self._parts:
            value = part.place.get(part.name)
            if value is not part.value or _code_and_defaults(value) != content:
                code = getattr(getattr(value, "__func__", value), "__code__", None)
                names: dict[str, RaisedIn] = {SIMULATION_FILE: "simulation", TESTS_FILE: "tests"}
                return f"{part.where}.{part.name} was replaced", names.get(getattr(code, "co_filename", ""))
        for name, module in self._modules.items():
            if sys.modules.get(name) is not module:
                return f"the module {name} was replaced", None
        case = unittest.TestCase()
        for name, arguments in _FALSE.items():
            assertion: Callable[..., object] = getattr(case, name)
            with CapturedError() as captured, contextlib.suppress(SystemExit):
                assertion(*arguments)
            if not isinstance(captured.error, AssertionError):
                return f"unittest's {name} no longer fails", None
        return None


def find_overridden_method(kind: type[unittest.TestCase]) -> str | None:
    """The first part of unittest's machinery that a test class has its own version of, as ``Class.name``."""
    async_case = getattr(sys.modules.get("unittest.async_case"), "IsolatedAsyncioTestCase", None)  # a slow import
    for parent in kind.__mro__:
        if parent is unittest.TestCase or parent is async_case:
            return None
        overridden = sorted(MACHINERY & set(vars(parent)))
        if overridden:
            return f"{parent.__name__}.{overridden[0]}"
    return None


def find_shadowed_method(test: unittest.TestCase, result: unittest.TestResult) -> str | None:
    """The first method of a test or its result that was replaced on this object alone."""
    shadowed = sorted(MACHINERY & set(vars(test)))
    shadowed += sorted(name for name in vars(result) if callable(getattr(type(result), name, None)))
    return shadowed[0] if shadowed else None


class _Definition(NamedTuple):
    """Location of a function or class."""

    where: str
    place: Mapping[str, Any]
    name: str
    value: Any


def _iterate_module_definitions(where: str, module: ModuleType) -> Iterator[_Definition]:
    """The functions and classes of a module, and the members of its own classes."""
    for name, value in vars(module).items():
        if not isinstance(value, FunctionType | type):
            continue
        yield _Definition(where, vars(module), name, value)
        if isinstance(value, type) and value.__module__ == where:
            inner = vars(value)
            yield from (
                _Definition(f"{where}.{name}", inner, member, piece)
                for member, piece in inner.items()
                if isinstance(piece, _PARTS)
            )


def _code_and_defaults(part: Any) -> tuple[Any, Any]:
    """Mutable content of a function or class that stays the same object: code, and defaults or bases."""
    rest = part.__defaults__ if isinstance(part, FunctionType) else getattr(part, "__bases__", None)
    return getattr(part, "__code__", None), rest


_FALSE: dict[str, tuple[object, ...]] = {
    "fail": (),
    "assertTrue": (False,),
    "assertFalse": (True,),
    "assertEqual": ([0], [1]),
    "assertNotEqual": (0, 0),
    "assertAlmostEqual": (0.0, 1.0),
    "assertGreater": (0, 1),
    "assertGreaterEqual": (0, 1),
    "assertLess": (1, 0),
    "assertLessEqual": (1, 0),
    "assertIn": (0, []),
    "assertIs": (0, None),
    "assertIsNone": (0,),
    "assertIsNotNone": (None,),
    "assertIsInstance": (0, str),
    "assertRaises": (ValueError, int),
}
"""Arguments with which each assertion must fail."""
