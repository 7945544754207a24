import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sim.arms import ur5e
from grs_agents.sim.arms.arm_model import ArmModel

ARM = ArmModel(ur5e.UR5e().add)


@given(st.floats(0.25, 0.75), st.floats(-1.5, 1.5), st.floats(0, 0.3), st.floats(-3, 3))
def test_the_tip_comes_where_it_was_asked_to_with_the_tool_down(radius, bearing, height, yaw) -> None:
    tip = np.array([[radius * np.cos(bearing), radius * np.sin(bearing), height]])
    position, rotation = ARM.tip_pose(ur5e.solve_ik_tool_down(tip, np.array([yaw]))[0])
    np.testing.assert_allclose(position, tip[0], atol=1e-9)
    np.testing.assert_allclose(rotation[:3, 2], (0, 0, 1), atol=1e-9)
    np.testing.assert_allclose(rotation[:2, 0], (np.cos(yaw), np.sin(yaw)), atol=1e-9)


def test_a_point_alone_gives_to_the_bit_what_it_gives_in_a_path() -> None:
    tips, yaws = np.array([[0.5, 0.1, 0.1], [0.52, 0.1, 0.1], [1.4, 0.1, 0.1]]), np.array([0.3, 0.4, 0.5])
    path = ur5e.solve_ik_tool_down(tips, yaws)
    for tip, yaw, joints in zip(tips, yaws, path, strict=True):
        np.testing.assert_array_equal(ur5e.solve_ik_tool_down(tip[None], np.array([yaw]))[0], joints)


def test_points_too_far_too_near_and_too_high_are_out_of_reach() -> None:
    points = np.array([[0.5, 0, 0.1], [0.95, 0, 0.1], [0.1, 0, 0.1], [0.6, 0, 0.9]])
    assert ur5e.UR5e().reachable_mask(points).tolist() == [True, False, False, False]
