"""An arm's file is copied with all that it names, or not at all."""

from pathlib import Path

import pytest

from grs_agents.sim.arms.arm_files import copy_arm_files, find_arm_file
from grs_agents.sim.arms.registry import get_arm
from tests.gantry import GANTRY

MESH = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


def write_arm(folder: Path, mesh: str, directory: str = "meshes") -> Path:
    """The gantry with a mesh on its carriage and a file that it includes."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    (folder / "meshes" / "carriage.obj").write_text(MESH)
    (folder / "more.xml").write_text("<mujocoinclude><option/></mujocoinclude>")
    assets = f'<asset><mesh name="carriage" file="{mesh}"/></asset><include file="more.xml"/>'
    source = GANTRY.replace('angle="radian"/>', f'angle="radian" meshdir="{directory}"/>{assets}')
    file = folder / "arm.xml"
    file.write_text(source.replace('type="box" size="0.05 0.05 0.02"', 'type="mesh" mesh="carriage"'))
    return file


def test_a_copy_is_the_same_arm(tmp_path: Path) -> None:
    source = write_arm(tmp_path / "own", "carriage.obj")
    copied = copy_arm_files(source, tmp_path / "run" / "robot")
    assert copied is not None and copied == tmp_path / "run" / "robot" / "arm.xml"
    names = {str(file.relative_to(copied.parent)) for file in copied.parent.rglob("*.*")}
    assert names == {"arm.xml", "more.xml", "meshes/carriage.obj"}
    assert (get_arm(str(copied)).home_joints == get_arm(str(source)).home_joints).all()
    assert copy_arm_files(copied, tmp_path / "again") == tmp_path / "again" / "arm.xml"
    assert find_arm_file(tmp_path / "run", str(source)) == str(copied.resolve())
    assert find_arm_file(tmp_path / "own", str(source)) == str(source)
    assert find_arm_file(tmp_path / "run", "panda") == "panda"


@pytest.mark.parametrize("mesh", ["../../outside.obj", "none.obj", "{folder}/own/meshes/carriage.obj"])
def test_an_arm_that_cannot_be_moved_stays(tmp_path: Path, mesh: str) -> None:
    (tmp_path / "outside.obj").write_text(MESH)
    source = write_arm(tmp_path / "own", mesh.format(folder=tmp_path))
    assert copy_arm_files(source, tmp_path / "run") is None


def test_what_is_no_arm_is_not_copied(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text("<mujoco>")
    assert copy_arm_files(tmp_path / "arm.xml", tmp_path / "run") is None
