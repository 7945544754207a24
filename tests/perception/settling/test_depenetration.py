"""Things are taken apart in the way that is asked for."""

import numpy as np
import pytest

from grs_agents.perception.settling.depenetration import (
    Separation,
    deepest_overlap_depth,
    overlap_depth_by_pair,
    separate_objects,
)
from grs_agents.sim.world.compilation import World
from tests.perception.settling.photo import BLOCK, MILK, standing, world_of


def _moved(world: World, way: Separation) -> dict[int, "np.ndarray[tuple[int, ...], np.dtype[np.float64]]"]:
    """How far each thing is moved, (3,) m, by its number."""
    before = world.data.qpos.copy()
    separate_objects(world, (), way, {})
    return {number: (world.data.qpos - before)[start : start + 3] for number, start in world.addresses.items()}


def test_what_is_in_the_table_is_lifted_by_what_it_is_in_it() -> None:
    world = world_of(standing(BLOCK, 0.5, 0.0, above=-0.007), standing(BLOCK, 0.3, 0.2))
    moved = _moved(world, Separation(deep=0.003, lift=True))
    assert moved[0] == pytest.approx((0, 0, 0.007), abs=0.001)
    assert not moved[1].any()


def test_what_is_left_to_the_easing_is_not_moved() -> None:
    world = world_of(standing(MILK, 0.5, 0.0), standing(BLOCK, 0.5, 0.048))
    assert 0.005 < deepest_overlap_depth(world) < 0.01
    assert not any(move.any() for move in _moved(world, Separation(deep=0.012, lift=True)).values())


def test_the_one_that_has_to_move_least_is_moved_free() -> None:
    world = world_of(standing(MILK, 0.5, 0.0), standing(BLOCK, 0.5, 0.048))
    moved = _moved(world, Separation(deep=0.003, lift=True))
    assert sum(bool(move.any()) for move in moved.values()) == 1
    assert max(overlap_depth_by_pair(world).values(), default=0.0) < 0.003


def test_nothing_is_moved_farther_than_the_steps_of_the_way() -> None:
    world = world_of(standing(MILK, 0.5, 0.0), standing(MILK, 0.5, 0.01))
    near = _moved(world, Separation(deep=0.003, lift=True, steps=(0.002, 0.004)))
    assert not any(move.any() for move in near.values()), "none gets free by so little"
    far = _moved(world, Separation(deep=0.003, lift=True, steps=(0.07, 0.1)))
    assert max(float(np.linalg.norm(move)) for move in far.values()) >= 0.069
