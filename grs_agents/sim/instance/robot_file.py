"""The arm's own file in a task instance: on disk its name is relative to the folder that has both."""

from pathlib import Path, PurePath

from grs_agents.foreign import resolve_member_file
from grs_agents.sim.instance.task_instance import TaskInstance


def make_robot_path_relative(instance: TaskInstance, folder: Path) -> TaskInstance:
    """The instance as a file in ``folder`` says it: an arm's file that lies in there is named relative to it."""
    file, root = Path(instance.robot), folder.resolve()
    if not file.is_relative_to(root):
        return instance
    return instance.model_copy(update={"robot": file.relative_to(root).as_posix()})


def resolve_robot_path(instance: TaskInstance, folder: Path) -> TaskInstance:
    """The instance that a file in ``folder`` holds, with the absolute path of the arm's file that lies in there.

    Raises InputError: the name leads out of the folder, or there is no such file.
    """
    file = PurePath(instance.robot)
    if file.is_absolute() or not file.suffix:
        return instance
    found = resolve_member_file(folder, instance.robot).resolve()
    return instance.model_copy(update={"robot": str(found)})
