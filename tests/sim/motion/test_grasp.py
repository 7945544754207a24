import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim import Environment
from grs_agents.sim.motion.grasp import GraspSearchResult, find_grasp
from grs_agents.sim.motion.pick_place import PickPlaceMotion

URDF = """<robot name="thing"><link name="thing">
  <inertial><mass value="{mass}"/></inertial>
  <collision><geometry>{shape}</geometry></collision>
</link></robot>"""


@pytest.fixture
def single(tmp_path: Path):
    """An environment with one thing of a shape, a height and a mass."""

    def made(shape: str, size: list[float], x: float, y: float, mass: float = 0.1, robot: str = "ur5e") -> Environment:
        (tmp_path / "thing.urdf").write_text(URDF.format(mass=mass, shape=shape))
        asset = {
            "name": "thing.urdf",
            "kind": "thing",
            "category": "thing",
            "size": size,
            "mass": mass,
            "friction": 0.8,
            "color": "gray",
            "description": "a thing",
            "hollow": False,
            "fixture": False,
            "template": {},
        }
        (tmp_path / "manifest.json").write_text(json.dumps({"version": 1, "assets": [asset]}))
        scene = Scripted(lambda task, env: env.add_object("thing.urdf", at(x, y, size[2] / 2)))
        env = Environment(str(tmp_path), task=scene, robot=robot)
        env.reset()
        return env

    return made


def ball(radius: float) -> tuple[str, list[float]]:
    return f'<sphere radius="{radius}"/>', [2 * radius] * 3


def box(x: float, y: float, z: float) -> tuple[str, list[float]]:
    return f'<box size="{x} {y} {z}"/>', [x, y, z]


CUBE = box(0.05, 0.05, 0.05)


def test_the_cup_seals_on_a_ball_that_is_large_enough(single) -> None:
    env = single(*ball(0.016), 0.5, 0)
    x, y, z = env.get_object_pose(1)[0]
    assert env.pick_place(at(x, y, z + 0.016), at(0.45, 0.2, 0.04)).grasped == 1


def test_what_has_no_face_of_16_mm_is_picked_with_a_narrow_nozzle_that_holds_little(single) -> None:
    for shape, size in (box(0.01, 0.01, 0.01), box(0.06, 0.012, 0.012), ball(0.005)):
        env = single(shape, size, 0.5, 0, mass=0.02)
        top = find_grasp(env.physics, 1, env.object_prism(1)).point
        assert top is not None
        result = env.pick_place(at(*top), at(0.45, 0.2, size[2]))
        assert result.note == "placed", shape
        assert np.hypot(*np.subtract(env.get_object_pose(1)[0][:2], (0.45, 0.2))) < 0.02
    heavy = single(*box(0.012, 0.012, 0.012), 0.5, 0, mass=0.4)
    assert "N pulled, it holds 2.4 N" in heavy.pick_place(at(0.5, 0, 0.012), at(0.45, 0.2, 0.012)).note
    wide = single(*box(0.02, 0.02, 0.02), 0.5, 0, mass=0.4)
    assert wide.pick_place(at(0.5, 0, 0.02), at(0.45, 0.2, 0.02)).note == "placed"


def test_the_cup_finds_no_seal_on_a_small_ball_nor_on_an_edge(single) -> None:
    env = single(*ball(0.009), 0.5, 0)
    x, y, z = env.get_object_pose(1)[0]
    result = env.pick_place(at(x, y, z + 0.009), at(0.45, 0.2, 0.04))
    assert result.grasped is None
    assert "finds no seal on thing.urdf" in result.note
    assert result.trouble == "no_seal"
    assert find_grasp(env.physics, 1, env.object_prism(1)) == GraspSearchResult(None, trouble="no_seal")
    env = single(*box(0.04, 0.04, 0.04), 0.5, 0)
    assert "finds no seal" in env.pick_place(at(0.519, 0, 0.04), at(0.45, 0.2, 0.04)).note
    assert env.pick_place(at(0.51, 0, 0.04), at(0.45, 0.2, 0.04)).note == "placed"


def test_the_hold_is_where_the_cup_seals(single) -> None:
    env = single(*box(0.06, 0.03, 0.04), 0.5, 0)
    hold = find_grasp(env.physics, 1, env.object_prism(1))
    assert hold.point == pytest.approx((0.5, 0, 0.04), abs=0.002)


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
@pytest.mark.parametrize("mass", [0.05, 0.8, 1.2])
def test_what_is_light_enough_is_carried(single, mass, robot) -> None:
    env = single(*CUBE, 0.5, -0.2, mass, robot)
    assert env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05)).note == "placed"


@pytest.mark.parametrize("mass", [1.7, 3.0])
def test_what_is_too_heavy_slips_off_and_the_note_says_so(single, mass) -> None:
    env = single(*CUBE, 0.5, -0.2, mass)
    result = env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05))
    assert not result.placed
    assert f"({mass:.2g} kg) slipped off the cup: " in result.note and "it holds 15 N" in result.note
    assert env.get_object_pose(1)[0] == pytest.approx((0.5, -0.2, 0.025), abs=0.03)


def lift_and_plan_way_aside(env: Environment, point: tuple[float, float, float], steps: int) -> FloatArray:
    """Lift object 1 at a point; joint positions (steps, dof) that carry it 0.4 m to the side."""
    physics = env.physics
    assert PickPlaceMotion(physics, env.collider_prisms, {1: "thing"}).pick_and_lift(at(*point), 0.1).placed
    x, y, z = physics.tip_position
    share = np.linspace(0.0, 1.0, steps)
    share = share**3 * (10 - share * (15 - 6 * share))
    points = np.column_stack([np.full(steps, x), y + 0.4 * share, np.full(steps, z)])
    return env.arm.solve_ik_tool_down(points, np.zeros(steps), physics.commanded_joint_positions)


def carry_by_dynamics(env: Environment, point: tuple[float, float, float], look: Callable[[], None]) -> None:
    """Carry object 1 from a point to the side within a second, ``look`` at each step."""
    physics, path = env.physics, lift_and_plan_way_aside(env, point, 250)
    physics.observer = look
    for command in physics.compensate_joint_damping(path, np.gradient(path, physics.timestep, axis=0)):
        physics.lead_arm(command, 1)


def test_the_force_through_the_cup_is_what_accelerates_and_carries_the_object(single) -> None:
    env = single(*CUBE, 0.5, -0.2, 0.6)
    physics, forces, inertial = env.physics, list[float](), list[float]()
    velocity = np.full(3, np.nan)

    def look() -> None:
        start = physics.model.body_dofadr[physics.world.bodies[1]]
        now = np.array(physics.data.qvel[start : start + 3])
        acceleration = (now - velocity) / physics.timestep
        velocity[:] = now
        if np.isfinite(acceleration).all():
            forces.append(float(np.linalg.norm(physics.data.efc_force[:3])))
            inertial.append(float(np.linalg.norm(0.6 * (acceleration + np.array([0, 0, 9.81])))))

    carry_by_dynamics(env, (0.5, -0.2, 0.05), look)
    assert len(forces) > 200
    np.testing.assert_allclose(np.median(forces), 0.6 * 9.81, rtol=0.1)
    assert np.abs(np.subtract(forces, inertial)).max() < 0.2


@pytest.mark.parametrize(("mass", "kept"), [(0.1, True), (1.3, False)])
def test_what_is_carried_too_fast_for_its_weight_is_torn_off(single, mass: float, kept: bool) -> None:
    env = single(*CUBE, 0.5, -0.2, mass)
    env.physics.follow_joint_path(lift_and_plan_way_aside(env, (0.5, -0.2, 0.05), 70))
    assert (env.physics.held_object_id == 1) is kept


def test_watching_does_not_change_what_happens(single) -> None:
    ends = []
    for watched in (False, True):
        env = single(*CUBE, 0.5, -0.2, 1.7)
        env.physics.observer = (lambda: None) if watched else None
        env.pick_place(at(0.5, -0.2, 0.05), at(0.5, 0.2, 0.05))
        ends.append(np.array(env.physics.data.qpos))
    assert np.array_equal(*ends)


def test_the_cup_bears_the_moment_of_a_weight_beside_it(single) -> None:
    env = single(*box(0.12, 0.06, 0.05), 0.5, -0.2, 0.2)
    moments = list[float]()
    carry_by_dynamics(env, (0.53, -0.2, 0.05), lambda: moments.append(env.physics.cup.measure_load(1)[1]))
    np.testing.assert_allclose(np.median(moments), 0.2 * 9.81 * 0.03, rtol=0.15)


def test_what_bends_the_cup_too_hard_tips_off_and_no_such_point_is_offered(single) -> None:
    ridge = '</geometry></collision><collision><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.06 0.05"/>'
    plate, size = box(0.16, 0.06, 0.02)
    env = single(plate + ridge, size, 0.5, -0.2, 1.4)
    assert find_grasp(env.physics, 1, env.object_prism(1)) == GraspSearchResult(None, trouble="would_tip")
    result = env.pick_place(at(0.53, -0.2, 0.02), at(0.53, 0.2, 0.02))
    assert "tipped off the cup: " in result.note and "N m bent it, it bears 0.15 N m" in result.note
    assert result.trouble == "dropped"


def test_a_neighbour_in_the_notch_of_an_angle_is_beside_it_not_on_top(single) -> None:
    """The notch lies within the outline of the angle, whose legs have no face for the cup."""
    leg = '<box size="0.1 0.004 0.04"/></geometry><origin xyz="0 -0.048 0"/></collision><collision>'
    angle = f'{leg}<origin xyz="-0.048 0 0"/><geometry><box size="0.004 0.1 0.04"/>'
    root = single(angle, [0.1, 0.1, 0.04], 0.5, 0).assets_root

    def scene(task, env) -> None:
        env.add_object("thing.urdf", at(0.5, 0, 0.02), "fixed")
        env.add_object("block/block.urdf", at(0.49, -0.01, 0.02), "fixed")

    env = Environment(root, task=Scripted(scene))
    env.reset()
    found = find_grasp(env.physics, 1, env.object_prism(1))
    assert found.hindered_by == (2,)
    assert not found.covered_by
