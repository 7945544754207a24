"""A value that a program must not give is named with its object, its unit and its bound."""

import math
import warnings
from collections.abc import Callable
from typing import Any

import pytest
from sim_scenes import Scripted, at, pose_goal, zone_goal

from grs_agents.base.errors import GrsError
from grs_agents.sim import Environment, InvalidValueError, SimulationError, Task, instantiate, near, p

BLOCK, BOX = "block/block.urdf", "box/box-template.urdf"
FLAT = (0, 0, 0, 1)


PLACE = at(0.5, 0, 0.02)


def add(env: Environment, pose: Any = PLACE, **more: Any) -> int:
    return env.add_object(BLOCK, pose, **more)


SCENES: dict[str, tuple[Callable[[Any, Environment], object], str]] = {
    "millimetres": (
        lambda task, env: add(env, ((500, -100, 20), FLAT)),
        r"add_object\('block/block.urdf'\): x = 500 m, must be at most 2 m; give metres: 500 mm are 0.5 \(and 2 more\)",
    ),
    "below": (lambda task, env: add(env, ((0.5, -30, 0), FLAT)), "y = -30 m, must be at least -2 m; give metres: -30"),
    "far": (lambda task, env: add(env, ((0.5, 0, 3), FLAT)), "z = 3 m, must be at most 2 m$"),
    "no pose": (lambda task, env: add(env, 5), r"'block/block.urdf'.*: 5 is not a pose; give .*\(x, y, z\)$"),
    "a dictionary": (lambda task, env: add(env, {"x": 1}), "'block/block.urdf'.* is not a pose; give"),
    "not a number": (lambda task, env: add(env, ((math.nan, 0, 0), FLAT)), "'block/block.urdf'.*nan.* is not a pose"),
    "three angles": (
        lambda task, env: add(env, ((0.5, 0, 0), (0, 0, 1.6))),
        "three numbers as its rotation; give a quat",
    ),
    "a colour's name": (
        lambda task, env: add(env, color="mauve"),
        "'block/block.urdf'.*: colour 'mauve' is unknown; use",
    ),
    "a colour's number": (lambda task, env: add(env, color=(math.nan, 0, 0)), "'block/block.urdf'.*nan.*in 0..1"),
    "no colour": (lambda task, env: add(env, color=5), "'block/block.urdf'.*: colour 5 is not"),
    "a new colour": (lambda task, env: env.set_color(add(env), "mauve"), "object 1 .block/block.urdf.: colour 'mauve'"),
    "a target": (
        lambda task, env: pose_goal(task, add(env), at(500, 0, 0)),
        "^goal 1, target 1: x = 500 m, must be at most 2 m; give metres: 500 mm are 0.5$",
    ),
    "a zone's size": (
        lambda task, env: zone_goal(task, [add(env)], at(0.5, 0.2, 0), (0.1, 120, 0)),
        "^goal 1, zone 1: size y = 120 m, must be at most 2 m; give metres: 120 mm are 0.12$",
    ),
    "a distance": (lambda task, env: task.add_goal(near([add(env)], add(env), 50)), "near: 50.0 m is out of range"),
    "a template's size": (
        lambda task, env: task.fill_template(BOX, {"DIM": (200, 100, 50)}),
        "DIM is .200, 100, 50.; give metres, at most 2: 200 mm are 0.2",
    ),
    "a template's colour": (
        lambda task, env: task.fill_template(BOX, {"COLOR": (255, 0, 0)}),
        "red, green and blue in 0",
    ),
    "no dictionary": (lambda task, env: task.fill_template(BOX, 5), "box-template.urdf'.: 5 is no dictionary; give"),
    "moved away": (
        lambda task, env: p.resetBasePositionAndOrientation(add(env), (math.inf, 0, 0), FLAT),
        r"p.resetBasePositionAndOrientation of object 1 \(block/block.urdf\): .*inf.* is not a pose",
    ),
    "a tie": (
        lambda task, env: p.createConstraint(
            add(env), -1, add(env), -1, p.JOINT_FIXED, (0, 0, 0), (90, 0, 0), (0, 0, 0)
        ),
        "p.createConstraint between objects 1 and 2: x = 90 m, must be at most 2 m",
    ),
    "many steps": (lambda task, env: setattr(task, "max_steps", 1000), "^max_steps = 1000, must be at most 200$"),
    "steps in words": (
        lambda task, env: setattr(task, "max_steps", "four"),
        "max_steps is 'four'; give a whole number",
    ),
    "a time step": (lambda task, env: setattr(env, "timestep", 5.0), "^timestep = 5 s, must be at most 0.01 s$"),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_bad_value_of_a_program_is_named(name: str) -> None:
    scene, told = SCENES[name]
    with pytest.raises(GrsError, match=told) as refused:
        instantiate(Scripted(scene), 0)
    assert "Input should" not in str(refused.value)


@pytest.mark.parametrize(("steps", "told"), [(0, "max_steps = 0, must be at least 1"), (201, "must be at most 200")])
def test_the_steps_of_a_program_are_checked_when_its_scene_is_set_up(steps: int, told: str) -> None:
    env = Environment(task=Scripted(lambda task, env: setattr(task, "max_steps", steps)))
    with pytest.raises(InvalidValueError, match=told):
        env.reset()


@pytest.mark.parametrize("pose", [(0.5, 0.1, 0.02), [0.5, 0.1, 0.02], ((0.5, 0.1, 0.02), None)])
def test_a_position_alone_is_a_pose_without_a_turn(pose: Any) -> None:
    instance = instantiate(Scripted(lambda task, env: add(env, pose)), 0)
    assert instance.objects[0].pose == ((0.5, 0.1, 0.02), FLAT)


def test_a_place_out_of_bounds_is_an_invalid_value() -> None:
    with pytest.raises(InvalidValueError):
        instantiate(Scripted(lambda task, env: add(env, at(3, 0, 0))), 0)


def test_a_tolerance_that_is_no_number_takes_its_bound() -> None:
    instance = instantiate(Scripted(lambda task, env: setattr(task, "pos_eps", None)), 0)
    assert instance.pos_eps == 0.05
    assert "pos_eps=None is not within 0..0.05, taken as 0.05" in instance.warnings


async def reset_awaited(self: Task, env: Environment) -> None:
    Task.reset(self, env)


def reset_yielding(self: Task, env: Environment) -> Any:
    Task.reset(self, env)
    yield


async def reset_awaited_yielding(self: Task, env: Environment) -> Any:
    Task.reset(self, env)
    yield


@pytest.mark.parametrize(
    ("reset", "told"),
    [
        (reset_awaited, "reset is asynchronous"),
        (reset_yielding, "reset is a generator"),
        (reset_awaited_yielding, "reset is asynchronous"),
    ],
)
def test_a_reset_that_does_not_run_when_it_is_called_is_told(reset: Callable[..., Any], told: str) -> None:
    task: Any = type("Unawaited", (Task,), {"reset": reset})()
    with warnings.catch_warnings(), pytest.raises(SimulationError, match=f"{told}.*write `def reset"):
        warnings.simplefilter("error")
        instantiate(task, 0)
