"""A task instance is complete, and nothing that trusted code says of it is the program's to say."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.base.geometry import transforms
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import solve_task_instances
from grs_agents.perception.types import SceneDescription
from grs_agents.sim import TaskInstance, hash_instance
from grs_agents.sim.instance.task_instance import InstanceLight, InstanceTable
from grs_agents.tasks.task_folder import open_task_folder
from tests.gantry import GANTRY
from tests.graph.conftest import SIMULATION, Make

CAMERA: dict[str, Any] = {"fx": 600.0, "fy": 610.0, "cx": 320.0, "cy": 241.0, "width": 640, "height": 480}
POSE = transforms.pose_matrix(transforms.quaternion_to_matrix((0.9, -0.3, 0.1, 0.3)), np.array([-0.4, 0.1, 3.0]))
FORGED = (
    """\
from grs_agents.sim.cliport import instantiation
from grs_agents.sim.instance.task_instance import InstanceCamera, InstanceLight, InstanceTable

DESCRIBE = instantiation.describe_instance


def describe(*given):
    drawn = DESCRIBE(*given)
    heavy = tuple(item.model_copy(update={"mass": 9.0, "friction": 1.9}) for item in drawn.objects)
    camera = InstanceCamera(width=9, height=9, fx=9, fy=9, cx=4, cy=4, pose=((0, 0, 9), (1, 0, 0, 0)))
    named = {"robot": "panda", "camera": camera, "background": "block/red_block.urdf"}
    looks = {"light": InstanceLight(diffuse=(0, 0, 0)), "table": InstanceTable(color=(1, 0, 0, 1))}
    return drawn.model_copy(update={"objects": heavy, **named, **looks})


instantiation.describe_instance = describe
"""
    + SIMULATION
)


def scene_of(state: RunState, **changes: Any) -> SceneDescription:
    """The scene of three blocks, seen by a camera."""
    frame = {**dict(state["scene"].frame), "T_robot_cam": POSE.tolist()}
    return SceneDescription.model_validate(
        {**dict(state["scene"]), "frame": frame, "camera": CAMERA, "table_color": (0.2, 0.3, 0.4), **changes}
    )


def solve(make_services: Make, simulation: str, scene: SceneDescription | None, **settings: Any) -> TaskInstance:
    """The instance of seed 0."""
    solved = solve_task_instances(simulation, make_services(**settings), scene)
    assert not solved.failures
    return solved.instances[0]


def test_an_instance_says_what_simulates_and_shows_it(state: RunState, make_services: Make) -> None:
    instance = solve(make_services, SIMULATION, scene_of(state), robot="panda")
    assert (instance.robot, instance.table.color, instance.light) == ("panda", (0.2, 0.3, 0.4, 1.0), InstanceLight())
    camera = instance.camera
    assert camera is not None and not camera.robot_placed
    assert camera.model_dump(include=set(CAMERA)) == CAMERA
    assert np.allclose(transforms.quaternion_to_matrix(camera.pose[1]), POSE[:3, :3])
    assert np.allclose(camera.pose[0], POSE[:3, 3])
    assert [(item.mass, item.friction) for item in instance.objects] == [(0.05, 0.6)] * 3


def test_a_program_says_nothing_of_what_trusted_code_names(state: RunState, make_services: Make) -> None:
    scene = scene_of(state)
    assert solve(make_services, FORGED, scene) == solve(make_services, SIMULATION, scene)


@pytest.mark.parametrize("origin", ["calibrated", "table_plane"])
def test_a_camera_tells_whether_the_robot_stood_there(state: RunState, make_services: Make, origin: str) -> None:
    frame = {**dict(state["scene"].frame), "origin": origin}
    camera = solve(make_services, SIMULATION, scene_of(state, frame=frame)).camera
    assert camera is not None and camera.robot_placed == (origin == "table_plane")


def test_without_a_photo_there_is_no_camera(make_services: Make) -> None:
    instance = solve(make_services, SIMULATION, None)
    assert (instance.camera, instance.table) == (None, InstanceTable())


def test_what_the_library_does_not_have_fails_its_seed_alone(make_services: Make) -> None:
    absent = FORGED.replace('"mass": 9.0, "friction": 1.9', '"asset": "none/none.urdf"')
    solved = solve_task_instances(absent, make_services(), None)
    assert not solved.instances and "none/none.urdf" in solved.failures[0]


def test_an_arm_of_ones_own_moves_with_the_run(make_services: Make, tmp_path: Path) -> None:
    own = tmp_path / "elsewhere" / "gantry.xml"
    own.parent.mkdir()
    own.write_text(GANTRY)
    instance = solve(make_services, SIMULATION, None, robot=str(own))
    assert instance.robot == str(tmp_path.resolve() / "robot" / "gantry.xml")
    assert json.loads((tmp_path / "instances" / "seed_0.json").read_text())["robot"] == "robot/gantry.xml"
    moved, out = tmp_path / "moved", tmp_path / "out"
    moved.mkdir()
    for name in ("instances", "robot"):
        (tmp_path / name).rename(moved / name)
    folder = open_task_folder(moved)
    read = folder.read_instance(0)
    assert read == instance.model_copy(update={"robot": str(moved.resolve() / "robot" / "gantry.xml")})
    assert hash_instance(read) == hash_instance(instance)
    folder.copy_assets_and_robot(out)
    assert (out / "robot" / "gantry.xml").read_text() == GANTRY


def test_an_instance_names_no_arm_out_of_its_folder(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(GANTRY)
    (tmp_path / "run" / "instances").mkdir(parents=True)
    fields = {"task": "t", "seed": 0, "max_steps": 1, "timestep": 0.004, "objects": [], "goals": []}
    file = tmp_path / "run" / "instances" / "seed_0.json"
    file.write_text(json.dumps({**fields, "robot": "../arm.xml"}))
    with pytest.raises(InputError, match="no path inside it"):
        open_task_folder(tmp_path / "run").read_instance(0)


@pytest.mark.parametrize("varies", [False, True])
def test_an_unforeseen_seed_that_shows_another_kind_of_scene_is_solved_too(make_services: Make, varies: bool) -> None:
    """A goal is missing for seed 77 alone; all others are alike, or stand a little elsewhere each."""
    rare = SIMULATION.replace(
        "        flat = (0, 0, 0, 1)\n",
        "        flat, drawn = (0, 0, 0, 1), np.random.rand()\n"
        "        odd = drawn == np.random.RandomState(77).rand()\n"
        f"        shift = {0.01 if varies else 0.0} * drawn\n",
    ).replace(
        "((*start, 0.02), flat))\n",
        "((start[0] + shift, start[1], 0.02), flat))\n            if odd and color == 'blue': break\n",
    )
    solved = solve_task_instances(rare, make_services(), None, (50, 51, 77, 52))
    assert solved.unforeseen is not None and not solved.failures
    assert [one.seed for one in solved.unforeseen.instances] == [50, 77]
    assert [len(one.goals) for one in solved.unforeseen.instances] == [2, 1]
    assert [one.seed for one in solved.unforeseen.rollouts] == [50, 77]
