"""The machinery of verdicts is watched, and what honest programs do to it is let pass."""

import builtins
import difflib
import json
import unittest

import numpy as np
import pytest

from grs_agents.sandbox.harness import channel, suite_runner
from grs_agents.sandbox.harness.tamper_detection import Integrity, find_overridden_method, find_shadowed_method


def nothing(*_: object) -> None:
    """In the place of an assertion."""


PATCHES: dict[str, tuple[object, str]] = {
    "a method of a test": (unittest.TestCase, "assertEqual"),
    "what runs a test": (unittest.TestCase, "run"),
    "the verdict": (unittest.TestResult, "addFailure"),
    "our verdict": (suite_runner.Result, "addFailure"),
    "our channel": (channel, "report_progress"),
    "a suite": (unittest.TestSuite, "run"),
    "numpy": (np.testing, "assert_allclose"),
    "json": (json, "dumps"),
    "a built-in function": (builtins, "any"),
}


@pytest.mark.parametrize("name", PATCHES)
def test_a_replacement_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    integrity = Integrity(with_numpy=True)
    owner, attribute = PATCHES[name]
    assert integrity.find_replaced_definition() is None
    with monkeypatch.context() as patch:
        patch.setattr(owner, attribute, nothing)
        broken = integrity.find_replaced_definition()
    assert broken is not None and broken[0].endswith(f"{attribute} was replaced")
    assert integrity.find_replaced_definition() is None


@pytest.mark.parametrize(("attribute", "value"), [("__code__", nothing.__code__), ("__defaults__", (9.0, 9.0, True))])
def test_an_exchange_within_a_function_is_seen(attribute: str, value: object, monkeypatch: pytest.MonkeyPatch) -> None:
    integrity = Integrity(with_numpy=True)
    with monkeypatch.context() as patch:
        patch.setattr(np.testing.assert_allclose, attribute, value)
        broken = integrity.find_replaced_definition()
    assert broken is not None and broken[0].endswith("was replaced")


def test_the_program_that_replaced_something_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    integrity = Integrity(with_numpy=False)
    scope: dict[str, object] = {}
    exec(compile("def replacement(*_): pass", "task_code.py", "exec"), scope)
    with monkeypatch.context() as patch:
        patch.setattr(unittest.TestCase, "assertEqual", scope["replacement"])
        assert integrity.find_replaced_definition() == ("unittest.case.TestCase.assertEqual was replaced", "simulation")


def test_what_identity_does_not_show_the_probes_do(monkeypatch: pytest.MonkeyPatch) -> None:
    integrity = Integrity(with_numpy=False)
    with monkeypatch.context() as patch:
        patch.delattr(difflib, "ndiff")
        assert integrity.find_replaced_definition() == ("unittest's assertEqual no longer fails", None)


def test_honest_customs_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    integrity = Integrity(with_numpy=True)
    monkeypatch.setattr(unittest.TestCase, "maxDiff", None)
    monkeypatch.setattr(builtins, "print", nothing)
    monkeypatch.setattr(unittest.TestCase, "assertPlaced", nothing, raising=False)

    class Honest(unittest.TestCase):
        def setUp(self) -> None: ...

        def assertPlaced(self) -> None: ...

        def id(self) -> str:
            return "x"

    test = Honest("assertPlaced")
    test.addTypeEqualityFunc(list, nothing)
    assert (
        integrity.find_replaced_definition(),
        find_overridden_method(Honest),
        find_shadowed_method(test, unittest.TestResult()),
    ) == (None, None, None)
