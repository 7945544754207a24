"""The arm's own file in a task instance: on disk its name is relative to the folder that has both."""

from pathlib import Path, PurePath

from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.sim.arms.foreign_robot import check_foreign_robot
from grs_agents.sim.instance.task_instance import TaskInstance


def make_robot_path_relative(instance: TaskInstance, folder: Path) -> TaskInstance:
    """The instance as a file in ``folder`` says it: an arm's file that lies in there is named relative to it."""
    file, root = Path(instance.robot), folder.resolve()
    if not file.is_relative_to(root):
        return instance
    return instance.model_copy(update={"robot": file.relative_to(root).as_posix()})


def resolve_robot_path(instance: TaskInstance, folder: Path) -> TaskInstance:
    """The instance that a file in ``folder`` holds, with the absolute path of the arm's file that lies in there.

    Raises InputError: the name is an absolute path or leads out of the folder, there is no such file, or the file is no
            arm, or takes more memory or time than one.
    """
    if not PurePath(instance.robot).suffix:
        return instance
    found = resolve_member_file(folder, instance.robot).resolve()
    check_foreign_robot(found)
    return instance.model_copy(update={"robot": str(found)})
