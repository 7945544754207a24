"""Paths of joints in time."""

import numpy as np
import pytest

from grs_agents.sim.arms.joint_paths import slow_to_speed_limits
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.motion.tool_paths import smoothstep


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


@pytest.mark.parametrize("rows", [0.5, 1.0, 2.0])
def test_a_leap_is_stretched_to_the_speed_limit(rows: float) -> None:
    timestep, limit = 0.016, np.array([2.0])
    path = 0.3 * np.tanh((np.arange(29.0)[:, None] - 14) / rows)
    slowed = slow_to_speed_limits(path, timestep, limit)
    assert slowed[[0, -1]] == pytest.approx(path[[0, -1]])
    assert np.abs(np.diff(slowed, axis=0)).max() <= 1.03 * limit[0] * timestep


@pytest.mark.parametrize("length", [0.03, 0.05, 0.2])
def test_the_solved_joints_of_a_path_begin_and_end_as_gently_as_its_tip(length: float) -> None:
    shares = smoothstep(20)
    tips = np.stack([0.5 + length * shares, np.zeros(20), np.full(20, 0.2)], axis=1)
    steps = np.abs(np.diff(get_arm("panda").solve_ik_tool_down(tips, np.zeros(20)), axis=0)).max(axis=1)
    assert max(steps[0], steps[-1]) < 0.05 * steps.max()
