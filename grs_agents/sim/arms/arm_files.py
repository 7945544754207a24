"""A user's arm as files: copied beside the tasks that it solves, named relative to them, and tried in a worker first.

On disk the path of a task instance's arm is relative to the folder of both, so that the folder can be moved.
"""

from functools import lru_cache
from pathlib import Path, PurePath
from typing import Final

from grs_agents.base.config.schema import OwnHandConfig
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sandbox.host.foreign_reader import ForeignReader
from grs_agents.sim.arms.urdf_arm import URDF, find_mjcf
from grs_agents.sim.hands.description import describe_hand_in_mjcf
from grs_agents.sim.instance.task_instance import TaskInstance

ROBOT_FOLDER: Final = "robot"
"""Folder of a run that holds the copy."""
_WORKER: Final = "grs_agents.sim.arms.worker"


def copy_arm_files(source: Path, folder: Path, hand: OwnHandConfig | None = None) -> Path | None:
    """Copy an arm's file and its dependencies into ``folder``, in their relative layout; the copy describes ``hand``.
    A URDF is converted to MJCF.

    Returns:
        The copy of the arm's file; None if it is no arm's file, a dependency is missing, lies outside the arm's folder,
        or is named by an absolute path: such an arm stays in place.

    Raises:
        InputError: the file describes another hand.
    """
    try:
        source = find_mjcf(source)
        named = [Path(file) for file in mujoco.mju_getXMLDependencies(str(source))]
        parts = {file.relative_to(source.parent): file.read_bytes() for file in named}
    except (InputError, mujoco.FatalError, OSError, ValueError):
        return None
    if hand is not None:
        main = Path(source.name)
        parts[main] = describe_hand_in_mjcf(parts[main], hand)
    try:
        for part, data in parts.items():
            write_bytes(folder / part, data)
        copied = [Path(file) for file in mujoco.mju_getXMLDependencies(str(folder / source.name))]
    except (InputError, mujoco.FatalError, OSError, ValueError):
        return None
    return folder / source.name if all(file.is_relative_to(folder) for file in copied) else None


def find_arm_file(folder: Path, robot: str) -> str:
    """The arm of a run in ``folder``: the run's copy of the file, if there is any."""
    name = Path(robot).name
    if Path(robot).suffix.lower() == URDF:
        name = f"{Path(robot).stem}.xml"
    copied = folder.resolve() / ROBOT_FOLDER / name
    return str(copied) if Path(robot).suffix and copied.is_file() else robot


def make_robot_path_relative(instance: TaskInstance, folder: Path) -> TaskInstance:
    """The instance as saved in ``folder``: an arm's file inside the folder gets a relative path."""
    file, root = Path(instance.robot), folder.resolve()
    if not file.is_relative_to(root):
        return instance
    return instance.model_copy(update={"robot": file.relative_to(root).as_posix()})


def resolve_robot_path(instance: TaskInstance, folder: Path) -> TaskInstance:
    """The instance as loaded from ``folder``, with the absolute path of the arm's file.

    Raises InputError: the path is absolute or leads out of the folder, there is no such file, or the file is no arm, or
            takes more memory or time than an arm.
    """
    if not PurePath(instance.robot).suffix:
        return instance
    if PurePath(instance.robot).suffix.lower() == URDF:
        raise InputError(f"robot {instance.robot}: a task folder holds its robot as MJCF", "convert it, as a run does")
    path = resolve_member_file(folder, instance.robot).resolve()
    check_foreign_robot(path)
    return instance.model_copy(update={"robot": str(path)})


def check_foreign_robot(path: Path) -> None:
    """See that the arm in an MJCF file can be loaded, within the memory and time that an arm needs.
    Raises InputError: it cannot; or loading it breaks the worker, or takes more."""
    status = path.stat()
    _check_once(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=64)
def _check_once(path: Path, _changed: int, _size: int) -> None:
    with ForeignReader(_WORKER, [path.parent]) as reader:
        reader.read({"robot": str(path)}, f"robot {path}")
