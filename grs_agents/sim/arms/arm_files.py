"""An arm's MJCF file and what it names, kept beside the tasks that it solves: they can be moved and handed on."""

from pathlib import Path
from typing import Final

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.robot_file_check import check_robot_file

ROBOT_FOLDER: Final = "robot"
"""The folder of a run that has them."""


def copy_arm_files(source: Path, folder: Path) -> Path | None:
    """Copy an arm's file, and the files that it names, into ``folder``, laid out as they were.

    Returns:
        The copy of the arm's file; None where it is no MJCF, a file is missing or lies outside the arm's own folder, or
        is named by its absolute path: such an arm stays where it is.
    """
    try:
        check_robot_file(source)
        named = [Path(file) for file in mujoco.mju_getXMLDependencies(str(source))]
        parts = {file.relative_to(source.parent): file.read_bytes() for file in named}
        for part, data in parts.items():
            write_bytes(folder / part, data)
        copied = [Path(file) for file in mujoco.mju_getXMLDependencies(str(folder / source.name))]
    except (InputError, mujoco.FatalError, OSError, ValueError):
        return None
    return folder / source.name if all(file.is_relative_to(folder) for file in copied) else None


def find_arm_file(folder: Path, robot: str) -> str:
    """The arm that a run in ``folder`` was made with: its own copy of the file, where it has one."""
    copied = folder.resolve() / ROBOT_FOLDER / Path(robot).name
    return str(copied) if Path(robot).suffix and copied.is_file() else robot
