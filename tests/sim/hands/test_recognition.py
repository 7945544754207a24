"""The hand in a user's own file: recognised, mounted as two fingers, or refused with the reason."""

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import OwnHandConfig
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.runs.program_check import open_check_order
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder, open_run
from grs_agents.sim import Environment
from grs_agents.sim.arms.arm_files import copy_arm_files
from grs_agents.sim.arms.mjcf_arm import recognise_own_hand
from grs_agents.sim.arms.registry import get_arm
from tests.gantry import GANTRY

_FINGER = '<geom type="box" size="0.01 0.0075 0.024" pos="0 {y} 0.024" mass="0.02"/>'
_SLIDES = (
    '<body name="hand" pos="0 0 0.02"><geom type="box" size="0.03 0.1 0.03" pos="0 0 0.03" mass="0.5"/>'
    '<body name="left" pos="0 0 0.058"><joint name="finger_joint1" type="slide" axis="0 1 0" range="0 0.04"/>'
    + _FINGER.format(y=0.0075)
    + '</body><body name="right" pos="0 0 0.058" quat="0 0 0 1">'
    '<joint name="finger_joint2" type="slide" axis="0 1 0" range="0 0.04"/>'
    + _FINGER.format(y=0.0075)
    + "</body></body>"
)
_START, _REST = GANTRY.split('<site name="attachment_site" pos="0 0 0.02"/>')
_AFTER_FINGER = _REST.split("</body>", 1)[1].replace("0.4 0 -0.5 0 0", "0.4 0 -0.5 0 0 0")
_PARALLEL = _START + _SLIDES + _AFTER_FINGER
_COUPLED = _PARALLEL.replace(
    "<actuator>",
    '<equality><joint joint1="finger_joint1" joint2="finger_joint2"/></equality>'
    '<tendon><fixed name="split"><joint joint="finger_joint1" coef="0.5"/><joint joint="finger_joint2" coef="0.5"/>'
    '</fixed></tendon><actuator><general tendon="split" ctrlrange="0 255" gainprm="0.015" biastype="affine" '
    'biasprm="0 -100 -10"/>',
)
_JAW = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="rail" pos="0 0 1.2">
      <joint name="x" type="slide" axis="1 0 0" range="-0.2 0.9"/>
      <geom type="box" size="0.05 0.05 0.02" mass="3"/>
      <body name="carriage">
        <joint name="y" type="slide" axis="0 1 0" range="-0.6 0.6"/>
        <geom type="box" size="0.05 0.05 0.02" mass="1"/>
        <body name="mast">
          <joint name="z" type="slide" axis="0 0 1" range="-1.1 0"/>
          <geom type="capsule" fromto="0 0 -0.04 0 0 0" size="0.02" mass="0.5"/>
          <body name="gripper" pos="0 0 -0.06">
            <joint name="turn" axis="0 0 1" range="-6 6"/>
            <geom type="box" size="0.03 0.02 0.02" pos="0.01 0 -0.02" mass="0.2"/>
            <geom type="box" size="0.004 0.01 0.035" pos="-0.004 0 -0.07" mass="0.05"/>
            <body name="jaw" pos="0.03 0 -0.03">
              <joint name="gripper" axis="0 1 0" range="-0.7 0.1"/>
              <geom type="box" size="0.004 0.01 0.02" pos="-0.026 0 -0.055" mass="0.02"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <keyframe><key qpos="0.4 0 -0.5 0 0"/></keyframe>
</mujoco>
"""
_HINGES = _PARALLEL.replace('type="slide" axis="0 1 0" range="0 0.04"', 'axis="-1 0 0" range="0 0.6"')


def write(folder, text):
    file = folder / "arm.xml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("text", [_PARALLEL, _COUPLED])
def test_slides_with_and_without_a_tendon_are_recognised(tmp_path, text) -> None:
    own = recognise_own_hand(write(tmp_path, text))
    assert str(own) == "hand: two fingers, opens 80 mm, by joints finger_joint1, finger_joint2"
    assert own.hand.length == pytest.approx(0.106)
    assert own.hand.depth == pytest.approx(0.106 - 0.06 - 0.004)
    assert own.hand.pad[0] == pytest.approx(0.01)


def test_hinges_that_close_tips_on_each_other_are_recognised(tmp_path) -> None:
    own = recognise_own_hand(write(tmp_path, _HINGES))
    assert 0.015 < own.hand.stroke < 0.06  # of the lower ends of the pads, which tilt
    assert own.hand.length == pytest.approx(0.106, abs=0.01)


def test_one_jaw_that_closes_on_a_fixed_one_is_a_hand_and_no_joint_of_the_arm(tmp_path) -> None:
    file = write(tmp_path, _JAW)
    own = recognise_own_hand(file)
    assert own.joints == ("gripper",)
    assert 0.03 < own.hand.stroke < 0.06
    assert own.position[2] - own.hand.length == pytest.approx(-0.105, abs=0.001)
    for hand in ("own", "suction"):  # the cup points as the jaws do
        arm = get_arm(str(file), hand)
        assert arm.dof == 4
        assert arm.can_reach_point((0.5, 0.1, 0.05))


def test_a_last_link_without_a_jaw_beside_it_is_a_joint_of_the_arm(tmp_path) -> None:
    link = _JAW.replace('<geom type="box" size="0.004 0.01 0.035" pos="-0.004 0 -0.07" mass="0.05"/>', "")
    with pytest.raises(
        InputError, match="nothing moves beyond its body 'jaw'; as a jaw its last link fails: joints grip"
    ):
        recognise_own_hand(write(tmp_path, link))


def test_a_description_tells_the_fingers_that_are_not_recognised(tmp_path) -> None:
    file = write(tmp_path, _HINGES.replace(' range="0 0.6"', ""))
    with pytest.raises(InputError, match="2 joints beyond the arm are driven by no actuator"):
        recognise_own_hand(file)
    hand = OwnHandConfig(joints=("finger_joint2", "finger_joint1"), open=(0.6, 0.6), closed=(0, 0), tcp=(0, 0, 0.1))
    copy = copy_arm_files(file, tmp_path / "run", hand)
    assert copy is not None
    own = recognise_own_hand(copy)
    assert own.hand.stroke == pytest.approx(recognise_own_hand(write(tmp_path, _HINGES)).hand.stroke)
    assert own.hand.length == pytest.approx(0.1)
    assert get_arm(str(copy), "own").dof == 4


def test_a_description_of_no_hand_is_refused(tmp_path) -> None:
    hand = OwnHandConfig(joints=("thumb",), open=(1,), closed=(0,))
    copy = copy_arm_files(write(tmp_path, _PARALLEL), tmp_path / "run", hand)
    with pytest.raises(InputError, match="there is no joint 'thumb'; name joints of x, y, z, turn, finger_joint1"):
        get_arm(str(copy), "own")
    with pytest.raises(ConfigError, match="2 joints, 1 open and 2 closed positions"):
        load_config(None, ["robot=arm.xml", 'own_hand={joints = ["a", "b"], open = [1], closed = [0, 0]}'])


def test_fingers_of_unequal_length_and_without_names_are_recognised(tmp_path) -> None:
    short = 'size="0.01 0.0075 0.024" pos="0 0.0075 0.024"'
    own = recognise_own_hand(write(tmp_path, _PARALLEL.replace(short, short.replace("0.024", "0.2"), 1)))
    assert own.hand.length == pytest.approx(0.106) and own.hand.stroke == pytest.approx(0.08)
    (tmp_path / "unnamed").mkdir()
    unnamed = _PARALLEL.replace('name="finger_joint1" ', "").replace("finger_joint2", "finger")
    unnamed = unnamed.replace('<body name="hand"', "<body").replace("mast", "carrier")
    file = write(tmp_path / "unnamed", unnamed)
    assert recognise_own_hand(file).joints == ("finger_1", "finger")
    assert get_arm(str(file), "own").dof == 4


def test_a_file_without_bounds_on_its_fingers_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="finger_joint2 move farther than 100 rad or m"):
        recognise_own_hand(write(tmp_path, _PARALLEL.replace('range="0 0.04"', 'range="0 inf"')))
    for fields in ("open = [inf], closed = [0]", "open = [1], closed = [0], tcp = [0, 0, nan]"):
        with pytest.raises(ConfigError, match="finite number"):
            load_config(None, ["robot=arm.xml", f'own_hand={{joints = ["a"], {fields}}}'])


def test_a_description_is_written_into_any_form_of_a_file_but_not_beside_another(tmp_path) -> None:
    hand = OwnHandConfig(joints=("finger_joint1", "finger_joint2"), open=(0.04, 0.04), closed=(0, 0), tcp=(0, 0, 0.1))
    loose = _PARALLEL.replace("</mujoco>", "</mujoco\n>") + "<!-- </mujoco> -->"
    copy = copy_arm_files(write(tmp_path, loose), tmp_path / "run", hand)
    assert copy is not None and recognise_own_hand(copy).hand.length == pytest.approx(0.1)
    with pytest.raises(InputError, match="describes its hand already"):
        copy_arm_files(copy, tmp_path / "again", hand)


def test_a_run_takes_the_hand_in_the_file_of_its_arm_unless_one_is_named(tmp_path, sample_scene) -> None:
    for name, text, settings, hand in (
        ("fingers", _PARALLEL, (), "own"),
        ("fingers_and_cup", _PARALLEL, ("hand=suction",), "suction"),
        ("no_fingers", GANTRY, (), "suction"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        config = load_config(None, [f"robot={write(folder, text)}", *settings])
        with open_run(RunOrder("run", sample_scene, config, out=folder / "run")) as (_, record, chosen):
            assert chosen.hand == record.config.as_json()["hand"] == hand


def test_a_check_against_a_photo_comprehends_it_with_the_hand_that_is_named(tmp_path, sample_scene) -> None:
    (tmp_path / "program.py").write_text("")
    config = load_config(None, [f"robot={write(tmp_path, _PARALLEL)}", "hand=suction"])
    hands: list[str] = []

    def view(folder, _log):
        hands.append(read_record(folder).config.as_json()["hand"])
        raise InputError("seen enough")

    with (
        pytest.raises(InputError, match="seen enough"),
        open_check_order(tmp_path / "program.py", None, None, sample_scene, config, view),
    ):
        pass
    assert hands == ["suction"]


def test_an_arm_picks_with_the_hand_of_its_file(tmp_path) -> None:
    file = str(write(tmp_path, _COUPLED))
    arm = get_arm(file, "own")
    assert arm.dof == 4
    assert arm.link_names[-3:] == ("hand", "left_finger", "right_finger")
    env = Environment(
        task=Scripted(lambda task, env: env.add_object("block/block.urdf", at(0.5, 0.1, 0.02))), robot=file, hand="own"
    )
    env.reset()
    grasp = env.end_effector.find_grasps(env.physics, 1, env.object_prism(1), ()).poses[0]
    (x, y, z), turn = grasp
    assert env.pick_place(grasp, ((x - 0.1, y - 0.3, z), turn)).note == "placed"
    assert np.linalg.norm(np.subtract(env.get_object_pose(1)[0], (0.4, -0.2, 0.02))) < 0.001


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (GANTRY, "joints grip close no two surfaces on each other"),
        (_START + _AFTER_FINGER.replace("0.4 0 -0.5 0 0 0", "0.4 0 -0.5 0"), "nothing moves beyond its body 'wrist'"),
        (_PARALLEL.replace("0 0.04", "0 0.001"), "close no two surfaces"),
        (_PARALLEL.replace("0 0.04", "0 0.2"), "it opens 400 mm, not 10 to 300 mm"),
    ],
)
def test_a_hand_that_is_not_recognised_is_refused_with_the_reason(tmp_path, text, reason) -> None:
    with pytest.raises(InputError, match=reason):
        get_arm(str(write(tmp_path, text)), "own")


def test_a_shipped_arm_has_no_hand_of_its_own() -> None:
    with pytest.raises(InputError, match="robot panda has no hand of its own"):
        get_arm("panda", "own")
