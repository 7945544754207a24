from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_scenes import Scripted, at

from grs_agents.base.content import content_root
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.sim import Environment, find_task_class, run_oracle
from grs_agents.sim.arms.arm_model import ArmModel
from grs_agents.sim.arms.registry import get_arm
from tests.gantry import GANTRY


@pytest.fixture(scope="module")
def gantry(tmp_path_factory) -> str:
    file = tmp_path_factory.mktemp("arm") / "gantry.xml"
    file.write_text(GANTRY)
    return str(file)


@pytest.mark.parametrize("turn", [0.0, 1.57, 3.0, np.pi, -2.5])
def test_a_wrist_of_one_turn_serves_however_the_flange_is_turned(turn, tmp_path) -> None:
    site = f'<site name="attachment_site" pos="0 0 0.02" quat="{np.cos(turn / 2)} 0 0 {np.sin(turn / 2)}"/>'
    source = GANTRY.replace('range="-6 6"', 'range="-3.14 3.14"')
    source = source.replace('<site name="attachment_site" pos="0 0 0.02"/>', site)
    file = tmp_path / "arm.xml"
    file.write_text(source)
    env = block_at(0.4, -0.3, str(file))
    half = np.sin(np.pi / 4)
    result = env.pick_place(at(0.4, -0.3, 0.04), ((0.5, 0.3, 0.04), (0.0, 0.0, half, half)))
    assert result.note == "placed"
    assert abs(np.dot(env.get_object_pose(1)[1], (0.0, 0.0, half, half))) > 0.999
    assert min(env.arm.home_joints[-1] + 3.14, 3.14 - env.arm.home_joints[-1]) > 1.5


def test_the_place_of_a_base_on_the_table_and_its_turn_do_not_count(gantry, tmp_path) -> None:
    file = tmp_path / "arm.xml"
    stand = '<body name="stand" pos="-0.469 0.5 0" quat="0.6 0 0 0.8"><body name="rail"'
    file.write_text(GANTRY.replace('<body name="rail"', stand).replace("</worldbody>", "</body></worldbody>"))
    moved, plain, joints = get_arm(str(file)), get_arm(gantry), np.array([0.5, 0.1, -0.6, 0.3])
    assert moved.home_joints == pytest.approx(plain.home_joints)
    for own, same in zip(moved.tip_pose(joints), plain.tip_pose(joints), strict=True):
        assert own == pytest.approx(same, abs=1e-9)


def test_an_arm_without_a_keyframe_waits_far_from_its_limits(tmp_path) -> None:
    file, start = tmp_path / "arm.xml", GANTRY.index("<keyframe>")
    end = GANTRY.index("</keyframe>") + len("</keyframe>")
    file.write_text((GANTRY[:start] + GANTRY[end:]).replace('range="-6 6"', 'range="-1 12"'))
    arm = get_arm(str(file))
    assert arm.home_joints[-1] == pytest.approx(5.5, abs=1.0)
    assert "up to 0.65 m high, with the tool down" in arm.describe_reach()


@pytest.fixture(params=["ur5e", "panda", "gantry"])
def robot(request, gantry) -> str:
    return gantry if request.param == "gantry" else request.param


def block_at(x: float, y: float, robot: str, turn: float = 0.0) -> Environment:
    env = Environment(task=Scripted(lambda task, env: env.add_object("block/block.urdf", at(x, y, 0.02))), robot=robot)
    env.reset()
    return env


@pytest.mark.parametrize(
    ("start", "end", "turn"),
    [((0.4, -0.3), (0.5, 0.3), 0.0), ((0.55, 0.2), (0.45, -0.1), 2.0), ((0.5, 0), (0.5, 0.25), -3)],
)
def test_every_arm_picks_a_block_and_places_it_turned(
    robot: str, start: tuple[float, float], end: tuple[float, float], turn: float
) -> None:
    env = block_at(*start, robot)
    quaternion = (0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2)))
    result = env.pick_place(at(*start, 0.04), ((*end, 0.04), quaternion))
    position, rotation = env.get_object_pose(1)
    assert result.note == "placed"
    assert position == pytest.approx((*end, 0.02), abs=0.004)
    assert abs(np.dot(rotation, quaternion)) > 0.999
    assert env.arm.is_path_within_limits(env.physics.joint_positions[None])


def test_the_same_seed_gives_the_same_motion_bit_for_bit(robot) -> None:
    states = []
    for _ in range(2):
        env = block_at(0.4, -0.2, robot)
        env.pick_place(at(0.4, -0.2, 0.04), at(0.5, 0.2, 0.04))
        states.append(np.array(env.physics.data.qpos))
    assert np.array_equal(*states)


# Nearer to the base, or turned further, a joint may come to its limit though the tip can be brought there.
@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.floats(0.38, 0.65), st.floats(-1.0, 1.0), st.floats(0.01, 0.35), st.floats(-1.2, 1.2))
def test_where_the_panda_reaches_its_joints_bring_the_tip_and_keep_their_limits(radius, bearing, height, yaw) -> None:
    arm, tip = get_arm("panda"), np.array([[radius * np.cos(bearing), radius * np.sin(bearing), height]])
    way = np.linspace(ArmModel(arm.add).tip_pose(arm.home_joints)[0], tip[0], 40)
    path = arm.solve_ik_tool_down(way, np.linspace(0, yaw, 40))
    assert arm.reachable_mask(tip)[0]
    assert arm.is_path_within_limits(path)
    point, rotation = ArmModel(arm.add).tip_pose(path[-1])
    np.testing.assert_allclose(point, tip[0], atol=2e-4)
    np.testing.assert_allclose(rotation[:2, 0], (np.cos(yaw), np.sin(yaw)), atol=1e-3)
    for row, wanted in zip(path, way, strict=True):
        np.testing.assert_allclose(ArmModel(arm.add).tip_pose(row)[0], wanted, atol=6e-3)


@given(st.floats(0.22, 0.85), st.floats(-1.5, 1.5), st.floats(0.001, 0.5), st.floats(-3, 3))
def test_wherever_the_ur5e_reaches_it_is_clear_of_the_table_and_itself(radius, bearing, height, yaw) -> None:
    arm, tip = get_arm("ur5e"), np.array([[radius * np.cos(bearing), radius * np.sin(bearing), height]])
    if arm.reachable_mask(tip)[0]:
        assert arm.first_collision_along(arm.solve_ik_tool_down(tip, np.array([yaw]))) is None


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_the_tool_tilts(name) -> None:
    arm = get_arm(name)
    lean = np.array([[1, 0, 0], [0, np.cos(0.5), -np.sin(0.5)], [0, np.sin(0.5), np.cos(0.5)]])
    path = arm.solve_ik_for_poses(np.array([[0.45, 0.1, 0.2]]), lean[None])
    point, rotation = ArmModel(arm.add).tip_pose(path[0])
    np.testing.assert_allclose(point, (0.45, 0.1, 0.2), atol=2e-4)
    np.testing.assert_allclose(rotation, lean, atol=1e-3)


def test_no_arm_reaches_far_behind_or_beyond_its_limits(robot) -> None:
    arm = get_arm(robot)
    assert arm.reachable_mask(np.array([[0.45, 0.1, 0.1], [1.3, 0, 0.1], [0.02, 0, 0.1]])).tolist() == [
        True,
        False,
        False,
    ]
    assert np.isnan(arm.solve_ik_tool_down(np.array([[1.6, 0, 0.1]]), np.zeros(1))).all()
    assert not arm.is_path_within_limits(arm.upper_joint_limits[None] + 0.1)
    assert 0 < arm.nearest < 0.45 < arm.farthest


def test_an_arm_that_points_into_the_table_or_into_itself_is_not_clear() -> None:
    arm = get_arm("ur5e")
    down = arm.home_joints.copy()
    down[1] += 1.2
    gap = arm.first_collision_along(np.linspace(arm.home_joints, down, 50))
    assert gap is not None
    assert "the table" in str(gap)
    assert arm.first_collision_along(arm.home_joints[None]) is None
    folded = arm.first_collision_along(np.array([[0.0, -np.pi / 2, 3.05, 0.0, 0.0, 0.0]]))
    assert folded is not None
    assert "its own" in str(folded)


def test_a_users_arm_keeps_its_limits_and_torques_and_its_gripper_stands_still(gantry) -> None:
    env = block_at(0.5, 0.0, gantry)
    model = env.physics.model
    assert env.arm.dof == 4
    assert env.arm.lower_joint_limits == pytest.approx((-0.2, -0.6, -1.1, -6))
    assert model.actuator_forcerange[2].tolist() == [-300, 300]
    assert env.observation["color"][0].shape == (480, 640, 3)


def test_two_fingers_at_the_end_of_a_users_arm_are_no_joints_of_it(tmp_path) -> None:
    finger = (
        '<body name="{0}" pos="0.05 0 0"><joint name="{0}" type="slide" range="0 0.02"/><geom size="0.005"/></body>'
    )
    file = tmp_path / "arm.xml"
    start, rest = GANTRY.split('<site name="attachment_site" pos="0 0 0.02"/>')
    file.write_text(start + finger.format("second") + rest.replace('"0.4 0 -0.5 0 0"', '"0.4 0 -0.5 0 0 0"'))
    env = block_at(0.4, -0.3, str(file))
    assert env.arm.dof == 4
    assert env.pick_place(at(0.4, -0.3, 0.04), at(0.5, 0.3, 0.04)).note == "placed"


def test_degrees_in_a_users_file_are_degrees(tmp_path) -> None:
    file = tmp_path / "degrees.xml"
    file.write_text(GANTRY.replace('<compiler angle="radian"/>', "").replace('"-6 6"', '"-340 340"'))
    assert get_arm(str(file)).upper_joint_limits[3] == pytest.approx(np.deg2rad(340))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco", "no MJCF"),
        ("<mujoco><worldbody/></mujoco>", "no body"),
        ("<mujoco><worldbody><body name='a'><geom size='.1'/></body></worldbody></mujoco>", "hinge or slide"),
        ("<mujoco><worldbody><body><freejoint name='f'/><geom size='.1'/></body></worldbody></mujoco>", "neither"),
        ("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>", "no name"),
        ("<mujoco><worldbody><body><joint name='a'/><geom size='.1'/></body></worldbody></mujoco>", "straight down"),
    ],
)
def test_what_a_users_file_lacks_is_named(tmp_path, text, words) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(text)
    with pytest.raises(InputError, match=words):
        Environment(robot=str(file))


def test_a_robot_that_is_not_there_is_named_with_those_that_are(tmp_path) -> None:
    with pytest.raises(UnknownNameError, match="panda"):
        Environment(robot="pandas")
    with pytest.raises(InputError, match="cannot be read"):
        Environment(robot=str(tmp_path / "none.xml"))


@pytest.mark.parametrize("example", ["stack_blocks", "put_in_bowls"])
def test_the_panda_solves_example_programs(example) -> None:
    program = ModuleType(example)
    exec((content_root() / "prompts" / "examples" / f"{example}.py").read_text("utf-8"), vars(program))
    task = find_task_class(program)()
    env = Environment(task=task, robot="panda", seed=1)
    env.reset()
    run_oracle(env, task)
    assert env.current_episode.outcome == "success"
    assert env.current_episode.strict > 0.99
