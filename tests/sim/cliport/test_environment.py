import numpy as np
import pytest
from sim_scenes import Scripted, at, run, zone_goal

from grs_agents.base.errors import UnknownNameError
from grs_agents.sim import Environment, NoFreeSpaceError, SimulationBudgetError, p


def reset(scene, **options) -> Environment:
    env = Environment("no/such/folder/", disp=False, hz=480, record_cfg=[], **options)
    env.set_task(Scripted(scene))
    env.reset()
    return env


def test_objects_sunk_into_the_table_and_each_other_part_gently() -> None:
    def scene(task, env) -> None:
        env.add_object("HOPE/Milk.urdf", at(0.5, 0.0, 0.08))
        env.add_object("HOPE/Milk.urdf", at(0.56, 0.0, 0.09))
        env.add_object("HOPE/Tuna.urdf", at(0.5, 0.2, -0.01))

    env = reset(scene)
    assert env.is_static
    for start, item in zip(((0.5, 0.0), (0.56, 0.0), (0.5, 0.2)), env.objects, strict=True):
        assert np.linalg.norm(np.subtract(item.pose[0][:2], start)) < 0.03
        assert item.pose[0][2] > 0.01


def test_a_missing_asset_names_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"HOPE/Milk\.urdf"):
        reset(lambda task, env: env.add_object("HOPE/Milks.urdf", at(0.5, 0, 0.1)))


def test_an_object_without_a_place_is_the_outcome_no_free_space() -> None:
    with pytest.raises(NoFreeSpaceError, match="Milk"):
        reset(lambda task, env: env.add_object("HOPE/Milk.urdf", (None, None)))


def test_info_and_bullet_calls_tell_where_things_are() -> None:
    env = reset(lambda task, env: env.add_object("HOPE/Corn.urdf", at(0.5, 0.1, 0.029)))
    position, rotation, size = env.info[1]
    assert p.getBasePositionAndOrientation(1) == (position, rotation)
    assert size == pytest.approx(env.library.asset("HOPE/Corn.urdf").size, abs=0.002)


def test_images_show_the_object_and_are_made_on_demand() -> None:
    env = reset(lambda task, env: env.add_object("HOPE/Corn.urdf", at(0.5, 0.1, 0.029)))
    images = env.observation
    assert images["color"][0].shape == (480, 640, 3)
    assert images["depth"][2].max() > 0.5


def test_the_budget_of_simulated_steps_ends_in_a_typed_error() -> None:
    env = reset(lambda task, env: None, budget=3000)
    with pytest.raises(SimulationBudgetError, match="3000"):
        env.step_simulation(4000)


def test_the_same_seed_gives_the_same_episode_bit_for_bit() -> None:
    def scene(task, env) -> None:
        ids = [env.add_object(name, task.get_random_pose(env, (0.1, 0.1, 0.1))) for name in ("HOPE/Corn.urdf",) * 2]
        zone_goal(task, ids, at(0.5, 0.3, 0.001), (0.3, 0.2, 0.0))

    first, env = run(scene, seed=3)
    second, again = run(scene, seed=3)
    assert first == second
    assert env.info == again.info
    assert run(scene, seed=4)[0].actions != first.actions
