"""What ``task.ee`` and ``task.primitive`` may be, under CLIPort's names."""

from typing import Any

from grs_agents.sim.instance import UnsupportedError


class Suction:
    """The suction cup at the end of the arm."""


class Spatula:
    """A blade at the end of the arm that pushes along the table, and takes nothing up."""


class PickPlace:
    """The primitive that picks with suction at one pose and places at another.

    Args:
        height, speed: accepted as CLIPort has them; the arm chooses its own.
    """

    def __init__(self, height: float = 0.32, speed: float = 0.01) -> None:
        self.height, self.speed = height, speed


def push(*_: Any, **__: Any) -> None:
    """The primitive that pushes along the table: ``task.primitive = push`` makes ``env.step(action)`` do so.

    Raises:
        UnsupportedError: it was called; the environment does what it stands for.
    """
    raise UnsupportedError("the push primitive was called as a function", "use env.step({'pose0': ..., 'pose1': ...})")


def pushes(ee: Any, primitive: Any) -> bool:
    """Whether actions of a task with this ``ee`` and ``primitive`` push with the spatula, not pick and place."""
    return primitive is push or primitive == "push" or ee is Spatula or isinstance(ee, Spatula) or ee == "spatula"
