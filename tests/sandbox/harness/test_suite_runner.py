"""How a worker loads a program; how it runs tests is seen in ``host.test_suite_run``."""

import random
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from grs_agents.sandbox.harness.suite_runner import load_program, seed_everything
from grs_agents.sandbox.protocol.tracebacks import describe_error


@pytest.fixture(autouse=True)
def _separate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    before = dict(sys.modules)
    yield
    sys.modules.clear()
    sys.modules.update(before)


def test_program_has_the_papers_name_and_its_own() -> None:
    module = load_program("answer = 42", "pack_boxes")
    assert sys.modules["task_code"] is sys.modules["pack_boxes"] is module
    assert (module.__name__, module.answer) == ("task_code", 42)
    assert Path(module.__file__ or "").read_text() == "answer = 42"


def test_no_other_module_is_replaced() -> None:
    load_program("", "random")
    assert sys.modules["random"] is random


def test_its_source_is_shown_in_tracebacks() -> None:
    with pytest.raises(ZeroDivisionError) as info:
        load_program("def f():\n    return 1 / 0\nf()")
    assert "return 1 / 0" in describe_error(info.value).text


def test_seeding_repeats_both_generators() -> None:
    def draw() -> tuple[float, float]:
        seed_everything(3)
        return random.random(), float(np.random.rand())

    assert draw() == draw()
