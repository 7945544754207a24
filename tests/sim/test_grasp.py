import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base import Pose
from grs_agents.library import ObjectModel, Shape
from grs_agents.sim import Environment, InstanceObject
from grs_agents.sim.grasp import find_hold


def single(shape: Shape, pose: Pose, mass: float = 0.1, robot: str = "ur5e") -> Environment:
    half = [extent / 2 for extent in shape.size] if shape.kind == "box" else [shape.size[0]] * 3
    low, high = [-extent for extent in half], half
    model = ObjectModel(colliders=(shape,), visuals=(shape,), mass=mass, friction=0.8, bounds=(low, high))
    item = InstanceObject(id=0, asset="thing", shapes=model, pose=pose)
    env = Environment(task=Scripted(lambda task, env: env.insert(item)), robot=robot)
    env.reset()
    return env


def sphere(radius: float) -> Shape:
    return Shape(kind="sphere", size=(radius,))


def test_the_cup_seals_on_a_ball_that_is_large_enough() -> None:
    env = single(sphere(0.016), at(0.5, 0, 0.016))
    x, y, z = env.get_object_pose(1)[0]
    assert env.pick_place(at(x, y, z + 0.016), at(0.45, 0.2, 0.04)).grasped == 1


def test_the_cup_finds_no_seal_on_a_small_ball_nor_on_an_edge() -> None:
    env = single(sphere(0.009), at(0.5, 0, 0.009))
    x, y, z = env.get_object_pose(1)[0]
    result = env.pick_place(at(x, y, z + 0.009), at(0.45, 0.2, 0.04))
    assert result.grasped is None
    assert "finds no seal on thing" in result.note
    env = single(Shape(kind="box", size=(0.04, 0.04, 0.04)), at(0.5, 0, 0.02))
    assert "finds no seal" in env.pick_place(at(0.519, 0, 0.04), at(0.45, 0.2, 0.04)).note
    assert env.pick_place(at(0.51, 0, 0.04), at(0.45, 0.2, 0.04)).note == "placed"


def test_the_hold_is_where_the_cup_seals() -> None:
    env = single(Shape(kind="box", size=(0.06, 0.03, 0.04)), at(0.5, 0, 0.02))
    hold = find_hold(env.physics, 1, env.get_object_pose(1)[0], env.outline(1))
    assert hold.point == pytest.approx((0.5, 0, 0.04), abs=0.002)


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
@pytest.mark.parametrize("mass", [0.05, 0.8, 1.2])
def test_what_is_light_enough_is_carried(mass, robot) -> None:
    env = single(Shape(kind="box", size=(0.05, 0.05, 0.05)), at(0.5, -0.2, 0.025), mass, robot)
    assert env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05)).note == "placed"


@pytest.mark.parametrize("mass", [1.7, 3.0])
def test_what_is_too_heavy_slips_off_and_the_note_says_so(mass) -> None:
    env = single(Shape(kind="box", size=(0.05, 0.05, 0.05)), at(0.5, -0.2, 0.025), mass)
    result = env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05))
    assert not result.placed
    assert f"({mass:.2g} kg) slipped off the cup, which holds 15 N" in result.note
    assert env.get_object_pose(1)[0] == pytest.approx((0.5, -0.2, 0.025), abs=0.03)


def test_the_force_through_the_cup_is_what_accelerates_and_carries_the_object() -> None:
    env = single(Shape(kind="box", size=(0.05, 0.05, 0.05)), at(0.5, -0.2, 0.025), 0.6)
    physics, forces, inertial = env.physics, list[float](), list[float]()
    velocity = np.zeros(3)

    def look() -> None:
        start = physics.model.body_dofadr[physics.world.bodies[1]]
        now = np.array(physics.data.qvel[start : start + 3])
        acceleration = (now - velocity) / physics.timestep
        velocity[:] = now
        lifted = physics.pose(1)[0][2] > 0.035
        if physics.held == 1 and lifted:
            forces.append(float(np.linalg.norm(physics.cup_force())))
            inertial.append(float(np.linalg.norm(0.6 * (acceleration + np.array([0, 0, 9.81])))))

    physics.observer = look
    assert env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05)).placed
    assert len(forces) > 100
    np.testing.assert_allclose(np.median(forces), 0.6 * 9.81, rtol=0.1)
    assert np.abs(np.subtract(forces, inertial)).max() < 0.5


def test_watching_does_not_change_what_happens() -> None:
    ends = []
    for watched in (False, True):
        env = single(Shape(kind="box", size=(0.05, 0.05, 0.05)), at(0.5, -0.2, 0.025), 1.7)
        env.physics.observer = (lambda: None) if watched else None
        env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05))
        ends.append(np.array(env.physics.data.qpos))
    assert np.array_equal(*ends)
