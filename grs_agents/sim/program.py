"""Finding the task in a simulation program."""

from types import ModuleType

from grs_agents.sim.episode import SimulationError
from grs_agents.sim.task import Task


def task_class(module: ModuleType) -> type[Task]:
    """The last ``Task`` subclass that a program defines.

    Raises:
        SimulationError: it defines none.
    """
    found = [
        value for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Task) and value.__module__ == module.__name__
    ]  # fmt: skip
    if not found:
        raise SimulationError(
            f"module {module.__name__} defines no subclass of Task", "define a class that derives from Task"
        )
    return found[-1]
