"""Bounds of an instance: a hostile program may hand over any JSON."""

import json
import math
from typing import Any

import pytest
from pydantic import ValidationError

from grs_agents.library.library import Library
from grs_agents.sim import TaskInstance, rollout

FLAT = (0.0, 0.0, 0.0, 1.0)
RED, BOX, SHAPE = "block/red_block.urdf", "box/box-template.urdf", "kitting/object-template.urdf"


def thing(number: int, x: float = 0.5, y: float = 0.0, asset: str = RED, **more: Any) -> dict[str, Any]:
    return {"id": number, "asset": asset, "pose": ((x, y, 0.02), FLAT), **more}


def goal(number: int, x: float, y: float, **more: Any) -> dict[str, Any]:
    said: dict[str, Any] = {
        "objects": (number,),
        "matches": ((1,),),
        "targets": (((x, y, 0.02), FLAT),),
        "replace": False,
        "rotations": False,
        "metric": "pose",
        "max_reward": 1.0,
        "symmetries": (0.0,),
    }
    return said | more


def tie(parent: int, child: int, x: float = 0.0, **more: Any) -> dict[str, Any]:
    frames = {"parent_frame": ((x, 0.0, 0.0), FLAT), "child_frame": ((0.0, 0.0, 0.0), FLAT)}
    return {"kind": "point", "parent": parent, "child": child, **frames, **more}


def instance(**changed: Any) -> TaskInstance:
    said: dict[str, Any] = {
        "task": "Trial",
        "seed": 0,
        "max_steps": 3,
        "timestep": 0.004,
        "objects": (thing(1), thing(2, 0.5, 0.1)),
        "goals": (goal(1, 0.5, -0.2),),
    }
    return TaskInstance.model_validate_json(json.dumps(said | changed), strict=True)


def test_a_fair_instance_is_taken() -> None:
    assert instance(ties=(tie(1, 2, kind="fixed", parent_frame=((0.0, 0.1, 0.0), FLAT)),)).goals


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"ties": (tie(1, 1),)}, "tied to itself"),
        ({"ties": (tie(1, 2, 0.5),)}, "joins places 0.51 m apart, at most 0.05 m"),
        ({"ties": (tie(1, 3),)}, "do not have|does not have"),
        ({"goals": (goal(3, 0.5, 0.2),)}, "does not have"),
        ({"objects": (thing(1), thing(1))}, "must differ"),
        ({"objects": (thing(1, asset=BOX, fill={"DIM": ("1e5", 0.1, 0.1)}), thing(2))}, "FNAME alone takes a word"),
        ({"objects": (thing(1, asset=BOX, fill={"DIM": (3.0, 0.1, 0.1)}), thing(2))}, "less than or equal to 2"),
        ({"objects": (thing(1, x=2.5), thing(2))}, "less than or equal to 2"),
        ({"pos_eps": 0.2}, "less than or equal to 0.05"),
        ({"pos_eps": math.nan}, "finite|greater than 0|less than"),
        ({"timestep": math.nan}, "finite|greater than|less than"),
        ({"max_steps": 10_000}, "less than or equal to 200"),
        ({"warnings": ("again",) * 501}, "at most 500"),
    ],
)
def test_what_no_instance_may_say(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        instance(**changed)


def test_the_work_of_all_goals_is_bounded() -> None:
    objects = tuple(range(1, 101))
    wide = goal(1, 0.5, 0.2) | {
        "objects": objects,
        "matches": ((1,) * 100,) * 100,
        "targets": (((0.5, 0.2, 0.02), FLAT),) * 100,
        "symmetries": (0.0,) * 100,
    }
    with pytest.raises(ValidationError, match="pair objects with targets 20000 times, at most 10000"):
        instance(objects=tuple(thing(number) for number in objects), goals=(wide, wide))


@pytest.mark.parametrize(
    ("fill", "asset", "message"),
    [
        ({"DIM": (0.0, 0.0, 0.0)}, BOX, "not positive"),
        ({"DIM": (2.0, 2.0, 1e-12)}, BOX, "thinnest part 1.0e-12 m"),
        ({"DIM": (1e-300, 1e-300, 1e-300)}, BOX, "thinnest part 1.0e-300 m"),
        ({"FNAME": ("00.obj",), "SCALE": (2.0, 2.0, 2.0)}, SHAPE, "at most 2.0 m"),
        ({"FNAME": ("../../../../etc/passwd",)}, SHAPE, "'passwd' does not exist"),
        ({"FNAME": ("..",)}, SHAPE, "FNAME is '..'"),
        ({}, "../../../../../../etc/passwd", "unknown asset"),
        ({"DIM": (0.1, 0.1, 0.1)}, "../library/" + BOX, "unknown asset"),
    ],
)
def test_an_odd_filling_ends_the_episode_with_a_clear_error(fill: dict[str, Any], asset: str, message: str) -> None:
    odd = instance(objects=(thing(1), thing(2, 0.5, 0.2, asset=asset, fill=fill)))
    done = rollout(odd, Library())
    assert done.episode.outcome == "error"
    assert message in done.episode.detail
    assert done.idle_reward == 1.0


def test_a_tangle_of_many_is_refused_before_it_costs_minutes() -> None:
    done = rollout(instance(objects=tuple(thing(number) for number in range(1, 120))), Library())
    assert done.episode.outcome == "error"
    assert "contacts" in done.episode.detail


def test_a_scene_that_bursts_is_an_error() -> None:
    offsets = {number: 0.03 * (number // 2) * (-1) ** number for number in range(1, 9)}  # the first is in the middle
    row = tuple(thing(number, 0.5, 0.3 + aside) for number, aside in offsets.items())
    train = tuple(
        tie(1, number, kind="fixed", parent_frame=((0.0, offsets[number], 0.0), FLAT)) for number in range(2, 9)
    )
    done = rollout(instance(objects=row, ties=train), Library())
    assert done.episode.outcome == "error"
    assert "diverged" in done.episode.detail


def test_invisible_paint_hides_nothing_from_the_robot() -> None:
    plain = rollout(instance(), Library())
    ghost = rollout(instance(objects=(thing(1, color=(1.0, 0.0, 0.0, 0.0)), thing(2, 0.5, 0.1))), Library())
    assert ghost.final == plain.final
    assert ghost.episode.outcome == "success"
