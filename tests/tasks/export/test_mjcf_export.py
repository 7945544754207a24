"""A task's scene as a folder: it may be moved, it moves as the trusted world does, and its README works."""

import contextlib
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance, hash_instance
from grs_agents.sim.world.compilation import compile_world, reset_world_to_poses
from grs_agents.sim.world.spec import instance_to_spec
from grs_agents.tasks.export.mjcf_folder import MjcfFolder, export_mjcf
from grs_agents.tasks.task_folder import open_task_folder
from scripts.check_portable import LENS, follow, plan_commands, write_example
from tests.bombs import png
from tests.cli.command import grs

Export = Callable[..., MjcfFolder]
ARM = """
<mujoco><compiler angle="radian" meshdir="parts" texturedir="parts"/>
  <asset><mesh name="cart" file="cart.obj"/><texture name="paint" type="2d" file="paint.png"/>
    <material name="paint" texture="paint"/></asset>
  <worldbody><body name="rail" pos="0 0 1.2">
    <joint name="x" type="slide" axis="1 0 0" range="-0.2 0.9"/>
    <geom type="mesh" mesh="cart" material="paint" mass="1"/>
    <body name="carriage"><joint name="y" type="slide" axis="0 1 0" range="-0.6 0.6"/><geom size="0.02" mass="1"/>
      <body name="mast"><joint name="z" type="slide" axis="0 0 1" range="-1.1 0"/><geom size="0.02" mass="0.5"/>
        <body name="wrist" pos="0 0 -0.06" quat="0 1 0 0"><joint name="turn" axis="0 0 1" range="-6 6"/>
          <geom size="0.02" mass="0.2"/><site name="tip" pos="0 0 0.02"/>
  </body></body></body></body></worldbody></mujoco>
"""


@pytest.fixture
def export(tmp_path: Path) -> Export:
    """Exports the example, its values changed as told, and moves the folder elsewhere."""

    def make(portable: bool = False, **changes: Any) -> MjcfFolder:
        task = open_task_folder(write_example(tmp_path / "task", **changes))
        made = export_mjcf(task, tmp_path / "made", portable=portable)
        return replace(made, folder=made.folder.rename(tmp_path / "moved"))

    return make


def load(made: MjcfFolder) -> tuple[Any, Any]:
    """The model and its state in the keyframe ``start``."""
    model: Any = mujoco.MjModel.from_xml_path(str(made.scene))
    data: Any = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    return model, data


def lift(made: MjcfFolder) -> float:
    """By how much (m) the portable cup lifts the carton of milk."""
    model, _ = load(made)
    start = int(model.joint("object_1").qposadr[0]) + 2
    return float(plan_commands(made.scene)[1][-1, start] - model.key_qpos[0, start])


def test_a_moved_folder_moves_as_the_trusted_world_does(export: Export) -> None:
    made = export()
    instance = open_task_folder(made.folder.parent / "task").read_instance(3)
    world = compile_world(instance_to_spec(instance, Library()))
    reset_world_to_poses(world, instance.objects)
    model, data = load(made)
    world.data.qpos[:], world.data.qvel[:] = data.qpos, data.qvel
    np.testing.assert_allclose(data.ctrl, world.arm.home_joints, atol=1e-5)
    assert np.abs(data.qvel).max() < 0.01
    swing = 0.3 * np.sin(np.linspace(0, 4, 500)[:, None] + np.arange(6)) - 0.3 * np.sin(np.arange(6))
    mine = follow(model, data, data.ctrl + swing)
    for command in world.arm.home_joints + swing:
        world.data.act[:] = command
        mujoco.mj_step(world.model, world.data)
    assert np.abs(mine[-1] - world.data.qpos).max() < 1e-4


def test_files_are_relative_and_equal_ones_once(export: Export) -> None:
    made = export()
    files = re.findall(r'file="([^"]*)"', made.scene.read_text("utf-8"))
    assert len(files) == 5 and len(set(files)) == 3  # two cartons share mesh and texture; and a bowl
    assert {file.relative_to(made.folder).as_posix() for file in (made.folder / "assets").iterdir()} == set(files)
    model, _ = load(made)
    assert model.ntex == 3 and model.geom("object_1_visual_0").matid[0] >= 0  # the third is the sky


def test_the_folder_names_the_instance_it_was_made_of(export: Export) -> None:
    made = export()
    task = open_task_folder(made.folder.parent / "task")
    assert (made.folder / "instance.json").read_bytes() == task.files[3].read_bytes()
    model, _ = load(made)
    marked = bytes(model.text_data).split(b"\0")[0].decode()
    assert marked == made.instance_hash == hash_instance(task.read_instance(3))


def test_goals_are_shown_by_sites(export: Export) -> None:
    model, data = load(export())
    assert np.allclose(data.site("goal_0_target_0").xpos, (0.55, -0.05, 0.02))
    assert np.allclose(model.site("goal_1_zone_0").size, (0.05, 0.1, 0.001))
    bowl = data.body("object_4").xpos[:2]
    for name in ("goal_2_inside", "goal_3_near"):
        assert np.abs(data.site(name).xpos[:2] - bowl).max() < 0.01
    wider = model.site("goal_3_near").size - model.site("goal_2_inside").size
    assert np.allclose(wider, (0.05, 0.05, 0), atol=1e-5)


def test_light_table_and_own_mass_are_the_instances(export: Export) -> None:
    light = {"position": (0.0, 0.0, 3.0), "target": (0.0, 0.0, 0.0), "diffuse": (0.1, 0.2, 0.3)}
    model, _ = load(export(light=light, table={"color": (0.2, 0.3, 0.4, 1.0), "pattern": "checker"}))
    assert np.allclose(model.light_pos[0], (0, 0, 3)) and np.allclose(model.light_dir[0], (0, 0, -1))
    assert np.allclose(model.light_diffuse[0], (0.1, 0.2, 0.3))
    assert model.geom("table").matid[0] == model.material("table").id
    assert np.isclose(model.body("object_3").mass[0], 0.06)


def test_the_photo_camera_has_the_lens_and_looks_as_the_photo_does(export: Export) -> None:
    model, data = load(export())
    pixel = model.cam_sensorsize[0] / model.cam_resolution[0]
    assert np.allclose(model.cam_resolution[0], (LENS["width"], LENS["height"]))
    # Told from pictures that MuJoCo draws: a principal point left of the middle has a positive offset.
    offset = (159.5 - LENS["cx"], 119.5 - LENS["cy"])
    assert np.allclose(model.cam_intrinsic[0].reshape(2, 2) / pixel, [(LENS["fx"], LENS["fy"]), offset], rtol=1e-4)
    assert np.allclose(data.cam("photo").xmat.reshape(3, 3)[:, 2], (0, 0, 1))  # MuJoCo's cameras look along -z


def test_what_the_readme_says_of_suction_works(export: Export) -> None:
    made = export()
    said: dict[str, Any] = {}
    with contextlib.chdir(made.folder):
        for code in re.findall(r"```python\n(.*?)```", (made.folder / "README.md").read_text("utf-8"), re.DOTALL):
            exec(code, said)
    model, data = said["model"], said["data"]
    before = np.array(data.body("object_3").xpos - data.site("tip").xpos)
    said["take"](model, data, 3)
    mujoco.mj_step(model, data, 200)
    assert np.linalg.norm(data.body("object_3").xpos - data.site("tip").xpos - before) < 0.01
    data.ctrl[1] -= 0.2  # the shoulder lifts
    mujoco.mj_step(model, data, 200)
    held = float(data.body("object_3").xpos[2])
    said["release"](model, data, 3)
    mujoco.mj_step(model, data, 100)
    assert held > 0.1 and float(data.body("object_3").xpos[2]) < held - 0.05


def test_the_portable_scene_lacks_what_old_versions_do_not_read_and_its_cup_lifts(export: Export) -> None:
    made = export(portable=True)
    text = made.scene.read_text("utf-8")
    assert not re.search(r"sleep=|sleep_tolerance|input=|suction_|damping=\"[^\"]* ", text)
    assert "multiccd" in text and "tie_0" in text
    assert lift(made) > 0.08


def test_a_task_that_pushes_has_a_blade_and_no_suction(export: Export) -> None:
    made = export(portable=True, primitive="push")
    model, _ = load(made)
    assert (model.nu, model.neq) == (6, 1)  # the tie
    assert "blade" in (made.folder / "README.md").read_text("utf-8")


def test_the_files_of_a_users_own_arm_come_along(export: Export, tmp_path: Path) -> None:
    arm = tmp_path / "task" / "robot" / "arm.xml"
    (arm.parent / "parts").mkdir(parents=True)
    arm.write_text(ARM, encoding="utf-8")
    library = Library()
    shutil.copy(library.mesh_or_texture_path("bowl/bowl.obj"), arm.parent / "parts" / "cart.obj")
    shutil.copy(library.mesh_or_texture_path("HOPE/textures/Tuna.png"), arm.parent / "parts" / "paint.png")
    made = export(robot="robot/arm.xml")
    shutil.rmtree(arm.parent)
    model, _ = load(made)
    assert model.mesh("arm_cart").id >= 0 and model.nu == 4
    assert len(list((made.folder / "assets").iterdir())) == 4  # the bowl's mesh is there already


def test_only_an_earlier_export_is_replaced(tmp_path: Path) -> None:
    task = open_task_folder(write_example(tmp_path / "task"))
    out = tmp_path / "out"
    export_mjcf(task, out)
    (out / "assets" / "stale.obj").write_text("")
    export_mjcf(task, out)
    assert not (out / "assets" / "stale.obj").exists()
    (out / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"):
        export_mjcf(task, out)
    other = tmp_path / "other"
    other.mkdir()
    (other / "README.md").write_text("mine")
    with pytest.raises(InputError, match="something else than an export"):
        export_mjcf(task, other)
    (tmp_path / "link").symlink_to(other)
    with pytest.raises(InputError, match="a link"):
        export_mjcf(task, tmp_path / "link")
    with pytest.raises(InputError, match="no folder"):
        export_mjcf(task, other / "README.md")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "other", "out", "task"]


def test_the_command_writes_beside_the_run_and_says_what(tmp_path: Path) -> None:
    write_example(tmp_path / "run")
    task = {"task-name": "tidy <b>up</b>", "task-description": "Put all\nthings away.", "assets-used": []}
    (tmp_path / "run" / "task.json").write_text(json.dumps(task))
    done = grs("export", "run", "--format", "mjcf", "--portable", "--json", folder=tmp_path)
    value = json.loads(done.stdout)
    assert Path(value["scene"]) == tmp_path / "run-mjcf-portable" / "scene.xml"
    assert (value["seed"], value["portable"], value["files"]) == (3, True, 6)
    readme = Path(value["folder"], "README.md").read_text("utf-8")
    assert readme.startswith("# tidy \\<b\\>up\\</b\\>\n\nPut all things away.\n")
    for said in ("suction", "dm_control", value["instance_hash"], "shipped with GRS", "grs-agents 0.1.0"):
        assert said in readme
    many = json.loads(grs("export", "run", "--warp", "--json", folder=tmp_path).stdout)
    assert Path(many["scene"]) == tmp_path / "run-mjcf-warp" / "scene.xml" and many["warp"] and many["portable"]
    assert "mujoco_warp.put_model" in Path(many["folder"], "README.md").read_text("utf-8") and not value["warp"]
    assert grs("export", "run", "--seed", "7", folder=tmp_path).returncode == UnknownNameError.exit_status


def test_a_texture_bomb_of_a_task_folder_is_not_decoded(tmp_path: Path) -> None:
    task = write_example(tmp_path / "task", table={"texture": "table/photo.png"})
    (task / "assets" / "table").mkdir(parents=True)
    (task / "assets" / "manifest.json").write_text('{"assets": []}')
    png(task / "assets" / "table" / "photo.png", 16_000, 16_000, rows=2)
    done = grs("export", "task", folder=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert "photo.png has 16000x16000 pixels, at most 16777216" in done.stderr


@pytest.mark.parametrize("portable", [False, True])
def test_fingers_lift_a_thing_in_plain_mujoco(tmp_path: Path, portable: bool) -> None:
    block = InstanceObject(id=1, asset="block/block.urdf", pose=((0.5, 0.1, 0.02), (0.0, 0.0, 0.0, 1.0)))
    instance = TaskInstance(
        task="Lift", seed=0, max_steps=1, timestep=0.004, objects=(block,), goals=(), robot="ur5e", hand="robotiq_2f85"
    )
    (tmp_path / "task" / "instances").mkdir(parents=True)
    (tmp_path / "task" / "instances" / "seed_0.json").write_text(instance.model_dump_json(), encoding="utf-8")
    made = export_mjcf(open_task_folder(tmp_path / "task"), tmp_path / "made", portable=portable)
    assert "Robotiq 2F-85 holds by contact" in (made.folder / "README.md").read_text("utf-8")
    model, data = load(made)
    arm: Any = get_arm("ur5e", "robotiq_2f85")
    model.actuator_forcerange[-2:] = (-40.0, 40.0)
    down = arm.solve_ik_tool_down(np.array([[0.5, 0.1, 0.005], [0.5, 0.1, 0.15]]), np.zeros(2))

    def go(joints: Any, width: float) -> None:
        start = np.array(data.ctrl[:6])
        for share in np.linspace(0, 1, 400):
            data.ctrl[:6], data.ctrl[6:] = start + share * (joints - start), width
            mujoco.mj_step(model, data)
        mujoco.mj_step(model, data, 100)

    for joints, width in ((down[1], 0.04), (down[0], 0.04), (down[0], 0.0), (down[1], 0.0)):
        go(joints, width)
    assert float(data.body("object_1").xpos[2]) > 0.14
    go(down[0], 0.0)
    width = float(data.qpos[6])
    for joints in np.linspace(down[0], down[1], 100):  # opens as it rises, from the present width
        width = min(width + 0.075 * 0.004, 0.04)
        data.ctrl[:6], data.ctrl[6:] = joints, width
        mujoco.mj_step(model, data)
    mujoco.mj_step(model, data, 100)
    assert float(data.body("object_1").xpos[2]) < 0.03
