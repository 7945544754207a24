from typing import Any, cast

import numpy as np
import pytest
from sim_scenes import Scripted, at, run

from grs_agents.sim import (
    Environment,
    SimulationError,
    TaskInstance,
    aligned,
    in_zone,
    inside,
    instantiate,
    near,
    on,
    rollout,
    stacked,
    upright,
    utils,
)

BLOCKS = tuple(f"block/{color}_block.urdf" for color in ("red", "blue", "green", "yellow"))
ON_SIDE = utils.eulerXYZ_to_quatXYZW((np.pi / 2, 0, 0))


def blocks(env, count: int, x: float = 0.38) -> list[int]:
    return [env.add_object(BLOCKS[i], at(x, -0.3 + 0.12 * i, 0.02)) for i in range(count)]


def bowl(task, env) -> None:
    container = env.add_object("bowl/bowl.urdf", at(0.55, 0.2, 0.03))
    task.add_goal(inside(blocks(env, 2), container), language_goal="put the blocks in the bowl")


def box(task, env) -> None:
    container = env.add_object("container/small_open_box.urdf", at(0.55, 0.2, 0.03), "fixed")
    task.add_goal(inside(blocks(env, 4), container))


def mug(task, env) -> None:
    container = env.add_object("mug/mug.urdf", at(0.55, 0.2, 0.0475), "fixed")
    ball = env.add_object(
        task.fill_template("cylinder/cylinder-template.urdf", {"DIM": (0.03, 0.03)}), at(0.4, 0, 0.015)
    )
    task.add_goal(inside(ball, container))


def plate(task, env) -> None:
    support = env.add_object("plate/plate.urdf", at(0.5, 0.25, 0.009), "fixed")
    task.add_goal(on(blocks(env, 3), support))


def lid(task, env) -> None:
    """Wider than what carries it."""
    support = env.add_object(BLOCKS[0], at(0.5, 0.25, 0.02), "fixed")
    slab = env.add_object(task.fill_template("box/box-template.urdf", {"DIM": (0.1, 0.1, 0.02)}), at(0.45, -0.2, 0.01))
    task.add_goal(on(slab, support))


def tower(task, env) -> None:
    task.add_goal(stacked(blocks(env, 4)))


def turned_over_tower(task, env) -> None:
    """The bottom lies under what is to lie on it."""
    low, high = (env.add_object(BLOCKS[i], at(0.5, 0.1, 0.02 + 0.04 * i)) for i in (0, 1))
    task.add_goal(stacked([high, low]))


def beside(task, env) -> None:
    other = env.add_object("HOPE/Milk.urdf", at(0.5, 0.1, 0.095))
    task.add_goal(near(blocks(env, 2), other, distance=0.04))


def row(task, env) -> None:
    task.add_goal(aligned([*blocks(env, 2), env.add_object(BLOCKS[2], at(0.6, 0.3, 0.02))]))


def spaced(task, env) -> None:
    task.add_goal(aligned([*blocks(env, 2), env.add_object(BLOCKS[2], at(0.6, 0.3, 0.02))], spacing=0.1))


def marked(task, env) -> None:
    zone = env.add_object("zone/zone.urdf", at(0.5, 0.3, 0.001), "fixed")
    task.add_goal(in_zone(blocks(env, 3), zone))


SCENES = (bowl, box, mug, plate, lid, tower, turned_over_tower, beside, row, spaced, marked)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_the_oracle_meets_typed_goals_by_their_own_definition(scene) -> None:
    instance = instantiate(Scripted(scene), 0)
    assert TaskInstance.model_validate_json(instance.model_dump_json(), strict=True) == instance
    done = rollout(instance)
    assert done.episode.outcome == "success", done.episode.detail
    assert (done.reward, done.strict_score, done.idle_reward) == (1.0, 1.0, 0.0), done.episode.shortfalls


def score(scene, **moves):
    """The episode after objects were set down elsewhere: ``_1=pose`` moves object 1."""
    env = Environment(task=Scripted(scene))
    env.reset()
    for name, pose in moves.items():
        env.set_object_pose(int(name[1:]), pose)
    env.step_simulation(150)
    env.step(None)
    return env.current_episode


def box_on_its_side(task, env) -> None:
    container = env.add_object("container/small_open_box.urdf", at(0.55, 0.2, 0.03), "fixed")
    task.add_goal(inside(env.add_object("HOPE/Milk.urdf", at(0.4, -0.2, 0.095)), container))


@pytest.mark.parametrize(
    ("scene", "moves", "clause"),
    [
        (plate, {"_2": at(0.7, 0.2, 0.02)}, "does not rest on plate"),
        (lid, {"_2": at(0.57, 0.25, 0.05)}, "does not rest on"),
        (box_on_its_side, {"_2": ((0.55, 0.2, 0.06), ON_SIDE)}, "upright"),
        (box, {"_2": at(0.55, 0.2, 0.09)}, ""),
        (beside, {"_2": at(0.5, 0.1, 0.22)}, "lies on"),
        (beside, {"_2": at(0.5, 0.3, 0.02)}, "at most 0.040 m"),
        (marked, {"_2": at(0.55, 0.3, 0.02)}, "75% over zone"),
        (row, {}, "beside the line"),
        (tower, {"_2": at(0.38, -0.3, 0.0605)}, "green_block.urdf #3 does not rest on block/blue"),
    ],
)
def test_what_falls_short_is_said_in_one_clause(scene, moves, clause) -> None:
    episode = score(scene, **moves)
    assert episode.strict == episode.reward < 1
    assert any(clause in shortfall for shortfall in episode.shortfalls), episode.shortfalls


def test_a_stack_of_which_one_is_placed_counts_the_two_that_touch() -> None:
    assert score(tower, _2=at(0.38, -0.3, 0.0605)).strict == 0.5


def test_a_typed_goal_that_is_undone_later_keeps_its_published_reward_alone() -> None:
    env = Environment(task=Scripted(lid))
    env.reset()
    env.set_object_pose(2, at(0.5, 0.25, 0.05))
    env.step_simulation(100)
    env.step(None)
    env.set_object_pose(2, at(0.4, -0.2, 0.01))
    env.step(None)
    assert (env.current_episode.reward, env.current_episode.strict) == (1.0, 0.0)


def lying(task, env) -> None:
    task.add_goal(upright(env.add_object("HOPE/Milk.urdf", ((0.5, 0.1, 0.04), ON_SIDE))))


def test_what_lies_on_its_side_cannot_be_righted_and_that_is_said() -> None:
    episode, _ = run(lying)
    assert (episode.outcome, episode.strict) == ("toppled", 0.0)
    assert "90 deg" in episode.detail
    assert "tilted by 90 degrees" in episode.shortfalls[0]


def test_what_stands_already_is_upright() -> None:
    assert score(lying, _1=at(0.5, 0.1, 0.0955)).strict == 1.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: inside([1, 1], 2), ["twice", "[1, 1, 2]"]),
        (lambda: near(1, 2, distance=3), ["3.0 m", "0..1"]),
        (lambda: aligned([1, 2]), ["2 objects", "at least 3"]),
        (lambda: stacked([1]), ["1 objects", "at least 2"]),
        (lambda: on(cast(Any, [None]), 2), ["None", "env.add_object"]),
        (lambda: inside([], 2), ["0 objects"]),
    ],
)
def test_a_relation_that_cannot_be_is_refused_with_the_remedy(make, words) -> None:
    with pytest.raises(SimulationError) as caught:
        make()
    assert all(word in str(caught.value) for word in words), caught.value


def test_an_instance_with_a_relation_out_of_range_is_refused() -> None:
    data = instantiate(Scripted(beside), 0).model_dump()
    for change in ({"distance": 2.0}, {"reference": 77}, {"reference": None}, {"kind": "under"}):
        goal = data["goals"][0] | {"relation": data["goals"][0]["relation"] | change}
        with pytest.raises(ValueError, match=r"distance|77|reference|kind"):
            TaskInstance.model_validate(data | {"goals": [goal]})
