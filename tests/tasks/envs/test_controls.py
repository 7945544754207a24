"""Directions of the controls, in the robot frame: x forward, y left, z up, turns counter-clockwise from above."""

import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from grs_agents.base.files import write_json
from grs_agents.sim import TaskInstance


def tip(observation: dict[str, np.ndarray]) -> tuple[np.ndarray, float]:
    """Position (3,) of the tip, m, and its turn about the vertical, rad."""
    z, w = observation["tip"][5:]
    return observation["tip"][:3], 2 * math.atan2(z, w)


@pytest.mark.parametrize(
    ("action", "axis", "sign"),
    [
        ((1, 0, 0, 0), 0, 1),
        ((-1, 0, 0, 0), 0, -1),
        ((0, 1, 0, 0), 1, 1),
        ((0, -1, 0, 0), 1, -1),
        ((0, 0, 1, 0), 2, 1),
        ((0, 0, 0, 1), 3, 1),
        ((0, 0, 0, -1), 3, -1),
    ],
)
def test_ee_delta_moves_the_tip_along_its_axis(blocks: Path, action: tuple[int, ...], axis: int, sign: int) -> None:
    env = gymnasium.make("grs_agents.envs:GRS-v0", run=blocks, control="ee_delta")
    seen, _ = env.reset(seed=0)
    before, yaw = tip(seen)
    for _ in range(5):
        seen = env.step(np.array([*action, -1], np.float32))[0]
    after, turned = tip(seen)
    moved = np.array([*(after - before), math.remainder(turned - yaw, math.tau)])
    assert sign * moved[axis] > 0.01
    assert np.abs(np.delete(moved, axis)).max() < 0.02


def test_many_small_steps_of_ee_delta_add_up_where_kinematics_are_iterative(blocks: Path, tmp_path: Path) -> None:
    instance = TaskInstance.model_validate_json((blocks / "instances" / "seed_0.json").read_text(encoding="utf-8"))
    write_json(tmp_path / "instances" / "seed_0.json", instance.model_copy(update={"robot": "panda"}).model_dump())
    env = gymnasium.make("grs_agents.envs:GRS-v0", run=tmp_path, control="ee_delta")
    seen, _ = env.reset(seed=0)
    before, steps = tip(seen)[0], np.array([0.00007, 0.00005, -0.00003]) / 0.03
    for share in (*[1.0] * 150, *[0.0] * 10):
        seen = env.step(np.array([*share * steps, 0.0, -1.0], np.float32))[0]
    assert np.abs(tip(seen)[0] - before - 150 * 0.03 * steps).max() < 5e-4
