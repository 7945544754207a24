"""The fixers: repairs by the evidence, in programs of their own making and in others'."""

import ast

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.router import parse_report_evidence
from tests.models.conftest import Json, rich_scene, scenes
from tests.models.roles import fixed_code, fixed_tests, simulation_for, task_for, unit_tests_for

_OUTCOMES = """
stopped partial step_limit unreachable dropped toppled target_occupied target_too_small no_free_space
nothing_to_do error
"""
OUTCOMES = _OUTCOMES.split()


def report(outcome: str, objects: list[str], steps: str = "9/9") -> str:
    return (
        "== tests\nfailed: 0 of 1 tests passed\nTestX.test_a: failed: assertion failed in TestX.test_a, line 3: x\n\n"
        f"== oracle episode (TestX.test_a)\noutcome: {outcome}\npublished: 0.50  strict: 0.50  steps: {steps}\n"
        f"detail: told so\nconcerns: {', '.join(objects)}"
    )


def error(kind: str, message: str, where: str = "simulation") -> str:
    return f"== tests\nerror: 0 of 0 tests passed\nraised in: {where}\n  {kind}: {message}"


@pytest.fixture
def made() -> tuple[Json, Json, str]:
    """A scene, a task for it that moves four objects onto one zone, and its program."""
    scene = rich_scene()
    task = {
        "task-name": "place-things-on-green-zone",
        "task-description": "Put the things on the green zone.",
        "assets-used": [thing["asset"] for thing in scene["objects"][:4]] + ["zone/zone-template.urdf"],
    }
    return scene, task, simulation_for(task, scene)


@settings(max_examples=20, deadline=None)
@given(scene=scenes(), outcome=st.sampled_from(OUTCOMES), seed=st.integers(0, 50))
def test_every_outcome_gives_another_program_that_compiles(scene: Json, outcome: str, seed: int) -> None:
    task = task_for(scene, seed)
    assume(task)
    code = simulation_for(task, scene, seed)
    concerned = [asset for asset in task["assets-used"] if "template" not in asset][:1]
    fixed = fixed_code(task, scene, code, report(outcome, concerned), seed)
    ast.parse(fixed)
    assert program_edits.find_asset_names(fixed) <= set(task["assets-used"])
    assert program_edits.find_task_class_name(fixed) == program_edits.find_task_class_name(code)


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_a_rich_program_always_changes(made: tuple[Json, Json, str], outcome: str) -> None:
    scene, task, code = made
    for _ in range(4):
        fixed = fixed_code(task, scene, code, report(outcome, [task["assets-used"][0]]))
        assert fixed != code
        code = fixed


def test_places_are_no_longer_drawn_where_drawing_is_in_vain(made: tuple[Json, Json, str]) -> None:
    scene, task, code = made
    tried = [code]
    for _ in range(4):
        tried.append(fixed_code(task, scene, tried[-1], error("NoFreeSpaceError", "no free place of 0.20 x 0.10 m")))
    assert "find_place" in code and any("find_place" not in fixed for fixed in tried)


def test_what_the_photo_shows_in_reach_stays_there(made: tuple[Json, Json, str]) -> None:
    scene, task, code = made
    for outcome in ("unreachable", "toppled", "hindered"):
        code = fixed_code(task, scene, code, report(outcome, [task["assets-used"][0]]))
        for thing in scene["objects"][:4]:
            x, y, _ = thing["position"]
            assert f'"{thing["asset"]}", (({x:g}, {y:g}, ' in code


def test_a_program_gets_the_name_that_its_tests_import(made: tuple[Json, Json, str]) -> None:
    scene, task, code = made
    wrong = program_edits.replace_identifier(code, program_edits.find_task_class_name(code), "Other")
    assert wrong is not None
    words = error("ImportError", "cannot import name 'PlaceThings' from 'task_code'", "tests")
    assert fixed_code(task, scene, wrong, words, tests=unit_tests_for(task, code)) == code


def test_a_program_that_is_not_python_is_written_anew(made: tuple[Json, Json, str]) -> None:
    scene, task, _ = made
    fixed = fixed_code(task, scene, "class Mine(Task)\n  x = (", error("SyntaxError", "expected ':'"))
    ast.parse(fixed)
    assert "class Mine(Task):" in fixed
    assert len(program_edits.find_asset_names(fixed)) == 5


def test_tests_of_another_class_are_written_anew(made: tuple[Json, Json, str]) -> None:
    _, task, code = made
    wrong = "from task_code import Other\n"
    message = "cannot import name 'Other' from 'task_code'"
    fixed = fixed_tests(task, code, wrong, error("ImportError", message, "tests"))
    assert f"from task_code import {program_edits.find_task_class_name(code)}" in fixed


def test_tests_that_keep_failing_are_not_weakened(made: tuple[Json, Json, str]) -> None:
    _, task, code = made
    tests = unit_tests_for(task, code)
    assert fixed_tests(task, code, tests, report("success", [])) == tests


@given(st.text())
def test_any_text_can_be_read_as_a_report(text: str) -> None:
    assert parse_report_evidence(text).text == text
