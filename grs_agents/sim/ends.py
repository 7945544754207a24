"""What ``task.ee`` and ``task.primitive`` may be, under CLIPort's names, and which of them this runtime can do."""

from typing import TYPE_CHECKING, Any

from grs_agents.sim.episode import UnsupportedError

if TYPE_CHECKING:
    from grs_agents.sim.task import Task


class Suction:
    """The suction cup at the end of the arm."""


class Spatula:
    """A blade for pushing; not there yet: a task that asks for it is refused at ``env.reset()``."""


class PickPlace:
    """The primitive that picks with suction at one pose and places at another.

    Args:
        height, speed: accepted as CLIPort has them; the arm chooses its own.
    """

    def __init__(self, height: float = 0.32, speed: float = 0.01) -> None:
        self.height, self.speed = height, speed


def push(*_: Any, **__: Any) -> None:
    """The primitive that pushes along the table.

    Raises:
        UnsupportedError: always, it is not there yet.
    """
    raise UnsupportedError("the push primitive is not there yet", "use pick-and-place: leave task.primitive as it is")


def pushes(task: "Task") -> bool:
    """Whether a task's actions push with the spatula rather than pick and place."""
    ee, primitive = task.ee, task.primitive
    return primitive is push or primitive == "push" or ee is Spatula or isinstance(ee, Spatula) or ee == "spatula"


def check(task: "Task") -> None:
    """Refuse a task whose end effector or primitive this runtime does not have.

    Raises:
        UnsupportedError: it asks for a spatula or for pushing.
    """
    if pushes(task):
        raise UnsupportedError(
            f"{type(task).__name__} asks for pushing with a spatula, which is not there yet",
            "leave task.ee and task.primitive as they are: suction, pick-and-place",
        )
