"""Mistakes: each is made in the offline model's own programs, and mended from the prompt alone."""

import ast
import random
from functools import cache

import pytest

from grs_agents.base.errors import UnknownNameError
from grs_agents.models.offline.chat import OfflineChatModel, make_offline_model
from grs_agents.models.offline.mistakes import MISTAKES, Mistake
from tests.models.conftest import render, rich_scene
from tests.models.roles import API, as_text, fixed_code, fixed_tests, simulation_for, task_for, unit_tests_for


@cache
def programs(seed: int) -> tuple[dict[str, object], dict[str, str]]:
    """A task, and the two programs of it."""
    task = task_for(rich_scene(), seed)
    code = simulation_for(task, rich_scene(), seed)
    return task, {"simulation": code, "tests": unit_tests_for(task, code)}


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: f"{mistake.program}-{mistake.name}")
def test_each_mistake_changes_some_program_and_is_mended(mistake: Mistake) -> None:
    built = 0
    for seed in range(6):
        task, right = programs(seed)
        wrong = mistake.apply(right[mistake.program], random.Random(seed))
        assert wrong == mistake.apply(right[mistake.program], random.Random(seed))
        if wrong is None:
            continue
        built += 1
        assert wrong != right[mistake.program]
        if mistake.name != "syntax":
            ast.parse(wrong)
        simulation, tests = right["simulation"], right["tests"]
        if mistake.program == "simulation":
            assert fixed_code(task, rich_scene(), wrong, "", tests=tests) == simulation
        else:
            assert fixed_tests(task, simulation, wrong, "") == tests
    assert built


@pytest.mark.parametrize("text", ["", "x = 1", "class A(Task", "moves = [(1,), (2,)]", "def f():\n    return total, 1"])
def test_no_text_is_too_odd_for_a_mistake(text: str) -> None:
    for mistake in MISTAKES:
        assert mistake.apply(text, random.Random(0)) != text


def test_mistakes_are_as_frequent_as_the_name_says() -> None:
    scene = rich_scene()
    counts = dict.fromkeys(("offline", "offline:faulty", "offline:faulty:0.1", "offline:faulty:1"), 0)
    for seed in range(30):
        task = task_for(scene, seed)
        values = {"task": as_text(task), "scene": as_text(scene), "api": API, "examples": ""}
        prompt = render("simulation", values)
        right = OfflineChatModel(seed=seed).invoke(prompt).text
        for name in counts:
            words = make_offline_model(name, seed).invoke(prompt).text
            assert seed > 4 or words == make_offline_model(name, seed).invoke(prompt).text
            counts[name] += words != right
        wanting = {"tests": "", "test_results": "", "history": "", "explanation": ""}  # fixes are no better
        mend = render("fix_code", {**values, **wanting, "code": "import nothing"})
        if seed < 10:
            mended = OfflineChatModel().invoke(mend).text
            assert make_offline_model("offline:faulty:1", seed).invoke(mend).text != mended
    assert counts["offline"] == 0 and counts["offline:faulty:1"] == 30
    assert 0 < counts["offline:faulty:0.1"] < 9 <= counts["offline:faulty"] < 25


@pytest.mark.parametrize(
    "name", ["offline:", "offline:odd", "offline:faulty:", "offline:faulty:2", "offline:faulty:-1"]
)
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(UnknownNameError, match="offline:faulty:P"):
        make_offline_model(name, 0)
