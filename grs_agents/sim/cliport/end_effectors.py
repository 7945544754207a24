"""What ``task.ee`` and ``task.primitive`` may be, under CLIPort's names."""

from typing import Any

from grs_agents.sim.instance.episode import UnsupportedError


class Suction:
    """The suction cup at the end of the arm."""


class Spatula:
    """A blade at the end of the arm that pushes along the table, and takes nothing up."""


class PickPlace:
    """Picks with suction at one pose and places at another; ``height`` and ``speed`` are CLIPort's, and not used."""

    def __init__(self, height: float = 0.32, speed: float = 0.01) -> None:
        self.height, self.speed = height, speed


def push(*_: Any, **__: Any) -> None:
    """Stands for pushing along the table, ``task.primitive = push``; ``env.step`` does it, a call is refused."""
    raise UnsupportedError("the push primitive was called as a function", "use env.step({'pose0': ..., 'pose1': ...})")


def uses_push_primitive(ee: Any, primitive: Any) -> bool:
    """Whether actions of a task with this ``ee`` and ``primitive`` push with the spatula, not pick and place."""
    return primitive is push or primitive == "push" or ee is Spatula or isinstance(ee, Spatula) or ee == "spatula"
