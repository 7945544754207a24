"""Variations keep a scene possible and its words true: no overlaps, all in reach, what stands together stays so."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.sim import (
    Environment,
    InstanceTask,
    SimulationError,
    TaskInstance,
    inside,
    instantiate,
    near,
    rollout,
)
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.goals.contacts import measure_overlaps
from grs_agents.sim.variation.base_scene import measure_base_scene
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from tests.sim.sim_scenes import Scripted, at, pose_goal, zone_goal

LIBRARY = Library()
RED, BLUE, GREEN = (f"block/{color}_block.urdf" for color in ("red", "blue", "green"))
WIDE = Variation(jitter=0.03, yaw=math.radians(30))


def packing(task, env) -> None:
    """A box with its zone, a can for it, a stack beside it, blocks close together; one is wanted where another is."""
    box = env.add_object("container/small_open_box.urdf", at(0.5, 0.25, 0.03), "fixed")
    can = env.add_object("HOPE/Corn.urdf", at(0.45, -0.2, 0.029))
    lower = env.add_object(RED, at(0.6, 0.0, 0.02))
    upper = env.add_object(BLUE, at(0.605, 0.005, 0.06))
    green = env.add_object(GREEN, at(0.4, 0.0, 0.02))
    env.add_object("block/gray_block.urdf", at(0.401, 0.045, 0.02))
    zone_goal(task, [can], at(0.5, 0.25, 0.03), (0.18, 0.14, 0.06), 0.4)
    pose_goal(task, green, at(0.6, -0.25, 0.02), 0.3)
    task.add_goal(near(upper, can, 0.05), step_max_reward=0.3)
    del lower, box


PACKING = instantiate(Scripted(packing), 0, LIBRARY)


def vary(instance: TaskInstance, variation: Variation, seed: int) -> TaskInstance:
    return vary_instance(instance, variation, np.random.default_rng(seed), LIBRARY)


def offset(instance: TaskInstance, one: int, other: int) -> np.ndarray:
    """Pose of an object in the frame of another, as seven numbers."""
    poses = {item.id: item.pose for item in instance.objects}
    return np.concatenate(transforms.compose_poses(transforms.invert_pose(poses[one]), poses[other]))


@examples(max_examples=8)
@given(seed=st.integers(0, 2**31), jitter=st.floats(0.005, 0.06), yaw=st.floats(0.0, math.pi))
def test_nothing_overlaps_and_all_stays_in_reach_and_together(seed: int, jitter: float, yaw: float) -> None:
    varied = vary(PACKING, Variation(jitter=jitter, yaw=yaw), seed)
    task = InstanceTask(varied)
    env = Environment(task=task, library=LIBRARY)
    env.reset(settle=False)
    assert [one for one in measure_overlaps(env) if one.depth > 0.0005] == []
    arm = get_arm()
    for before, after in zip(PACKING.objects, varied.objects, strict=True):
        (x, y, z), (x0, y0, z0) = after.pose[0], before.pose[0]
        assert arm.can_reach_point((x, y, z + 0.05))
        assert z == pytest.approx(z0)
        if after.id != 4:  # which turns with what it stands on
            assert max(abs(x - x0), abs(y - y0)) <= jitter + 1e-9
            turned = transforms.yaw_of_quaternion(after.pose[1]) - transforms.yaw_of_quaternion(before.pose[1])
            assert abs(math.remainder(turned, 2 * math.pi)) <= yaw + 1e-6
    assert offset(varied, 3, 4) == pytest.approx(offset(PACKING, 3, 4), abs=1e-6)
    box, zone = varied.objects[0].pose, varied.goals[0].zones[0].pose
    assert np.concatenate(zone) == pytest.approx(np.concatenate(box), abs=1e-6)
    assert varied.goals[1].targets == PACKING.goals[1].targets, "a place that nothing marks stays"


def test_a_variation_is_drawn_by_its_seed_and_none_is_the_base_itself() -> None:
    assert vary(PACKING, WIDE, 5) == vary(PACKING, WIDE, 5) != vary(PACKING, WIDE, 6)
    assert vary(PACKING, Variation(), 5) == PACKING


def test_the_expert_solves_a_variation_of_everything() -> None:
    everything = Variation(jitter=0.03, yaw=0.5, mass=0.2, friction=0.2, light=True, texture=True, distractors=2)
    varied = vary(PACKING, everything, 3)
    assert len(varied.objects) == len(PACKING.objects) + 2
    assert [item.role for item in varied.objects[-2:]] == ["bystander"] * 2
    assert {item.asset for item in varied.objects[-2:]}.isdisjoint(item.asset for item in PACKING.objects)
    assert varied.light != PACKING.light
    assert varied.table != PACKING.table
    done = rollout(varied, LIBRARY)
    assert (done.episode.outcome, done.strict_score) == ("success", 1.0), done.episode


def test_masses_and_frictions_differ_by_no_more_than_their_shares() -> None:
    varied = vary(PACKING, Variation(mass=0.2, friction=0.1), 1)
    block, box = varied.objects[2], varied.objects[0]
    model = LIBRARY.load_object_model(RED)
    assert block.mass == pytest.approx(model.mass, rel=0.2)
    assert block.friction == pytest.approx(model.friction, rel=0.1)
    assert block.mass != model.mass
    assert (box.mass, box.friction) == (None, None), "what is fixed has no use for them"
    assert [item.pose for item in varied.objects] == [item.pose for item in PACKING.objects]


def test_two_that_change_places_are_wanted_where_the_other_one_stands() -> None:
    def exchange(task, env) -> None:
        places = (at(0.45, -0.2, 0.02), at(0.5, 0.2, 0.02))
        blocks = [env.add_object(name, place) for name, place in zip((RED, BLUE), places, strict=True)]
        for block, place in zip(blocks, reversed(places), strict=True):
            pose_goal(task, block, place, 0.5)

    varied = vary(instantiate(Scripted(exchange), 0, LIBRARY), WIDE, 2)
    for goal, other in zip(varied.goals, reversed(varied.objects), strict=True):
        assert goal.targets[0][0] == pytest.approx(other.pose[0])


def test_what_words_tell_a_side_of_keeps_its_yaw_and_takes_the_place_with_it() -> None:
    def beside(task, env) -> None:
        env.add_object("HOPE/Milk.urdf", at(0.5, 0.0, 0.095))
        pose_goal(task, env.add_object(RED, at(0.4, -0.25, 0.02)), at(0.5, 0.1, 0.02))
        task.lang_goals = ["put the red block left of the milk carton"]

    base = instantiate(Scripted(beside), 0, LIBRARY)
    varied = vary(base, WIDE, 0)
    milk, target = varied.objects[0].pose, varied.goals[0].targets[0][0]
    assert milk[1] == base.objects[0].pose[1]
    assert np.subtract(target, milk[0]) == pytest.approx((0.0, 0.1, -0.075))


def test_tied_objects_move_as_one() -> None:
    def rope(task, env) -> None:
        task.ties = [env.add_object(RED, at(0.4 + 0.041 * index, -0.2, 0.02)) for index in range(3)]
        pose_goal(task, env.add_object(GREEN, at(0.5, 0.1, 0.02)), at(0.5, 0.3, 0.02))

    base = instantiate(Scripted(rope), 0, LIBRARY)
    upright = (0.0, 0.0, 0.0, 1.0)
    ties = tuple(
        {
            "kind": "fixed",
            "parent": number,
            "child": number + 1,
            "parent_frame": ((0.0205, 0.0, 0.0), upright),
            "child_frame": ((-0.0205, 0.0, 0.0), upright),
        }
        for number in (1, 2)
    )
    tied = TaskInstance.model_validate({**base.model_dump(), "ties": ties})
    varied = vary(tied, WIDE, 1)
    assert offset(varied, 1, 3) == pytest.approx(offset(base, 1, 3), abs=1e-6)
    assert varied.objects[0].pose != base.objects[0].pose


def test_what_stands_on_a_mark_stays_on_it_and_no_other_comes_there() -> None:
    def clearing(task, env) -> None:
        mark = task.fill_template("zone/zone-template.urdf", {"DIM": (0.12, 0.12, 0.002), "COLOR": (1, 0, 0, 1)})
        env.add_object(mark, at(0.45, 0.0, 0.001), "fixed")
        block = env.add_object(RED, at(0.45, 0.0, 0.02))
        env.add_object(BLUE, at(0.45, 0.09, 0.02))
        zone_goal(task, [block], at(0.5, -0.3, 0.02), (0.15, 0.15, 0.05))

    base = instantiate(Scripted(clearing), 0, LIBRARY)
    for seed in range(5):
        varied = vary(base, WIDE, seed)
        mark, block, other = (np.array(item.pose[0][:2]) for item in varied.objects)
        turned = -transforms.yaw_of_quaternion(varied.objects[0].pose[1])
        turn = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
        assert np.abs(turn @ (block - mark)).max() <= 0.06
        assert np.abs(turn @ (other - mark)).max() >= 0.06 + 0.02 - 1e-6


def test_a_scene_that_cannot_begin_unmet_is_refused() -> None:
    def met(task, env) -> None:
        box = env.add_object("container/open_box.urdf", at(0.5, 0.0, 0.045), "fixed")
        task.add_goal(inside(env.add_object(RED, at(0.5, 0.0, 0.03)), box))

    with pytest.raises(SimulationError, match="met before anything is done"):
        vary(instantiate(Scripted(met), 0, LIBRARY), WIDE, 0)


def test_too_many_distractors_are_refused() -> None:
    with pytest.raises(SimulationError, match="no free place"):
        vary(PACKING, Variation(distractors=50), 0)


def test_groups_are_objects_in_contact() -> None:
    groups = measure_base_scene(PACKING, LIBRARY).groups
    assert sorted(sorted(group.objects) for group in groups) == [[1], [2], [3, 4], [5], [6]]
    assert next(group for group in groups if 1 in group.objects).zones == {(0, 0)}
