"""Guessed boxes give way to what is known, and to each other where they have no points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.perception.proxies.box_clipping import EstimatedVolume, clip_boxes
from grs_agents.perception.types import Array, UprightBox

NOTHING: Array = np.zeros((0, 3))


def claim(
    low: tuple[float, float, float], high: tuple[float, float, float], points: Array, yaw: float = 0.0
) -> EstimatedVolume:
    """A box between two corners."""
    center, size = np.add(low, high) / 2, np.subtract(high, low)
    box = UprightBox(center=(center[0], center[1], center[2]), size=(size[0], size[1], size[2]), yaw=yaw)
    return EstimatedVolume(box, "box", points)


def top(low: tuple[float, float], high: tuple[float, float], z: float) -> Array:
    """Points all over a level rectangle."""
    x, y = np.meshgrid(np.linspace(low[0], high[0], 12), np.linspace(low[1], high[1], 12))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)


def test_a_box_whose_underside_is_a_guess_rests_on_what_is_known_below() -> None:
    upper = claim((0, 0, 0), (0.1, 0.1, 0.12), top((0, 0), (0.1, 0.1), 0.12))
    (found,) = clip_boxes([upper], claim((-0.02, -0.02, 0), (0.12, 0.12, 0.05), NOTHING).grid_points)
    assert found.box.center[2] - found.box.size[2] / 2 == pytest.approx(0.05, abs=0.008)
    assert found.box.center[2] + found.box.size[2] / 2 == pytest.approx(0.12)
    assert found.box.size[:2] == upper.box.size[:2]


def test_of_two_boxes_the_one_gives_way_that_has_no_points_there() -> None:
    seen = claim((0, 0, 0), (0.1, 0.1, 0.05), top((0, 0), (0.1, 0.1), 0.05))
    guessed = claim((0.06, 0, 0), (0.2, 0.1, 0.05), top((0.11, 0), (0.2, 0.1), 0.05))
    kept, cut = clip_boxes([seen, guessed], NOTHING)
    assert kept == seen
    assert cut.box.center[0] - cut.box.size[0] / 2 == pytest.approx(0.1, abs=0.01)


def test_what_would_lose_too_many_of_its_points_stays() -> None:
    inside = claim((0.04, 0.04, 0), (0.06, 0.06, 0.05), top((0.04, 0.04), (0.06, 0.06), 0.05))
    assert clip_boxes([inside], claim((0, 0, 0), (0.1, 0.1, 0.2), NOTHING).grid_points) == [inside]


@given(yaw=st.floats(-3, 3), apart=st.floats(0.11, 0.3))
def test_what_does_not_overlap_stays(yaw: float, apart: float) -> None:
    one = claim((0, 0, 0), (0.07, 0.07, 0.05), top((0, 0), (0.07, 0.07), 0.05), yaw)
    other = claim((apart, 0, 0), (apart + 0.07, 0.07, 0.05), top((apart, 0), (apart + 0.07, 0.07), 0.05))
    assert clip_boxes([one, other], NOTHING) == [one, other]


def test_what_is_cut_off_beside_a_guess_keeps_most_of_what_was_measured() -> None:
    one = claim((0, 0, 0), (0.2, 0.1, 0.05), top((0, 0), (0.2, 0.1), 0.05))
    far = claim((0.12, 0, 0), (0.3, 0.1, 0.05), top((0.13, 0), (0.3, 0.1), 0.05))
    first, second = clip_boxes([one, far], NOTHING)
    assert first.box.size[0] > 0.16
    assert second.box.size[0] > 0.14
    near = claim((0.18, 0, 0), (0.3, 0.1, 0.05), top((0.18, 0), (0.3, 0.1), 0.05))
    cut, kept = clip_boxes([one, near], NOTHING)
    assert cut.box.size[0] + kept.box.size[0] == pytest.approx(0.3, abs=0.01)


def test_what_was_measured_beyond_a_known_thing_is_not_the_guess_s() -> None:
    seen = claim((0, 0, 0), (0.2, 0.1, 0.05), top((0, 0), (0.2, 0.1), 0.05))
    (cut,) = clip_boxes([seen], claim((0.12, -0.02, 0), (0.3, 0.12, 0.05), NOTHING).grid_points)
    assert cut.box.size[0] == pytest.approx(0.12, abs=0.008)


def test_a_known_thing_that_reaches_in_a_little_costs_no_large_part() -> None:
    seen = claim((0, 0, 0), (0.2, 0.1, 0.05), top((0, 0), (0.2, 0.1), 0.05))
    assert clip_boxes([seen], claim((0.08, -0.02, 0.04), (0.3, 0.12, 0.2), NOTHING).grid_points) == [seen]
