"""Paths of joints in time."""

import numpy as np
import pytest

from grs_agents.sim.arms.joint_paths import slow_to_speed_limits


@pytest.mark.parametrize("step", [1, -1])
def test_a_path_that_speeds_up_or_slows_down_keeps_its_direction_when_it_is_stretched(step: int) -> None:
    timestep, limit = 0.016, np.array([2.0])
    path = (1 - np.linspace(0, 1, 12)[:, None] ** 3)[::step]
    slowed = slow_to_speed_limits(path, timestep, limit)
    steps = -step * np.diff(slowed[:, 0])
    assert slowed[[0, -1]] == pytest.approx(path[[0, -1]])
    assert len(slowed) > 2 * len(path)
    assert steps.min() > 0
    assert steps.max() < 1.1 * limit[0] * timestep
