"""Bounds and rotations of shapes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.library.shapes import (
    Shape,
    matrix_from_quaternion,
    merge_bounds,
    quaternion_from_rpy,
    rpy_from_quaternion,
    shape_bounds,
)

ANGLES = st.floats(-3.1, 3.1)
PITCHES = st.floats(-1.5, 1.5)


@given(ANGLES, PITCHES, ANGLES)
def test_rpy_and_quaternion_are_inverse(roll: float, pitch: float, yaw: float) -> None:
    back = rpy_from_quaternion(quaternion_from_rpy(roll, pitch, yaw))
    assert np.allclose(
        matrix_from_quaternion(quaternion_from_rpy(*back)),
        matrix_from_quaternion(quaternion_from_rpy(roll, pitch, yaw)),
        atol=1e-6,
    )


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_survives_gimbal_lock(pitch: float) -> None:
    quaternion = quaternion_from_rpy(0.4, pitch, -1.1)
    again = quaternion_from_rpy(*rpy_from_quaternion(quaternion))
    assert np.allclose(matrix_from_quaternion(again), matrix_from_quaternion(quaternion), atol=1e-6)


def test_yaw_turns_x_to_y() -> None:
    assert np.allclose(matrix_from_quaternion(quaternion_from_rpy(0, 0, math.pi / 2)) @ (1, 0, 0), (0, 1, 0))


def test_bounds_of_a_turned_box_and_a_lying_cylinder() -> None:
    turned = Shape(kind="box", size=(2, 1, 1), quaternion=quaternion_from_rpy(0, 0, math.pi / 2))
    assert np.allclose(shape_bounds(turned), [(-0.5, -1, -0.5), (0.5, 1, 0.5)])
    lying = Shape(
        kind="cylinder", size=(0.1, 2.0), quaternion=quaternion_from_rpy(0, math.pi / 2, 0), position=(1, 0, 0)
    )
    assert np.allclose(shape_bounds(lying), [(0, -0.1, -0.1), (2, 0.1, 0.1)])


@given(ANGLES, PITCHES, ANGLES)
def test_every_corner_of_a_box_is_within_its_bounds(roll: float, pitch: float, yaw: float) -> None:
    box = Shape(kind="box", size=(0.3, 0.1, 0.2), quaternion=quaternion_from_rpy(roll, pitch, yaw), position=(1, 2, 3))
    low, high = shape_bounds(box)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners = signs * np.array(box.size) / 2 @ matrix_from_quaternion(box.quaternion).T + box.position
    assert np.allclose([corners.min(axis=0), corners.max(axis=0)], [low, high])


def test_a_mesh_is_scaled_and_moved() -> None:
    mesh = Shape(kind="mesh", size=(2, 1, 1), mesh="m.obj", position=(0, 0, 5))
    low, high = shape_bounds(mesh, np.array([[0.0, 0, 0], [1, 1, 1]]))
    assert np.allclose([low, high], [(0, 0, 5), (2, 1, 6)])
    with pytest.raises(ValueError, match=r"m\.obj"):
        shape_bounds(mesh)


def test_union_of_bounds() -> None:
    sphere = Shape(kind="sphere", size=(1,), position=(3, 0, 0))
    box = Shape(kind="box", size=(1, 1, 1))
    assert merge_bounds(map(shape_bounds, [sphere, box])) == ((-0.5, -1, -1), (4, 1, 1))
