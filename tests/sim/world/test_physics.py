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
    env.physics.raise_if_diverged()


def test_a_state_that_was_kept_goes_on_as_it_did() -> None:
    env = two_things()
    physics = env.physics
    kept = physics.save_state()

    def later() -> list[float]:
        physics.data.qvel[-6:-3] = (0.5, 0.2, 0.0)
        physics.step(50)
        return physics.data.qpos.tolist()

    first = later()
    physics.restore_state(kept)
    assert later() == first


def test_a_ray_straight_down_meets_what_stands_there() -> None:
    physics = two_things().physics
    height, owner = physics.surface_height_below(0.5, -0.1)
    assert (owner, height) == (2, pytest.approx(0.04, abs=0.001))
    assert physics.surface_height_below(0.3, -0.3) == (pytest.approx(0.0, abs=1e-6), -1)


def test_what_rests_is_held_up_and_does_not_move() -> None:
    physics = two_things().physics
    assert physics.is_object_supported(1)
    assert physics.object_speed(1) < 0.01
    physics.teleport_object(1, at(0.5, 0.1, 0.3))
    physics.step(5)
    assert not physics.is_object_supported(1)
    assert physics.max_free_body_speed() > 0.1


def test_a_scene_put_down_at_rest_settles_in_a_few_steps_and_as_a_new_one_does() -> None:
    def scene(task, env) -> None:
        for y in (-0.1, 0.0, 0.1):
            env.add_object("block/block.urdf", at(0.5 + float(env.rng.uniform(-0.1, 0.1)), y, 0.02))

    env = Environment(task=Scripted(scene), seed=1)
    env.reset()
    before = env.budget.left
    env.seed(2)
    env.reset()
    assert before - env.budget.left < 8
    anew = Environment(task=Scripted(scene), seed=2)
    anew.reset()
    assert anew.info == env.info
    assert anew.physics.data.qvel.tolist() == env.physics.data.qvel.tolist()


@pytest.mark.parametrize("beyond", [0.001, 0.004])
def test_what_tips_ever_so_slowly_is_not_taken_for_resting(beyond: float) -> None:
    def scene(task, env) -> None:
        env.add_object("block/block.urdf", at(0.5, 0.0, 0.02), "fixed")
        env.add_object("block/block.urdf", at(0.52 + beyond, 0.0, 0.06))

    env = Environment(task=Scripted(scene))
    env.reset()
    assert env.get_object_pose(2)[0][2] < 0.05
