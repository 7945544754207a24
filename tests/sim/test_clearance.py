import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from grs_agents.sim import clearance, kinematics
from grs_agents.sim.physics import home_joints


@given(st.floats(0.22, 0.85), st.floats(-1.5, 1.5), st.floats(0.001, 0.5), st.floats(-3, 3))
def test_wherever_the_arm_picks_and_places_it_is_clear_of_the_table_and_itself(radius, bearing, height, yaw) -> None:
    tip = np.array([[radius * np.cos(bearing), radius * np.sin(bearing), height]])
    assume(kinematics.reachable(tip)[0])
    assert clearance.clearance(kinematics.solve(tip, np.array([yaw]))[0]) > 0


def test_an_arm_that_points_into_the_table_is_not_clear() -> None:
    down = home_joints()
    down[1] += 1.2
    assert clearance.clearance(down) < 0
    path = np.linspace(home_joints(), down, 50)
    assert clearance.along(path) < 0
    assert clearance.along(path[:2]) > 0


def test_an_arm_folded_onto_its_base_is_not_clear() -> None:
    assert clearance.clearance(np.array([0.0, -np.pi / 2, 3.05, 0.0, 0.0, 0.0])) < 0
