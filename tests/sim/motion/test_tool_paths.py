import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sim.motion.tool_paths import Pace, motion_profile

TIMESTEP = 0.004


@given(length=st.floats(0.02, 1.5), speed=st.floats(0.2, 1.5), acceleration=st.floats(0.5, 40.0))
def test_a_way_is_gone_in_order_and_neither_too_fast_nor_too_hard(
    length: float, speed: float, acceleration: float
) -> None:
    gone = length * motion_profile(length, Pace(speed, acceleration, TIMESTEP))
    speeds = np.diff(gone) / TIMESTEP
    assert abs(gone[0]) < 1e-9
    assert abs(gone[-1] - length) < 1e-9
    assert (speeds > -1e-9).all()
    ticks = len(gone)  # a way of few time steps is cut to whole ones
    assert speeds.max() < speed * (1 + 3 / ticks)
    assert np.abs(np.diff(speeds)).max() / TIMESTEP < acceleration * (1 + 8 / ticks)


@given(length=st.floats(0.02, 1.5))
def test_a_longer_way_never_takes_less_time(length: float) -> None:
    gait = Pace(0.8, 25.0, TIMESTEP)
    assert len(motion_profile(length * 1.05, gait)) >= len(motion_profile(length, gait))
