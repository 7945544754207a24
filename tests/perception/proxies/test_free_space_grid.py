"""How high a candidate may be over each part of its box."""

import numpy as np
import pytest

from grs_agents.perception import Surroundings, UprightBox
from grs_agents.perception.proxies import CELL, MOST, free_space_map, is_box_crowded
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing

BOTH = UprightBox(center=(0.5, 0.03, 0.096), size=(0.08, 0.16, 0.192), yaw=0.0)
"""Around a carton at y = 0 and a block at y = 0.09."""


def test_two_things_in_one_box_are_as_high_as_each_is() -> None:
    frame, table, mask = photo_of([standing(MILK, 0.5, 0.0), standing(BLOCK, 0.5, 0.09)], LIBRARY)
    heights = free_space_map(frame, table, mask, BOTH).heights
    assert heights.shape == (10, min(MOST, round(0.16 / CELL)))
    y = (np.arange(heights.shape[1]) + 0.5) / heights.shape[1] * 0.16 - 0.05
    carton, block = heights[:, np.abs(y) < 0.03], heights[3:-3, np.abs(y - 0.09) < 0.01]
    assert carton.max() > 0.17 and np.median(carton) > 0.15
    assert 0.03 < np.median(block) < 0.06
    assert heights.max() <= 0.192 + 1e-9


def test_where_another_thing_stands_it_does_not() -> None:
    frame, table, mask = photo_of([standing(MILK, 0.5, 0.0), standing(BLOCK, 0.5, 0.09)], LIBRARY)
    columns = np.indices(mask.shape)[1]
    carton = mask & (columns > columns[mask].min() + 20)  # the block is left of it
    heights = free_space_map(frame, table, carton, BOTH).heights
    y = (np.arange(heights.shape[1]) + 0.5) / heights.shape[1] * 0.16 - 0.05
    assert np.median(heights[3:-3, np.abs(y - 0.09) < 0.01]) == 0
    assert np.median(heights[:, np.abs(y) < 0.03]) > 0.15


def test_what_stands_on_a_known_thing_begins_on_it() -> None:
    block, top = standing(BLOCK, 0.5, 0.0), standing(BLOCK, 0.5, 0.0, above=0.04)
    frame, table, mask = photo_of([block, top], LIBRARY)
    both = UprightBox(center=(0.5, 0.0, 0.04), size=(0.04, 0.04, 0.08), yaw=0.0)
    around = Surroundings([(BLOCK, block.pose)], [], LIBRARY)
    fillable = free_space_map(frame, table, mask, both, around)
    middle = (slice(1, -1), slice(1, -1))
    assert np.median(fillable.floors[middle]) == pytest.approx(0.04, abs=0.009)
    assert np.median(fillable.heights[middle]) == pytest.approx(0.08, abs=0.005)
    assert fillable.occupied[middle].all()
    assert is_box_crowded(both, around) and not is_box_crowded(both, Surroundings([], [], LIBRARY))


def test_without_any_depth_it_may_fill_its_box() -> None:
    frame, table, mask = photo_of([standing(MILK, 0.5, 0.0)], LIBRARY)
    blind = type(frame)(frame.rgb, np.zeros_like(frame.depth), frame.camera, frame.source)
    fillable = free_space_map(blind, table, mask, BOTH)
    assert np.allclose(fillable.heights, 0.192) and not fillable.floors.any() and not fillable.occupied.any()
