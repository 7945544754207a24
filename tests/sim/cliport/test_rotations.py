"""Rotations as transforms3d has them: (w, x, y, z), axes by name. Known values are of transforms3d 0.4.2."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sim import utils
from grs_agents.sim.cliport import rotations

ANGLES = (0.3, -0.7, 1.9)
AXES = [
    frame + "".join(letters)
    for frame in "sr"
    for letters in itertools.product("xyz", repeat=3)
    if letters[0] != letters[1] != letters[2]
]
angles = st.floats(-math.pi, math.pi)
turns = st.tuples(angles, angles, angles)


@pytest.mark.parametrize(
    ("axes", "quaternion"),
    [
        ("sxyz", (0.4986005, 0.357442, -0.0830324, 0.7853269)),
        ("rxyz", (0.5819626, -0.1941309, -0.3114039, 0.7257137)),
        ("szyx", (0.5819626, 0.7257137, -0.3114039, -0.1941309)),
        ("rzyx", (0.4986005, 0.7853269, -0.0830324, 0.357442)),
        ("rzxz", (0.4260958, -0.2388992, 0.2459798, 0.8371759)),
        ("syzy", (0.4260958, -0.2459798, 0.8371759, -0.2388992)),
    ],
)
def test_three_angles_make_the_known_quaternion(axes: str, quaternion: tuple[float, ...]) -> None:
    assert rotations.euler2quat(*ANGLES, axes) == pytest.approx(quaternion, abs=1e-6)


def test_the_usual_axes_are_those_of_cliports_utils() -> None:
    w, x, y, z = rotations.euler2quat(*ANGLES)
    assert (x, y, z, w) == pytest.approx(utils.eulerXYZ_to_quatXYZW(ANGLES))
    assert rotations.quat2euler((w, x, y, z)) == pytest.approx(utils.quatXYZW_to_eulerXYZ((x, y, z, w)))


def test_a_quarter_turn_about_z() -> None:
    half = math.sqrt(0.5)
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert rotations.euler2quat(0, 0, math.pi / 2) == pytest.approx((half, 0, 0, half))
    assert rotations.euler2mat(0, 0, math.pi / 2) == pytest.approx(np.array(quarter), abs=1e-9)
    assert rotations.axangle2mat((0, 0, 2), math.pi / 2) == pytest.approx(np.array(quarter), abs=1e-9)
    assert rotations.mat2quat(quarter) == pytest.approx((half, 0, 0, half))
    assert rotations.rotate_vector((1, 0, 0), (half, 0, 0, half)) == pytest.approx((0, 1, 0))
    axis, angle = rotations.mat2axangle(quarter)
    assert (*axis, angle) == pytest.approx((0, 0, 1, math.pi / 2))
    assert rotations.tait_bryan(rotations.euler2mat)(z=math.pi / 2) == pytest.approx(np.array(quarter), abs=1e-9)
    assert rotations.tait_bryan(rotations.mat2euler)(quarter) == pytest.approx((math.pi / 2, 0, 0))


@given(turns, st.sampled_from(AXES))
def test_angles_and_matrix_are_inverse(turn: tuple[float, float, float], axes: str) -> None:
    matrix = rotations.euler2mat(*turn, axes)
    assert rotations.euler2mat(*rotations.mat2euler(matrix, axes), axes) == pytest.approx(matrix, abs=1e-6)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-9)


@given(turns)
def test_quaternion_axis_and_matrix_agree(turn: tuple[float, float, float]) -> None:
    quaternion = rotations.euler2quat(*turn)
    matrix = rotations.quat2mat(quaternion)
    assert rotations.nearly_equivalent(rotations.mat2quat(matrix), quaternion, atol=1e-6)
    assert rotations.axangle2mat(*rotations.quat2axangle(quaternion)) == pytest.approx(matrix, abs=1e-6)
    assert rotations.qmult(quaternion, rotations.qinverse(quaternion)) == pytest.approx(rotations.qeye(), abs=1e-9)
    assert rotations.quat2mat(rotations.qpow(quaternion, 2)) == pytest.approx(matrix @ matrix, abs=1e-6)
    assert rotations.nearly_equivalent(rotations.qexp(rotations.qlog(quaternion)), quaternion, atol=1e-6)
    assert rotations.qisunit(rotations.fillpositive(quaternion[1:]))


def test_an_affine_comes_apart_as_it_was_put_together() -> None:
    parts = ((1, 2, 3), rotations.euler2mat(*ANGLES), (2.0, 0.5, 1.5), (0.1, -0.2, 0.3))
    for part, again in zip(parts, rotations.decompose(rotations.compose(*parts)), strict=True):
        assert again == pytest.approx(np.asarray(part))
    turned = rotations.axangle2aff((1, 2, 3), 0.7, (0.5, 0.1, 0.2))
    assert turned @ (0.5, 0.1, 0.2, 1) == pytest.approx((0.5, 0.1, 0.2, 1))
    axis, angle, point = rotations.aff2axangle(turned)
    assert rotations.axangle2aff(axis, angle, point) == pytest.approx(turned)


@pytest.mark.parametrize("axes", ["xyz", "sxxy", "sxyy", "txyz", "sxyw", ""])
def test_other_axes_are_refused(axes: str) -> None:
    with pytest.raises(KeyError):
        rotations.euler2quat(*ANGLES, axes)


def test_what_is_no_rotation_has_no_axis() -> None:
    with pytest.raises(ValueError, match="no unit eigenvector"):
        rotations.mat2axangle(np.diag([1, 2, 3]))
    axis, angle = rotations.quat2axangle((1, 0, 0, 0))
    assert (*axis, angle) == (1, 0, 0, 0)
