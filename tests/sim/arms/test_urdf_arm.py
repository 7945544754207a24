"""An arm in URDF is the arm of its file: joints, limits, fingers, tool frame and looks; its meshes stay in a folder."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base.config.load import load_config
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.sim import Environment
from grs_agents.sim.arms.arm_files import copy_arm_files, find_arm_file, resolve_robot_path
from grs_agents.sim.arms.mjcf_arm import recognise_own_hand
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rendering.stage import Props, Stage
from tests.needs import needs
from tests.sim.arms.test_arm_files import MESH

_DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit meter="0.001"/><up_axis>Y_UP</up_axis></asset>
  <library_effects>
    <effect id="red"><profile_COMMON><technique sid="t">
      <lambert><diffuse><color>1 0 0 1</color></diffuse></lambert>
    </technique></profile_COMMON></effect>
  </library_effects>
  <library_materials><material id="paint"><instance_effect url="#red"/></material></library_materials>
  <library_geometries>
    <geometry id="g"><mesh>
      <source id="p">
        <float_array id="a" count="12">0 0 0 50 0 0 0 50 0 0 0 100</float_array>
        <technique_common><accessor source="#a" count="4" stride="3">
          <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
        </accessor></technique_common>
      </source>
      <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
      <triangles count="4" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
        <p>0 2 1 0 1 3 1 2 3 2 0 3</p></triangles>
    </mesh></geometry>
  </library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g">
    <bind_material><technique_common><instance_material symbol="m" target="#paint"/></technique_common></bind_material>
  </instance_geometry></node></visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""
_LINK = (
    '<link name="{name}"><inertial><mass value="0.5"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" '
    'izz="1e-3"/></inertial>{shapes}</link>'
)
_JOINT = (
    '<joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="{low}" upper="{high}" '
    'effort="{effort}" velocity="{speed}"/>{more}</joint>'
)
_BOX = '<collision><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></collision>'
_PACKAGE = "package://gantry_support/meshes"


def _joint(name: str, parent: str, child: str, axis: str, low: float, high: float, **more: object) -> str:
    fields = {"type": "prismatic", "xyz": "0 0 0", "rpy": "0 0 0", "effort": 90, "speed": 0.4, "more": ""} | more
    return _JOINT.format(name=name, parent=parent, child=child, axis=axis, low=low, high=high, **fields)


_GRIP = _BOX.format(xyz="0 {y} 0.024", size="0.02 0.015 0.048")
_URDF = "".join(
    [
        '<robot name="gantry"><gazebo><plugin filename="control.so"/></gazebo><undeclared:hint/>',
        _LINK.format(name="base_link", shapes=_BOX.format(xyz="0 0 0.01", size="0.05 0.05 0.02")),
        _LINK.format(name="rail", shapes=""),
        _LINK.format(
            name="carriage",
            shapes=f'<visual><geometry><mesh filename="{_PACKAGE}/cover.dae"/></geometry></visual>'
            f'<collision><geometry><mesh filename="{_PACKAGE}/cover.dae"/></geometry></collision>',
        ),
        _LINK.format(
            name="mast",
            shapes='<collision><origin xyz="0 0 0.02"/><geometry><mesh filename="../meshes/mast.obj" '
            'scale="0.5 0.5 0.5"/></geometry></collision>',
        ),
        _LINK.format(name="wrist", shapes=_BOX.format(xyz="0 0 0.01", size="0.04 0.04 0.02")),
        _LINK.format(name="hand", shapes=_BOX.format(xyz="0 0 0.03", size="0.06 0.2 0.06")),
        _LINK.format(name="left", shapes=_GRIP.format(y=0.0075)),
        _LINK.format(name="right", shapes=_GRIP.format(y=-0.0075)),
        '<link name="tool0"/><link name="hand_tcp"/><link name="hand_camera"/><link name="camera_optical"/>',
        _joint("x", "base_link", "rail", "1 0 0", -0.2, 0.9, xyz="0 0 1.2"),
        _joint("y", "rail", "carriage", "0 1 0", -0.6, 0.6, speed=50),
        _joint("z", "carriage", "mast", "0 0 1", -1.1, 0, effort=300),
        _joint(
            "turn", "mast", "wrist", "0 0 1", -6, 6, type="revolute", xyz="0 0 -0.06", rpy="3.14159265 0 0", speed=0
        ),
        _joint("mount", "wrist", "hand", "0 0 1", 0, 0, type="fixed", xyz="0 0 0.02"),
        _joint("left_joint", "hand", "left", "0 1 0", 0, 0.04, xyz="0 0 0.058"),
        _joint("right_joint", "hand", "right", "0 -1 0", 0, 0.04, xyz="0 0 0.058", more='<mimic joint="left_joint"/>'),
        _joint("tool", "wrist", "tool0", "0 0 1", 0, 0, type="fixed", xyz="0 0 0.02"),
        _joint("tcp", "hand", "hand_tcp", "0 0 1", 0, 0, type="fixed", xyz="0 0 0.1"),
        _joint("camera", "hand", "hand_camera", "0 0 1", 0, 0, type="fixed"),
        _joint("optical", "hand_camera", "camera_optical", "0 0 1", 0, 0, type="fixed"),
        "</robot>",
    ]
)


class Package(NamedTuple):
    """A package of ROS with the gantry as URDF, and the run's copy of it."""

    urdf: Path
    copy: Path


def write_urdf(folder: Path, text: str = _URDF) -> Path:
    """The URDF and its meshes, as packages have them."""
    for name in ("urdf", "meshes"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "meshes/cover.dae").write_text(_DAE)
    (folder / "meshes/mast.obj").write_text(MESH)
    file = folder / "urdf/gantry.urdf"
    file.write_text(text)
    return file


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Package:
    folder = tmp_path_factory.mktemp("urdf")
    urdf = write_urdf(folder / "gantry_support")
    copy = copy_arm_files(urdf, folder / "run/robot")
    assert copy is not None
    return Package(urdf, copy)


@needs("collada")
def test_joints_limits_and_fingers_are_those_of_the_file(package: Package) -> None:
    assert load_config(None, [f"robot={package.urdf}"]).config.robot == str(package.urdf)
    own = recognise_own_hand(package.urdf)
    assert str(own) == "hand: two fingers, opens 80 mm, by joints left_joint, right_joint"
    assert own.hand.length == pytest.approx(0.126)  # from the tool's frame, on the link that carries the hand
    arm = get_arm(str(package.urdf), "own")
    assert arm.lower_joint_limits == pytest.approx([-0.2, -0.6, -1.1, -6])
    assert arm.joint_speed_limits == pytest.approx([0.4, 1.0, 0.4, np.pi])
    env = Environment(
        task=Scripted(lambda task, env: env.add_object("block/block.urdf", at(0.5, 0.1, 0.02))),
        robot=str(package.urdf),
        hand="own",
    )
    env.reset()
    model = env.physics.model
    assert model.actuator_forcerange[:4, 1] == pytest.approx([90, 90, 300, 90])
    grasp = env.end_effector.find_grasps(env.physics, 1, env.object_prism(1), ()).poses[0]
    (x, y, z), turn = grasp
    assert env.pick_place(grasp, ((x - 0.1, y - 0.3, z), turn)).note == "placed"


@needs("collada")
def test_a_cup_is_at_the_frame_of_the_tool_and_the_looks_are_those_of_the_meshes(package: Package) -> None:
    arm = get_arm(str(package.urdf))
    tip, _ = arm.tip_pose(np.array([0.5, 0.1, -0.5, 0.0]))
    assert tip == pytest.approx([0.5, 0.1, 1.2 - 0.5 - 0.06 - 0.02 - arm.hand.length], abs=1e-6)
    model = Stage(Props((), arm), Library()).model
    cover = [geom for geom in range(model.ngeom) if tuple(model.geom_rgba[geom]) == (1, 0, 0, 1)]
    assert len(cover) == 1  # without the same mesh as it collides
    assert np.ptp(model.mesh_vert[: model.mesh_vertnum[model.geom_dataid[cover[0]]]], axis=0).max() > 0.09  # metres


@needs("collada")
def test_fingers_that_slide_look_as_in_the_file(package: Package) -> None:
    stage = Stage(Props((), get_arm(str(package.urdf), "own")), Library())
    for name, side in (("left", 1), ("right", -1)):
        body = stage.model.body(f"{name}_finger")
        assert body.geomnum == 1  # none of the hand's boxes
        box = int(body.geomadr[0])
        assert stage.model.geom_size[box] == pytest.approx([0.01, 0.0075, 0.024])
        offset = stage.data.body("hand").xmat.reshape(3, 3).T @ (
            stage.data.geom_xpos[box] - stage.data.body("hand").xpos
        )
        assert offset == pytest.approx([0, side * (0.04 + 0.0075), 0.058 + 0.02 + 0.024], abs=1e-6)


@needs("collada")
def test_the_copy_of_a_run_is_mjcf_and_the_same_arm(package: Package, tmp_path: Path) -> None:
    assert package.copy.name == "gantry.xml"
    assert find_arm_file(package.copy.parent.parent, str(package.urdf)) == str(package.copy)
    assert (get_arm(str(package.copy)).home_joints == get_arm(str(package.urdf)).home_joints).all()
    assert str(recognise_own_hand(package.copy)) == str(recognise_own_hand(package.urdf))
    instance = TaskInstance.model_construct(robot="gantry.xml")
    assert resolve_robot_path(instance, package.copy.parent).robot == str(package.copy)
    with pytest.raises(InputError, match="a task folder holds its robot as MJCF"):
        resolve_robot_path(TaskInstance.model_construct(robot="gantry.urdf"), write_urdf(tmp_path).parent)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<robot", "<sdf", "its root is <sdf>"),
        ("<gazebo>", '<xacro:include filename="a"/><gazebo>', "holds macros of xacro"),
        ('<robot name="gantry">', '<!DOCTYPE r [<!ENTITY a "b">]><robot name="gantry">', "document types"),
        (f"{_PACKAGE}/cover.dae", "package://gantry_support/meshes/lid.dae", "lid.dae' is nowhere between"),
        (f"{_PACKAGE}/cover.dae", "../meshes/link.obj", "link.obj' is nowhere between"),
        ("../meshes/mast.obj", "../meshes/large.obj", "at most 67108864"),
    ],
)
def test_what_is_no_urdf_or_leaves_its_package_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "outside.obj").write_text(MESH)
    end = "</sdf>" if new == "<sdf" else "</robot>"
    file = write_urdf(tmp_path / "a/b/c/d/gantry_support", _URDF.replace(old, new).replace("</robot>", end))
    meshes = file.parent.parent / "meshes"
    (meshes / "link.obj").symlink_to(tmp_path / "outside.obj")
    with (meshes / "large.obj").open("wb") as large:
        large.truncate((1 << 26) + 1)
    with pytest.raises(InputError, match=r"^robot .*gantry\.urdf: ") as refused:
        get_arm(str(file))
    assert words in refused.value.message


def test_a_joint_that_hardly_moves_is_refused(tmp_path: Path) -> None:
    slow = _URDF.replace("cover.dae", "mast.obj").replace('velocity="50"', 'velocity="1e-7"')
    with pytest.raises(InputError, match=r"^robot .*gantry\.urdf: joint 'y' moves at 1e-07 rad/s"):
        get_arm(str(write_urdf(tmp_path / "gantry_support", slow)))


def test_a_broken_mesh_is_refused_by_its_name(tmp_path: Path) -> None:
    file = write_urdf(tmp_path, _URDF.replace("cover.dae", "cover.stl"))
    (tmp_path / "meshes/cover.stl").write_bytes(b"solid nothing")
    with pytest.raises(InputError, match=r"cover\.stl"):
        get_arm(str(file))
