"""Task and simulation authors: any scene gives a task and a program that fit each other."""

import ast
import math
import re

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from grs_agents.models.offline import program_edits
from tests.models.conftest import Json, rich_scene, scene_object, scenes
from tests.models.roles import simulation_for, task_for, unit_tests_for

TEMPLATES = {"container/container-template.urdf", "zone/zone-template.urdf"}


def assets_of(scene: Json) -> set[str]:
    return {str(thing["asset"]) for thing in scene["objects"]}


@settings(max_examples=25, deadline=None)
@given(scene=scenes(), seed=st.integers(0, 1000))
def test_any_scene_gives_a_task_a_program_and_tests_that_fit_each_other(scene: Json, seed: int) -> None:
    task = task_for(scene, seed)
    assume(task)
    assert set(task) == {"task-name", "task-description", "assets-used"}
    assert set(task["assets-used"]) <= assets_of(scene) | TEMPLATES
    code = simulation_for(task, scene, seed)
    ast.parse(code)
    assert program_edits.find_asset_names(code) == set(task["assets-used"])
    tests = unit_tests_for(task, code)
    ast.parse(tests)
    assert f"from task_code import {program_edits.find_task_class_name(code)}" in tests


def test_a_rich_scene_gives_many_families() -> None:
    verbs = {task_for(rich_scene(), seed)["task-name"].split("-")[0] for seed in range(30)}
    assert verbs >= {"pack", "sort", "place", "clear", "distribute"}
    assert len(verbs) >= 6


def test_the_program_uses_the_task_s_assets_and_the_photo_s_positions() -> None:
    scene = rich_scene()
    for seed in range(12):
        task = task_for(scene, seed)
        code = simulation_for(task, scene, seed)
        assert program_edits.find_asset_names(code) == set(task["assets-used"])
        for thing in scene["objects"]:
            if thing["asset"] in task["assets-used"]:
                x, y, _ = thing["position"]
                assert f'"{thing["asset"]}", (({x:g}, {y:g}, ' in code


def test_what_is_covered_held_or_out_of_reach_is_left_where_it_stands() -> None:
    low, high = scene_object("low_1", (0.4, 0.0), (0.05, 0.05, 0.05)), (0.41, 0.01)
    free = scene_object("free_1", (0.4, 0.2), (0.05, 0.05, 0.05))
    scene = {
        "objects": [
            low,
            scene_object("high_1", high, (0.05, 0.05, 0.05), height=0.075),
            free,
            {**scene_object("held_1", (0.4, -0.2), (0.05, 0.05, 0.05)), "floats": True},
            scene_object("far_1", (1.4, 0.0), (0.05, 0.05, 0.05), reachable=False),
        ]
    }
    for seed in range(8):
        used = set(task_for(scene, seed)["assets-used"]) & assets_of(scene)
        assert used == {"proxy/high_1.urdf", "proxy/free_1.urdf"}


@pytest.mark.parametrize(
    "doubt",
    [
        "seen too sparsely to be sure of it: 120 measured pixels, 4.1 cm2",
        "speck_1 (0.39 kg) tipped off the cup: 0.21 N m bent it, it bears 0.15 N m",
    ],
)
def test_what_cannot_be_picked_is_left_where_it_stands(doubt: str) -> None:
    scene = {
        "objects": [
            scene_object("sure_1", (0.4, 0.0), (0.05, 0.05, 0.05)),
            {**scene_object("speck_1", (0.4, 0.2), (0.05, 0.05, 0.05)), "cannot_be_picked": doubt},
        ]
    }
    for seed in range(8):
        assert set(task_for(scene, seed)["assets-used"]) & assets_of(scene) == {"proxy/sure_1.urdf"}


def test_targets_are_free_of_all_that_stands_there() -> None:
    # Of the whole table only the part beyond y = 0.1 is free.
    wall = [scene_object(f"wall_{n}", (0.5, -0.45 + 0.1 * n), (0.5, 0.1, 0.3)) for n in range(6)]
    scene = {"objects": [*wall, scene_object("cube_1", (0.4, 0.15), (0.04, 0.04, 0.04))]}
    for seed in range(8):
        code = simulation_for(task_for(scene, seed), scene)
        assert re.search(r"find_place\(env, \w+_size, \(0\.\d+, 0\.[234]\d*\)\)", code)


def test_only_the_target_that_is_drawn_first_has_a_place_to_fall_back_on() -> None:
    # What is drawn before a target may lie at the place that was free when the program was planned.
    for seed in range(12):
        code = simulation_for(task_for(rich_scene(), seed), rich_scene())
        fallbacks = re.findall(r"self\.find_place\(env, \w+_size(.*)\)", code)
        assert fallbacks[0] and not any(fallbacks[1:])
        assert "raise NoFreeSpaceError" in code


def test_two_objects_move_even_if_only_some_pairs_leave_room_for_a_target() -> None:
    big = [scene_object(f"big_{n}", (0.42, -0.3 + 0.29 * n), (0.3, 0.25, 0.1)) for n in range(3)]
    small = [scene_object(f"small_{n}", (0.66, -0.3 + 0.1 * n), (0.04, 0.04, 0.04)) for n in range(2)]
    for seed in range(8):
        used = set(task_for({"objects": [*big, *small]}, seed)["assets-used"])
        assert len([asset for asset in used if asset.startswith("proxy/")]) >= 2


def test_a_bowl_is_moved_where_no_other_second_object_has_room() -> None:
    can = scene_object("can_1", (0.42, -0.1), (0.12, 0.12, 0.1), "red", "can")
    bowl = {**scene_object("bowl_1", (0.42, 0.08), (0.1, 0.1, 0.05), "white", "bowl"), "hollow": True}
    far = scene_object("far_1", (1.2, 0.0), (0.3, 0.3, 0.1), "blue", reachable=False)
    walls = [scene_object(f"wall_{n}", (0.66, -0.35 + 0.23 * n), (0.22, 0.22, 0.3), "green") for n in range(4)]
    heavy = [{**wall, "cannot_be_picked": "it is too heavy"} for wall in walls]
    for seed in range(4):
        used = set(task_for({"objects": [can, bowl, far, *heavy]}, seed)["assets-used"])
        assert {"proxy/can_1.urdf", "proxy/bowl_1.urdf"} <= used


def test_things_called_alike_are_told_by_their_height_or_counted() -> None:
    boxes = [scene_object(f"box_{n}", (0.4, -0.3 + 0.15 * n), (0.06, 0.06, 0.03 + 0.04 * n)) for n in range(3)]
    cans = [scene_object(f"can_{n}", (0.55, -0.2 + 0.15 * n), (0.06, 0.06, 0.08), "blue", "can") for n in range(2)]
    words = " ".join(task_for({"objects": [*boxes, *cans]}, seed)["task-description"] for seed in range(30))
    assert {"lowest red box", "tallest red box"} <= set(re.findall(r"the (\w+ red box)", words))
    assert not re.search(r"the red box|the blue can\b", words)


def test_marks_that_could_take_each_others_place_stand_where_they_were_planned() -> None:
    # Of the whole table only the part beyond y = 0.3 and up to x = 0.5 is free.
    wall = [scene_object(f"wall_{n}", (0.5, -0.4 + 0.1 * n), (0.5, 0.1, 0.3), "white") for n in range(7)]
    wall.append(scene_object("wall_7", (0.65, 0.4), (0.3, 0.2, 0.3), "white"))
    cubes = [
        scene_object(f"cube_{n}", (0.3, 0.34 + 0.07 * n), (0.04, 0.04, 0.04), color)
        for n, color in enumerate(("red", "blue"))
    ]
    for seed in range(20):
        code = simulation_for(task_for({"objects": [*wall, *cubes]}, seed), {"objects": [*wall, *cubes]})
        assert len(re.findall(r"= self\.find_place\(", code)) <= 1


def test_a_single_object_is_put_on_a_zone() -> None:
    scene = {"objects": [scene_object("box_1", (0.5, 0.0), (0.1, 0.1, 0.1))]}
    task = task_for(scene)
    assert task["task-name"].startswith("place-")
    assert set(task["assets-used"]) == {"proxy/box_1.urdf", "zone/zone-template.urdf"}


def test_a_task_of_another_author_is_understood() -> None:
    scene = rich_scene()
    task = {
        "task-name": "organize-things",
        "task-description": "Pick up the red box and the blue can and place them into the container.",
        "assets-used": ["proxy/red_box_1.urdf", "proxy/blue_can_1.urdf", "container/container-template.urdf"],
    }
    code = simulation_for(task, scene)
    assert program_edits.find_asset_names(code) == set(task["assets-used"])
    assert "class OrganizeThings(Task):" in code


def test_out_of_reach_objects_are_put_elsewhere() -> None:
    scene = {"objects": [scene_object("box_1", (1.3, 0.0), (0.1, 0.1, 0.1), reachable=False)]}
    code = simulation_for(task_for(scene), scene)
    assert "1.3" not in code
    assert "find_place" in code


def test_places_are_within_the_reach_of_a_short_arm() -> None:
    seen: set[str] = set()
    for radius, reach in ((0.85, "0.83"), (0.6, "0.58")):
        scene = rich_scene() | {"workspace": {"radius": radius}}
        for seed in range(12):
            code = simulation_for(task_for(scene, seed), scene)
            for x, y in re.findall(r"find_place\(env, \w+_size, \((0\.\d+), (-?0\.\d+)\)\)", code):
                assert math.hypot(float(x), float(y)) < radius
                seen.add(reach)
            assert all(reach == limit for limit in re.findall(r"reach = (0\.\d+) - ", code))
    assert seen == {"0.83", "0.58"}
