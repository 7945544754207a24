"""The walls of open boxes and bowls."""

import numpy as np
import pytest

from grs_agents.base import Vec3
from grs_agents.perception.proxies import (
    WALL,
    bowl_foot_radius,
    bowl_profile,
    bowl_wall_pieces,
    open_box_walls,
    size_with_mean_diameter,
)

SIZE: Vec3 = (0.2, 0.16, 0.07)


def test_an_open_box_is_a_floor_and_four_walls_within_its_size() -> None:
    parts = open_box_walls(SIZE)
    low = np.min([np.subtract(center, np.array(size) / 2) for size, center in parts], axis=0)
    high = np.max([np.add(center, np.array(size) / 2) for size, center in parts], axis=0)
    assert len(parts) == 5
    assert (high - low).tolist() == pytest.approx(SIZE)
    inside = (0.05, 0.03, 0.0)
    assert not any((np.abs(np.subtract(inside, center)) < np.array(size) / 2).all() for size, center in parts)


def test_a_bowl_is_round_and_narrower_below() -> None:
    size = size_with_mean_diameter(SIZE)
    assert size == (0.18, 0.18, 0.07)
    assert bowl_foot_radius(size) < 0.09 and bowl_foot_radius((0.08, 0.08, 0.1)) == 0.04
    radii, heights = zip(*bowl_profile(size), strict=True)
    assert (max(radii), min(heights), max(heights)) == pytest.approx((0.09, -0.035, 0.035))
    corners = np.concatenate(bowl_wall_pieces(size))
    around = np.hypot(corners[:, 0], corners[:, 1])
    assert around.max() == pytest.approx(0.09) and around.min() == pytest.approx(bowl_foot_radius(size) - WALL)
