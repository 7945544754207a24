from pathlib import Path

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.sim import Environment, SimulationError

MILK = "HOPE/Milk.urdf"


def two_things() -> Environment:
    def scene(task, env) -> None:
        env.add_object(MILK, at(0.5, 0.1, 0.095))
        env.add_object("block/red_block.urdf", at(0.5, -0.1, 0.02))

    env = Environment(task=Scripted(scene))
    env.reset()
    return env


def test_physics_that_diverges_is_a_named_error_and_leaves_no_file(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    env = two_things()
    env.physics.data.qvel[-6] = np.nan
    with pytest.raises(SimulationError, match=r"diverged at .* out of bounds"):
        env.step_simulation(2)
    assert not list(tmp_path.iterdir())
    env.reset()
    env.physics.check()


def test_a_state_that_was_kept_goes_on_as_it_did() -> None:
    env = two_things()
    physics = env.physics
    kept = physics.snapshot()

    def later() -> list[float]:
        physics.data.qvel[-6:-3] = (0.5, 0.2, 0.0)
        physics.step(50)
        return physics.data.qpos.tolist()

    first = later()
    physics.restore(kept)
    assert later() == first


def test_a_ray_straight_down_meets_what_stands_there() -> None:
    physics = two_things().physics
    height, owner = physics.height_below(0.5, -0.1)
    assert (owner, height) == (2, pytest.approx(0.04, abs=0.001))
    assert physics.height_below(0.3, -0.3) == (pytest.approx(0.0, abs=1e-6), -1)


def test_what_rests_is_held_up_and_does_not_move() -> None:
    physics = two_things().physics
    assert physics.supported(1)
    assert physics.speed_of(1) < 0.01
    physics.teleport(1, at(0.5, 0.1, 0.3))
    physics.step(5)
    assert not physics.supported(1)
    assert physics.speed() > 0.1
