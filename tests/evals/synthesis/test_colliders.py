"""Stacks of primitives fill what they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evals.synthesis.colliders import box, lifted, open_box, ring, stadium
from grs_agents.library.shapes import merge_bounds, shape_bounds

LENGTHS = st.floats(0.01, 0.5)


@given(LENGTHS, LENGTHS, LENGTHS)
def test_a_stadium_has_its_extents(x: float, y: float, height: float) -> None:
    low, high = merge_bounds(shape_bounds(shape) for shape in stadium(x, y, 0.1, 0.1 + height))
    assert np.allclose([low, high], [(-x / 2, -y / 2, 0.1), (x / 2, y / 2, 0.1 + height)], atol=1e-4)


@pytest.mark.parametrize("count", [12, 16])
def test_a_ring_reaches_its_radius_and_leaves_its_middle_free(count: int) -> None:
    shapes = ring(0.08, 0.005, 0.0, 0.06, count)
    low, high = merge_bounds(shape_bounds(shape) for shape in shapes)
    assert np.allclose(high[:2], 0.08, atol=1e-6)
    assert np.allclose(low[:2], -0.08, atol=1e-6)
    nearest = min(np.linalg.norm(shape.position[:2]) - shape.size[0] / 2 for shape in shapes)
    assert nearest > 0.07


def test_an_open_box_has_a_floor_and_no_lid() -> None:
    walls = open_box((0.3, 0.2, 0.1), 0.005)
    assert np.allclose(merge_bounds(map(shape_bounds, walls)), [(-0.15, -0.1, -0.05), (0.15, 0.1, 0.05)])
    over_the_middle = [
        shape
        for shape in walls
        if all(low < 0 < high for low, high in zip(*np.array(shape_bounds(shape))[:, :2], strict=True))
    ]
    assert len(over_the_middle) == 1
    assert over_the_middle[0].position[2] == pytest.approx(-0.0475)


def test_lifting_moves() -> None:
    assert lifted((box((1, 1, 1), (1, 0, 0)),), (0, 0, 2))[0].position == (1, 0, 2)
