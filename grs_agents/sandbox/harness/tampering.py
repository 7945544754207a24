"""Whether the machinery that gives the verdicts is still the one that was there before the program was loaded.

It finds what is replaced and stays replaced. What is put back before a test ends goes unseen, as does whatever is aimed
at this module itself: see ``channel`` for why that decides nothing.
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

_MODULES = (
    "unittest", "unittest.case", "unittest.result", "unittest.suite", "unittest.util", "json", "json.encoder",
    "contextlib", "traceback",
)  # fmt: skip
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
"""What a test class must leave as unittest has it."""


class Integrity:
    """The verdict machinery as it is when this is made.

    Args:
        with_numpy: the assertions of ``numpy.testing`` too, which takes its import.
    """

    def __init__(self, with_numpy: bool) -> None:
        names = (*_MODULES, *_OWN, *(_NUMPY if with_numpy else ()))
        self._with_numpy = with_numpy
        self._modules = {name: importlib.import_module(name) for name in names}
        found = [part for name, module in self._modules.items() for part in _parts_of(name, module)]
        self._parts = [(part, *_inside(part.value)) for part in [*found, *_built_in()]]

    def broken(self) -> tuple[str, RaisedIn | None] | None:
        """What is no longer as it was, and which program the replacement comes from; None if all is well."""
        for part, code, rest in self._parts:
            value = part.place.get(part.name)
            if value is not part.value or getattr(value, "__code__", None) is not code or _rest(value) != rest:
                return f"{part.where}.{part.name} was replaced", _origin(value)
        for name, module in self._modules.items():
            if sys.modules.get(name) is not module:
                return f"the module {name} was replaced", None
        toothless = next(_toothless(self._with_numpy), None)
        return None if toothless is None else (f"{toothless} no longer fails", None)


def overridden(kind: type[unittest.TestCase]) -> str | None:
    """The first part of unittest's machinery that a test class has its own version of, as ``Class.name``."""
    async_case = _async_case()
    for one in kind.__mro__:
        if one is unittest.TestCase or one is async_case:
            return None
        own = sorted(MACHINERY & set(vars(one)))
        if own:
            return f"{one.__name__}.{own[0]}"
    return None


def _async_case() -> Any:
    """unittest's other base class, if anybody uses it: its import is slow."""
    return getattr(sys.modules.get("unittest.async_case"), "IsolatedAsyncioTestCase", None)


def shadowed(test: unittest.TestCase, result: unittest.TestResult) -> str | None:
    """The first method of a test or its result that was replaced on this one object."""
    own = sorted(MACHINERY & set(vars(test)))
    own += sorted(name for name in vars(result) if callable(getattr(type(result), name, None)))
    return own[0] if own else None


class _Place(NamedTuple):
    """Where a function or class is kept."""

    where: str
    place: Mapping[str, Any]
    name: str
    value: Any


def _parts_of(where: str, module: ModuleType) -> Iterator[_Place]:
    """The functions and classes of a module, and what its own classes are made of."""
    for name, value in vars(module).items():
        if not isinstance(value, FunctionType | type):
            continue
        yield _Place(where, vars(module), name, value)
        if isinstance(value, type) and value.__module__ == where:
            inner = vars(value)
            yield from (
                _Place(f"{where}.{name}", inner, own, piece)
                for own, piece in inner.items()
                if isinstance(piece, _PARTS)
            )


def _built_in() -> Iterator[_Place]:
    for name, value in vars(builtins).items():
        if callable(value) and name not in _OFTEN_PATCHED and name != "_":
            yield _Place("builtins", vars(builtins), name, value)


def _inside(part: Any) -> tuple[Any, Any]:
    """What may be exchanged within a function or class that stays the same object."""
    return getattr(part, "__code__", None), _rest(part)


def _rest(part: Any) -> Any:
    if isinstance(part, FunctionType):
        return part.__defaults__
    return part.__bases__ if isinstance(part, type) else None


def _origin(part: Any) -> RaisedIn | None:
    code = getattr(getattr(part, "__func__", part), "__code__", None)
    names: dict[str, RaisedIn] = {SIMULATION_FILE: "simulation", TESTS_FILE: "tests"}
    return names.get(getattr(code, "co_filename", ""))


class _Probe(unittest.TestCase):
    """A test that must fail."""

    def runTest(self) -> None:
        self.assertEqual(0, 1)


def _raises_nothing(probe: unittest.TestCase) -> None:
    with probe.assertRaises(ValueError):
        pass


_FALSE: dict[str, Callable[[unittest.TestCase], object]] = {
    "fail": lambda probe: probe.fail(),
    "assertTrue": lambda probe: probe.assertTrue(False),
    "assertFalse": lambda probe: probe.assertFalse(True),
    "assertEqual": lambda probe: probe.assertEqual([0], [1]),
    "assertNotEqual": lambda probe: probe.assertNotEqual(0, 0),
    "assertAlmostEqual": lambda probe: probe.assertAlmostEqual(0.0, 1.0),
    "assertGreater": lambda probe: probe.assertGreater(0, 1),
    "assertGreaterEqual": lambda probe: probe.assertGreaterEqual(0, 1),
    "assertLess": lambda probe: probe.assertLess(1, 0),
    "assertLessEqual": lambda probe: probe.assertLessEqual(1, 0),
    "assertIn": lambda probe: probe.assertIn(0, []),
    "assertIs": lambda probe: probe.assertIs(0, None),
    "assertIsNone": lambda probe: probe.assertIsNone(0),
    "assertIsNotNone": lambda probe: probe.assertIsNotNone(None),
    "assertIsInstance": lambda probe: probe.assertIsInstance(0, str),
    "assertRaises": _raises_nothing,
}


def _toothless(with_numpy: bool) -> Iterator[str]:
    """Assertions that let pass what is false."""
    result = unittest.TestResult()
    unittest.TestSuite([_Probe()]).run(result)
    if result.wasSuccessful() or len(result.failures) != 1:
        yield "a false assertion in a test"
    probe = _Probe()
    for name, assertion in _FALSE.items():
        if not _fails(assertion, probe):
            yield f"unittest's {name}"
    if with_numpy:
        testing = sys.modules["numpy.testing"]
        for name in ("assert_allclose", "assert_equal", "assert_array_equal", "assert_almost_equal"):
            if not _fails(lambda _, name=name: getattr(testing, name)(0.0, 1.0), probe):
                yield f"numpy.testing's {name}"


def _fails(assertion: Callable[[unittest.TestCase], object], probe: unittest.TestCase) -> bool:
    with CapturedError() as caught, contextlib.suppress(SystemExit):
        assertion(probe)
    return isinstance(caught.error, AssertionError)
