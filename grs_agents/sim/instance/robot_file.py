"""The arm's file of a task instance: on disk its path is relative to the folder of both."""

from pathlib import Path, PurePath

from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.sim.arms.foreign_robot import check_foreign_robot
from grs_agents.sim.instance.task_instance import TaskInstance


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
    path = resolve_member_file(folder, instance.robot).resolve()
    check_foreign_robot(path)
    return instance.model_copy(update={"robot": str(path)})
