"""The program and the tests in the paper's appendix, as printed with their imports prepended."""

import sys
import unittest
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

LISTINGS = Path(__file__).parent / "paper"


def load(name: str) -> ModuleType:
    module = ModuleType(name)
    sys.modules[name] = module
    exec((LISTINGS / f"{name}.txt").read_text("utf-8"), module.__dict__)
    return module


@pytest.fixture
def listing() -> Iterator[ModuleType]:
    load("task_code")
    yield load("test_code")
    del sys.modules["task_code"], sys.modules["test_code"]


def test_the_listing_passes_its_own_three_tests(listing: ModuleType) -> None:
    suite = unittest.defaultTestLoader.loadTestsFromModule(listing)
    result = unittest.TestResult()
    suite.run(result)
    assert result.testsRun == 3
    assert not result.errors, result.errors[0][1]
    assert not result.failures, result.failures[0][1]
