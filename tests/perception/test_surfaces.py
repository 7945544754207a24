"""Symmetries: what can be turned without a difference, and angles up to that."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion, quaternion_from_rpy
from grs_agents.perception.asset_surfaces import find_asset_symmetry

LIBRARY = Library()
ANGLES = st.floats(-3.1, 3.1)


@pytest.mark.parametrize(
    ("name", "turns", "axes"),
    [
        ("block/red_block.urdf", 24, 0),
        ("HOPE/Cookies.urdf", 4, 0),
        ("container/open_box.urdf", 2, 0),
        ("mug/mug.urdf", 1, 0),
        ("HOPE/TomatoSauce.urdf", 8, 1),
        ("plate/plate.urdf", 4, 1),
    ],
)
def test_symmetries_of_known_things(name: str, turns: int, axes: int) -> None:
    symmetry = find_asset_symmetry(name, LIBRARY)
    assert (len(symmetry.turns), len(symmetry.axes)) == (turns, axes)


@settings(max_examples=25, deadline=None)
@given(roll=ANGLES, pitch=ANGLES, yaw=ANGLES, spin=ANGLES, tilt=st.floats(0, 1.2))
def test_a_turn_about_a_free_axis_is_no_error_and_a_tilt_of_it_is(
    roll: float, pitch: float, yaw: float, spin: float, tilt: float
) -> None:
    symmetry = find_asset_symmetry("plate/plate.urdf", LIBRARY)
    true = matrix_from_quaternion(quaternion_from_rpy(roll, pitch, yaw))
    turned = (
        true
        @ matrix_from_quaternion(quaternion_from_rpy(tilt, 0, 0))
        @ matrix_from_quaternion(quaternion_from_rpy(0, 0, spin))
    )
    assert symmetry.rotation_error_degrees(turned, true) == pytest.approx(np.rad2deg(tilt), abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(roll=ANGLES, pitch=ANGLES, yaw=ANGLES, turn=st.integers(0, 23), small=st.floats(0, 0.5))
def test_quarter_turns_of_a_cube_are_no_error(roll: float, pitch: float, yaw: float, turn: int, small: float) -> None:
    symmetry = find_asset_symmetry("block/red_block.urdf", LIBRARY)
    true = matrix_from_quaternion(quaternion_from_rpy(roll, pitch, yaw))
    found = true @ matrix_from_quaternion(quaternion_from_rpy(0, small, 0)) @ symmetry.turns[turn]
    assert symmetry.rotation_error_degrees(found, true) == pytest.approx(np.rad2deg(small), abs=1e-3)


def test_a_mug_has_no_symmetry() -> None:
    half = matrix_from_quaternion(quaternion_from_rpy(0, 0, np.pi))
    assert find_asset_symmetry("mug/mug.urdf", LIBRARY).rotation_error_degrees(half, np.eye(3)) == pytest.approx(180)
