import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sim import utils

angle = st.floats(-3.0, 3.0)
tilt = st.floats(-1.4, 1.4)
metre = st.floats(-2, 2)


@given(angle, tilt, angle)
def test_euler_angles_survive_the_way_through_quaternions(roll: float, pitch: float, yaw: float) -> None:
    back = utils.quatXYZW_to_eulerXYZ(utils.eulerXYZ_to_quatXYZW((roll, pitch, yaw)))
    np.testing.assert_allclose(back, (roll, pitch, yaw), atol=1e-6)


@given(st.tuples(metre, metre, metre), st.tuples(angle, tilt, angle), st.tuples(metre, metre, metre))
def test_a_pose_times_its_inverse_leaves_points_alone(position, rotation, point) -> None:
    pose = (position, utils.eulerXYZ_to_quatXYZW(rotation))
    both = utils.multiply(pose, utils.invert(pose))
    np.testing.assert_allclose(utils.apply(both, point), point, atol=1e-9)


def test_apply_transforms_many_points_at_once() -> None:
    pose = ((1.0, 0.0, 0.0), utils.eulerXYZ_to_quatXYZW((0, 0, np.pi / 2)))
    np.testing.assert_allclose(utils.apply(pose, np.eye(3)), [[1, 0, 1], [1, 0, 0], [0, 0, 1]], atol=1e-12)
