import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.sim import Environment, SimulationError, UnsupportedError, utils
from grs_agents.sim.arms.arm_model import ArmModel


@pytest.fixture
def env(tmp_path) -> Environment:
    made = Environment(
        task=Scripted(lambda task, env: env.add_object("HOPE/Milk.urdf", at(0.5, 0.1, 0.095))),
        record_cfg={"save_video_path": str(tmp_path)},
    )
    made.reset()
    return made


def test_the_arm_moves_to_a_pose_and_home_again(env) -> None:
    assert not env.movep(((0.5, -0.2, 0.3), utils.eulerXYZ_to_quatXYZW((0, 0, 0.5))))
    assert env.physics.tip_position == pytest.approx((0.5, -0.2, 0.3), abs=0.004)
    assert utils.yaw_of(env.physics.tip_rotation()) == pytest.approx(0.5, abs=0.02)
    assert not env.movej(env.homej)
    assert env.physics.joint_positions == pytest.approx(env.homej, abs=0.01)


def test_a_move_that_does_not_get_there_in_time_says_so(env) -> None:
    assert env.movej(env.homej + 1.0, timeout=0.1)


def test_joint_angles_are_the_ones_of_the_pose(env) -> None:
    tip, _ = ArmModel(env.arm.add).tip_pose(env.solve_ik(at(0.5, 0.2, 0.1)))
    assert tip == pytest.approx((0.5, 0.2, 0.1))


def test_what_the_arm_cannot_do_is_typed(env) -> None:
    with pytest.raises(SimulationError, match=r"1\.20 m") as caught:
        env.solve_ik(at(1.2, 0, 0.1))
    assert caught.value.outcome == "unreachable"
    with pytest.raises(SimulationError, match=r"tilted by 1\.50 rad") as caught:
        env.solve_ik(((0.82, 0, 0.02), utils.eulerXYZ_to_quatXYZW((0, 1.5, 0))))
    assert caught.value.outcome == "unreachable"
    with pytest.raises(SimulationError, match="6 joint positions"):
        env.movej([0, 0, 0])
    with pytest.raises(SimulationError, match="limits"):
        env.movej(env.homej + np.array([0, 0, 2, 0, 0, 0]))


def test_the_arm_moves_to_a_tilted_pose(env) -> None:
    rotation = utils.eulerXYZ_to_quatXYZW((0.4, 0.2, 0.7))
    assert not env.movep(((0.5, -0.1, 0.25), rotation))
    assert env.physics.tip_position == pytest.approx((0.5, -0.1, 0.25), abs=0.005)
    assert abs(np.dot(env.physics.tip_rotation(), rotation)) > 0.9995


def test_configured_cameras_see_what_the_observation_shows(env) -> None:
    color, depth, owner = env.render_camera(env.agent_cams[1])
    np.testing.assert_allclose(depth, env.observation["depth"][1], atol=1e-4)
    assert (color != env.observation["color"][1]).mean() < 0.001
    assert (owner == 1).any()
    assert env.render().shape == (480, 640, 3)
    with pytest.raises(SimulationError, match="intrinsics"):
        env.render_camera({"image_size": (48, 64)})
    with pytest.raises(UnsupportedError, match="window"):
        env.render(mode="human")


def test_the_action_space_holds_its_samples_and_nothing_else(env) -> None:
    action = env.action_space.sample(np.random.default_rng(0))
    assert env.action_space.contains(action)
    assert not env.action_space.contains({"pose0": action["pose0"]})
    assert not env.action_space.contains(action | {"pose1": at(3, 0, 0)})


def test_a_recording_is_written_where_the_configuration_says(env, tmp_path) -> None:
    with pytest.raises(SimulationError, match="start_rec"):
        env.end_rec()
    env.start_rec("milk")
    env.step_simulation(100)
    assert env.end_rec() == tmp_path / "milk.npz"
    assert "object_1" in np.load(tmp_path / "milk.npz")["names"].tolist()


def test_a_way_through_the_table_is_refused_before_the_arm_moves(env) -> None:
    down = env.homej
    down[1] += 1.2
    with pytest.raises(SimulationError, match="the table"):
        env.movej(down)
    assert env.physics.joint_positions == pytest.approx(env.homej, abs=0.01)
