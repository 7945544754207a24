"""Things are pushed apart without gravity, and rest under it."""

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from grs_agents.perception.settling.depenetration import deepest_overlap_depth
from grs_agents.perception.settling.settling import push_overlaps_apart, simulate_until_rest
from tests.perception.settling.photo import BLOCK, standing, world_of


def test_the_robot_is_out_of_the_way() -> None:
    world = world_of(standing(BLOCK, 0.0, 0.0))
    assert deepest_overlap_depth(world) < 0.001, "the block stands in the robot's foot"


def test_what_overlaps_is_eased_apart_and_left_without_speed_and_as_the_world_was() -> None:
    world = world_of(standing(BLOCK, 0.5, 0.0), standing(BLOCK, 0.5, 0.037))
    gravity, dimensions = np.array(world.model.opt.gravity), np.array(world.model.geom_condim)
    assert deepest_overlap_depth(world) > 0.002
    push_overlaps_apart(world)
    mujoco.mj_forward(world.model, world.data)
    assert deepest_overlap_depth(world) < 0.001 and not world.data.qvel.any()
    assert (world.model.opt.gravity == gravity).all() and (world.model.geom_condim == dimensions).all()


def test_what_falls_comes_to_rest() -> None:
    world = world_of(standing(BLOCK, 0.5, 0.0, above=0.05))
    start = world.addresses[0]
    before = float(world.data.qpos[start + 2])
    assert simulate_until_rest(world)
    assert abs(before - float(world.data.qpos[start + 2]) - 0.05) < 0.002
