"""The controller that environments, recorders and the expert share."""

import numpy as np
import pytest
from sim_scenes import Scripted, at, pose_goal

from grs_agents.sim import Environment, SimulationError, run_oracle
from grs_agents.sim.motion.joint_controller import JointController


def scene_with_block(robot: str = "ur5e") -> tuple[Environment, Scripted]:
    def scene(task, env) -> None:
        pose_goal(task, env.add_object("block/block.urdf", at(0.5, -0.2, 0.02)), at(0.45, 0.2, 0.02))

    task = Scripted(scene)
    env = Environment(task=task, robot=robot)
    env.reset()
    return env, task


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_what_the_expert_reached_one_period_later_does_its_episode_again(robot) -> None:
    env, task = scene_with_block(robot)
    looks = [(env.physics.data.time, env.physics.joint_positions, False)]

    def look() -> None:
        looks.append((env.physics.data.time, env.physics.joint_positions, env.physics.held_object_id is not None))

    env.physics.observer = look
    run_oracle(env, task)
    times, positions, holding = (np.array(column) for column in zip(*looks, strict=True))
    at = np.arange(times[0], times[-1] + 1e-6, env.physics.timestep)
    joints = np.column_stack([np.interp(at, times, column) for column in positions.T])
    held = holding[np.searchsorted(times, at - 1e-6)]
    targets, suction = joints[10::10], held[10::10]
    taken = int(np.argmax(held))
    targets[taken // 10] = joints[taken - 1]
    suction[np.argmax(suction) - 8 : np.argmax(suction)] = True

    again, same_task = scene_with_block(robot)
    controller = JointController(again.physics)
    for target, suck in zip(targets, suction, strict=True):
        controller.apply(target, bool(suck))
    again.physics.simulate_until_at_rest()
    same_task.reward()
    assert again.current_episode.strict == 1.0
    assert again.get_object_pose(1)[0] == pytest.approx(env.get_object_pose(1)[0], abs=0.006)


def test_a_target_too_far_is_approached_straight_as_fast_as_the_joints_can() -> None:
    env, _ = scene_with_block()
    controller, before = JointController(env.physics), env.physics.joint_positions
    target = before + np.array([1.0, 0.2, 0.0, 0.0, 0.0, 50.0])
    controller.apply(target, suction=False)
    moved = controller.reference - before
    assert np.abs(moved).max() == pytest.approx(np.pi / 25)
    assert moved == pytest.approx(
        (env.arm.upper_joint_limits.clip(max=target) - before) * moved[5] / (2 * np.pi - before[5])
    )


def test_the_arm_is_not_led_into_the_table() -> None:
    env, _ = scene_with_block()
    controller = JointController(env.physics)
    for _ in range(60):
        controller.apply(controller.reference + np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0]), suction=False)
    assert controller.blocked
    assert 0.0 < env.physics.tip_position[2] < 0.1
    controller.apply(controller.reference - np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0]), suction=False)
    assert not controller.blocked


def test_a_rate_that_does_not_divide_the_physics_steps_is_refused() -> None:
    physics = scene_with_block()[0].physics
    assert JointController(physics, 50.0).steps == 5
    with pytest.raises(SimulationError, match="30 Hz is not a whole number"):
        JointController(physics, 30.0)


def test_fingers_close_on_a_block_hold_it_and_open_to_the_share_that_they_are_told() -> None:
    env = Environment(
        task=Scripted(lambda task, env: env.add_object("block/block.urdf", at(0.5, -0.2, 0.02))),
        robot="ur5e",
        hand="robotiq_2f85",
    )
    env.reset()
    physics, controller = env.physics, JointController(env.physics)

    def go(height: float, suction: float, periods: int) -> None:
        target = env.arm.solve_ik_tool_down(np.array([[0.5, -0.2, height]]), np.zeros(1), controller.reference)[0]
        for _ in range(periods):
            controller.apply(target, suction)

    go(0.15, -1.0, 60)
    go(0.008, -0.7, 40)
    assert physics.fingers.width == pytest.approx(0.7 * 0.085, abs=1e-3)
    go(0.008, 1.0, 25)
    assert physics.held_object_id == 1
    go(0.12, 1.0, 50)
    assert env.get_object_pose(1)[0][2] == pytest.approx(0.02 + 0.112, abs=0.004)
    go(0.12, -1.0, 40)
    assert physics.held_object_id is None
    assert env.get_object_pose(1)[0][2] < 0.03
