"""Copies of an arm's MJCF file and its dependencies beside the tasks it solves, which can then be moved."""

from pathlib import Path
from typing import Final

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.robot_file_check import check_robot_file

ROBOT_FOLDER: Final = "robot"
"""Folder of a run that holds the copy."""


def copy_arm_files(source: Path, folder: Path) -> Path | None:
    """Copy an arm's file and its dependencies into ``folder``, in their relative layout.

    Returns:
        The copy of the arm's file; None if it is no MJCF, a dependency is missing, lies outside the arm's folder, or is
        named by an absolute path: such an arm stays in place.
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
    """The arm of a run in ``folder``: the run's copy of the file, if there is any."""
    copied = folder.resolve() / ROBOT_FOLDER / Path(robot).name
    return str(copied) if Path(robot).suffix and copied.is_file() else robot
