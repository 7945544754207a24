"""Whether a stand-in is of the measured size, where it was measured."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.library.library import Library
from grs_agents.perception.registration.size_check import (
    deviation_from_measured_box,
    enclosing_aabb,
    upright_box_from_aabb,
)
from grs_agents.perception.types import Aabb, UprightBox

LIBRARY = Library()
MILK = "HOPE/Milk.urdf"
SIZE = LIBRARY.asset(MILK).size


@given(st.floats(-3, 3), st.floats(-0.05, 0.05), st.floats(0.7, 1.4))
def test_the_deviation_is_how_far_the_box_is_off(yaw: float, shift: float, share: float) -> None:
    x, y, z = SIZE
    measured = UprightBox(center=(0.5, 0.1, z / 2), size=(x, y, z / share), yaw=yaw)
    pose = ((0.5 + shift, 0.1, z / 2), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    off = deviation_from_measured_box(MILK, pose, LIBRARY, measured)
    assert off.centre == pytest.approx(abs(shift), abs=2e-3)
    assert off.size == pytest.approx(abs(share - 1), abs=0.02)
    assert off.is_within_tolerance == (off.centre <= 0.02 and off.size <= 0.25)


def test_a_turned_box_has_a_larger_one_around_it_and_a_cylinder_has_not() -> None:
    box = UprightBox(center=(0.5, 0.0, 0.05), size=(0.1, 0.1, 0.1), yaw=math.pi / 4)
    assert enclosing_aabb(box, "box").size == pytest.approx((0.1414, 0.1414, 0.1), abs=1e-4)
    assert enclosing_aabb(box, "cylinder").size == pytest.approx((0.1, 0.1, 0.1))
    around = Aabb(low=(0.4, 0.0, 0.0), high=(0.5, 0.1, 0.2))
    assert enclosing_aabb(upright_box_from_aabb(around), "box").low == pytest.approx(around.low)
