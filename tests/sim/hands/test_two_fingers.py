"""Hands with fingers: on each arm, held by contact alone, told by name."""

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base.config.load import load_config
from grs_agents.base.errors import ConfigError, UnknownNameError
from grs_agents.library.library import Library
from grs_agents.sim import Environment, TaskInstance
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.hands.registry import HANDS, get_hand
from grs_agents.sim.hands.two_fingers import FRANKA_HAND, ROBOTIQ_2F85
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject, hash_instance, parse_instance_json
from grs_agents.sim.rendering.robot_meshes import build_robot_meshes
from grs_agents.sim.tabletop_episode import open_instance_episode
from grs_agents.sim.world.spec import TIMESTEP

ROBOTS = [(robot, hand) for robot in ("ur5e", "panda") for hand in ("franka_hand", "robotiq_2f85")]


def one_block(robot: str = "panda", hand: str = "franka_hand") -> Environment:
    env = Environment(
        task=Scripted(lambda task, env: env.add_object("block/block.urdf", at(0.5, 0.1, 0.02))), robot=robot, hand=hand
    )
    env.reset()
    return env


@pytest.mark.parametrize(("robot", "hand"), ROBOTS)
def test_fingers_hold_by_contact_alone_and_set_down_to_a_millimetre(robot: str, hand: str) -> None:
    env = one_block(robot, hand)
    assert env.physics.model.neq == 1  # the coupling of the fingers: no weld to any object
    grasp = env.end_effector.find_grasps(env.physics, 1, env.object_prism(1), ()).poses[0]
    lifted = env.pick_place_motion.pick_and_lift(grasp, 0.1)
    assert lifted.placed
    assert env.physics.fingers.pads_touching(1) == 2
    assert env.get_object_pose(1)[0][2] == pytest.approx(0.14, abs=0.002)
    env.reset()
    (x, y, z), rotation = grasp
    assert env.pick_place(grasp, ((x - 0.1, y - 0.3, z), rotation)).note == "placed"
    assert env.get_object_pose(1)[0] == pytest.approx((0.4, -0.2, 0.02), abs=0.001)
    assert env.physics.fingers.held is None
    assert not env.physics.unheld_objects_touching_robot()


def test_fingers_that_hold_open_at_once() -> None:
    env = one_block()
    fingers, physics = env.physics.fingers, env.physics
    grasp = env.end_effector.find_grasps(physics, 1, env.object_prism(1), ()).poses[0]
    assert env.pick_place_motion.pick_and_lift(grasp, 0.005).placed
    width = fingers.width
    fingers.move_towards(1.0, 100)
    physics.step(100)
    assert (fingers.held, fingers.commanded_width) == (1, 0.0)  # the block keeps the pads apart
    for _ in range(25):
        fingers.move_towards(-1.0, 4)
        physics.step(4)
    assert fingers.width > width + 0.005
    assert fingers.pads_touching(1) == 0


@pytest.mark.parametrize(("robot", "hand"), ROBOTS)
def test_fingers_that_lose_what_they_hold_do_not_snap(robot: str, hand: str) -> None:
    env = one_block(robot, hand)
    fingers, physics = env.physics.fingers, env.physics
    grasp = env.end_effector.find_grasps(physics, 1, env.object_prism(1), ()).poses[0]
    assert env.pick_place_motion.pick_and_lift(grasp, 0.05).placed
    fingers.command(0.0, fingers.hand.gripping_force(1.0), closing=True)
    physics.step(20)
    widths = [fingers.width]
    physics.observer = lambda: widths.append(fingers.width)
    physics.teleport_object(1, at(0.5, -0.3, 0.02))
    physics.step(60)
    assert widths[-1] < widths[0] - 0.02
    assert np.diff(widths).min() > -2 * 0.25 * physics.timestep  # 0.25 m/s of each finger


@pytest.mark.parametrize("hand", [FRANKA_HAND, ROBOTIQ_2F85])
def test_the_fingers_open_as_wide_as_the_data_sheet_says(hand) -> None:
    env = one_block(hand=hand.name)
    physics = env.physics
    pads = [physics.data.geom_xpos[physics.model.geom(name).id] for name in ("left_pad", "right_pad")]
    apart = float(np.linalg.norm(pads[0] - pads[1])) - 2 * hand.pad[1]
    assert apart == pytest.approx(hand.stroke, abs=1e-4) == pytest.approx({0.08: 0.08, 0.085: 0.085}[hand.stroke])
    tip, flange = physics.data.site("tip").xpos, physics.data.body("hand").xpos
    assert float(np.linalg.norm(tip - flange)) == pytest.approx(hand.length)


def test_a_hand_without_a_cup_says_so() -> None:
    env = one_block()
    with pytest.raises(SimulationError, match="franka_hand has no suction cup"):
        _ = env.physics.cup
    with pytest.raises(SimulationError, match="suction has no fingers"):
        _ = one_block(hand="suction").physics.fingers


def test_hands_are_chosen_by_name() -> None:
    with pytest.raises(UnknownNameError, match="franka"):
        get_hand("frankahand")
    assert load_config(None, ["hand=franka_hand"]).config.hand == "franka_hand"
    with pytest.raises(ConfigError, match="suction, franka_hand, robotiq_2f85, or own"):
        load_config(None, ["hand=three_fingers"])
    assert load_config(None, ["hand=own", "robot=arm.xml"]).config.hand == "own"


def test_an_instance_names_its_hand_only_if_it_is_no_cup() -> None:
    block = InstanceObject(id=1, asset="block/block.urdf", pose=at(0.5, 0.1, 0.02), category="rigid")
    plain = TaskInstance(task="", seed=0, max_steps=1, timestep=TIMESTEP, objects=(block,), goals=())
    fingers = plain.model_copy(update={"hand": "franka_hand", "robot": "panda"})
    assert "hand" not in plain.model_dump_json()
    assert parse_instance_json(fingers.model_dump_json()) == fingers
    assert hash_instance(fingers) != hash_instance(plain.model_copy(update={"robot": "panda"}))
    episode = open_instance_episode(fingers, Library())
    episode.reset()
    assert episode.sim.end_effector.tool == "fingers"
    assert episode.sim.arm.hand is FRANKA_HAND


def test_pushing_takes_the_spatula_in_place_of_the_fingers() -> None:
    push = TaskInstance(
        task="", seed=0, max_steps=1, timestep=TIMESTEP, objects=(), goals=(), primitive="push", hand="franka_hand"
    )
    episode = open_instance_episode(push, Library())
    episode.reset()
    assert episode.sim.end_effector.tool == "spatula"
    assert "left_finger" not in episode.sim.arm.link_names


@pytest.mark.parametrize(("robot", "hand"), ROBOTS)
def test_viewers_draw_the_fingers(robot: str, hand: str) -> None:
    arm = get_arm(robot, hand)
    assert {"hand", "left_finger", "right_finger"} <= build_robot_meshes(arm).keys() & set(arm.link_names)


def test_configuration_accepts_the_names_of_all_hands() -> None:
    assert [load_config(None, [f"hand={name}"]).config.hand for name in HANDS] == list(HANDS)
    with pytest.raises(ConfigError) as refused:
        load_config(None, ["hand=claw"])
    assert all(name in str(refused.value) for name in HANDS)
