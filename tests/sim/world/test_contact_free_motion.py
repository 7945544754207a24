"""Where nothing touches anything the arm is set along its path, and all comes out as the dynamics would have it."""

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim import Environment
from grs_agents.sim.motion.pick_place import PickPlaceMotion


def scene_of(*assets: tuple[str, float, float, float], robot: str = "ur5e") -> Environment:
    def scene(task, env) -> None:
        for name, x, y, z in assets:
            env.add_object(name, at(x, y, z))

    env = Environment(task=Scripted(scene), robot=robot)
    env.reset()
    return env


def holding(*others: tuple[str, float, float, float], robot: str = "ur5e") -> Environment:
    """A block hangs 10 cm over the table."""
    env = scene_of(("block/block.urdf", 0.5, -0.2, 0.02), *others, robot=robot)
    hand = PickPlaceMotion(env.physics, env.collider_prisms, {1: "block"})
    assert hand.pick_and_lift(at(0.5, -0.2, 0.04), 0.1).placed
    return env


def straight_path(env: Environment, aside: float, steps: int) -> FloatArray:
    """Joint positions that move the tip along y, smoothly."""
    x, y, z = env.physics.tip_position
    share = np.linspace(0.0, 1.0, steps)
    share = share**3 * (10 - share * (15 - 6 * share))
    points = np.column_stack([np.full(steps, x), y + aside * share, np.full(steps, z)])
    return env.arm.solve_ik_tool_down(points, np.zeros(steps), env.physics.commanded_joint_positions)


def follow_by_dynamics(env: Environment, path: FloatArray) -> None:
    physics = env.physics
    speeds = np.gradient(path, physics.timestep, axis=0)
    for command in physics.compensate_joint_damping(path, speeds):
        physics.lead_arm(command, 1)


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_what_is_carried_comes_to_where_the_dynamics_bring_it_in_the_same_time(robot) -> None:
    ends, times = [], []
    for dynamic in (False, True):
        env = holding(robot=robot)
        path, begin = straight_path(env, 0.35, 250), env.physics.data.time
        (follow_by_dynamics if dynamic else lambda env, path: env.physics.follow_joint_path(path))(env, path)
        times.append(env.physics.data.time - begin)
        env.physics.step(60)
        assert env.physics.held_object_id == 1
        ends.append(env.get_object_pose(1))
    assert ends[0][0] == pytest.approx(ends[1][0], abs=0.003)
    assert transforms.angle_between(ends[0][1], ends[1][1]) < 0.02
    assert times[0] == pytest.approx(times[1], abs=0.02)


def test_the_arm_goes_along_its_path_without_dynamics_and_watchers_see_it_move_evenly() -> None:
    env = holding()
    physics, path = env.physics, straight_path(env, 0.35, 250)
    times, places = [], []

    def look() -> None:
        times.append(float(physics.data.time))
        places.append(env.get_object_pose(1)[0])

    physics.observer = look
    physics.follow_joint_path(path)
    assert physics.joint_positions == pytest.approx(path[-1], abs=1e-9)
    steps = np.diff(times) / physics.timestep
    assert steps.min() > 0 and steps.max() < 10
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    assert speeds.max() < 1.1 * 1.875 * 0.35 / (250 * physics.timestep)


def test_what_stands_in_the_way_is_met_as_the_dynamics_say() -> None:
    ends = []
    for dynamic in (False, True):
        env = holding(("HOPE/Milk.urdf", 0.5, 0.05, 0.095))
        before = np.array(env.get_object_pose(2)[0])
        path = straight_path(env, 0.3, 300)
        (follow_by_dynamics if dynamic else lambda env, path: env.physics.follow_joint_path(path))(env, path)
        env.physics.simulate_until_at_rest()
        ends.append(np.array(env.get_object_pose(2)[0]) - before)
    assert np.linalg.norm(ends[0]) > 0.03
    assert ends[0] == pytest.approx(ends[1], abs=0.03)


def test_a_path_that_begins_in_another_posture_is_reached_within_the_speed_limits() -> None:
    env = scene_of(robot="panda")
    physics = env.physics
    times, joints = [float(physics.data.time)], [physics.joint_positions]
    path = physics.commanded_joint_positions + np.linspace(0.2, 0.3, 200)[:, None]

    def look() -> None:
        times.append(float(physics.data.time))
        joints.append(physics.joint_positions)

    physics.observer = look
    physics.follow_joint_path(path)
    speeds = np.abs(np.diff(joints, axis=0) / np.diff(times)[:, None])
    assert (speeds <= env.arm.joint_speed_limits).all()
    assert physics.joint_positions == pytest.approx(path[-1], abs=1e-9)
