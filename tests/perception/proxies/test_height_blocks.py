"""Stepped things as a few boxes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from grs_agents.base import Vec3
from grs_agents.perception.proxies import (
    MAX_BLOCKS,
    FreeColumns,
    are_blocks_stable,
    bounds_of_blocks,
    fit_height_blocks,
    mean_distance_to_blocks,
    split_into_blocks,
    stretch_blocks_to_size,
)

SIZE: Vec3 = (0.2, 0.1, 0.12)


def test_two_steps_are_two_boxes_where_they_are() -> None:
    heights = np.full((10, 6), 0.04)
    heights[6:] = 0.12
    low, high = sorted(split_into_blocks(FreeColumns.from_heights(heights), SIZE), key=lambda block: block[0][2])
    assert low[0] == pytest.approx((0.12, 0.1, 0.04)) and low[1] == pytest.approx((-0.04, 0.0, -0.04))
    assert high[0] == pytest.approx((0.08, 0.1, 0.12)) and high[1] == pytest.approx((0.06, 0.0, 0.0))


def test_where_nothing_is_there_is_no_box() -> None:
    heights = np.zeros((8, 8))
    assert split_into_blocks(FreeColumns.from_heights(heights), SIZE) == []
    heights[:4, :4] = 0.1
    (block,) = split_into_blocks(FreeColumns.from_heights(heights), SIZE)
    assert block[0] == pytest.approx((0.1, 0.05, 0.1))


def test_a_box_begins_on_its_floor() -> None:
    heights, floors, nothing = np.full((10, 6), 0.12), np.zeros((10, 6)), np.zeros((10, 6), np.bool_)
    floors[5:] = 0.09
    whole, upper = sorted(split_into_blocks(FreeColumns(floors, heights, nothing), SIZE), key=lambda block: block[1][0])
    assert whole[0] == pytest.approx((0.1, 0.1, 0.12))
    assert upper[0] == pytest.approx((0.1, 0.1, 0.03)) and upper[1] == pytest.approx((0.05, 0.0, 0.045))


def test_where_another_thing_stands_for_certain_there_is_no_box_however_small_that_is() -> None:
    heights, occupied = np.full((16, 16), 0.12), np.zeros((16, 16), np.bool_)
    heights[2, 3] = 0.0
    assert len(split_into_blocks(FreeColumns.from_heights(heights), SIZE)) == 1
    occupied[2, 3] = True
    middle = np.array([(2.5 / 16 - 0.5) * SIZE[0], (3.5 / 16 - 0.5) * SIZE[1]])
    for size, center in split_into_blocks(FreeColumns(np.zeros_like(heights), heights, occupied), SIZE):
        assert (np.abs(middle - center[:2]) > np.array(size[:2]) / 2).any()


@given(arrays(np.float64, (7, 5), elements=st.floats(0.02, 0.12)))
def test_the_boxes_fill_the_footprint_once_and_stay_in_the_measured_box(heights: np.ndarray) -> None:
    blocks = split_into_blocks(FreeColumns.from_heights(heights), SIZE)
    assert 1 <= len(blocks) <= MAX_BLOCKS[0]
    assert sum(size[0] * size[1] for size, _ in blocks) == pytest.approx(SIZE[0] * SIZE[1])
    for size, center in blocks:
        assert all(abs(center[axis]) + size[axis] / 2 <= SIZE[axis] / 2 + 1e-9 for axis in range(3))
        assert center[2] - size[2] / 2 == pytest.approx(-SIZE[2] / 2)


def test_stretched_boxes_reach_from_end_to_end() -> None:
    heights = np.zeros((10, 6))
    heights[1:, :5], heights[6:, :5] = 0.04, 0.1
    low, high = bounds_of_blocks(
        stretch_blocks_to_size(split_into_blocks(FreeColumns.from_heights(heights), SIZE), SIZE)
    )
    assert low.tolist() == pytest.approx([-0.1, -0.05, -0.06]) and high.tolist() == pytest.approx([0.1, 0.05, 0.06])


def test_points_on_the_boxes_are_not_off_and_others_are() -> None:
    blocks = split_into_blocks(FreeColumns.from_heights(np.full((4, 4), SIZE[2])), SIZE)
    top = np.array([[x, y, SIZE[2] / 2] for x in (-0.05, 0.0, 0.05) for y in (-0.02, 0.0, 0.02)])
    assert mean_distance_to_blocks(top, blocks) == pytest.approx(0.0, abs=1e-9)
    assert mean_distance_to_blocks(top + np.array([0, 0, 0.01]), blocks) == pytest.approx(0.01)
    assert math.isinf(mean_distance_to_blocks(top, []))


def test_what_stands_has_its_middle_above_its_foot() -> None:
    leg, board = ((0.04, 0.04, 0.1), (0.0, 0.0, -0.03)), ((0.2, 0.04, 0.02), (0.0, 0.0, 0.03))
    assert are_blocks_stable([leg, board])
    assert not are_blocks_stable([leg, ((0.2, 0.04, 0.02), (0.12, 0.0, 0.03))])
    assert are_blocks_stable([leg, ((0.2, 0.04, 0.02), (0.12, 0.0, 0.03)), ((0.02, 0.02, 0.1), (0.2, 0.0, -0.03))])


def test_what_does_not_stand_may_lean_on_what_is_below_it() -> None:
    floors, heights = np.zeros((10, 4)), np.full((10, 4), SIZE[2])
    floors[1:] = SIZE[2] - 0.02
    raised = FreeColumns(floors, heights, np.zeros(heights.shape, np.bool_))
    assert fit_height_blocks(raised, SIZE) and not are_blocks_stable(fit_height_blocks(raised, SIZE))
    heights[1:] = 0
    assert not fit_height_blocks(FreeColumns.from_heights(heights), SIZE)
