"""CLIPort's names for the values of ``task.ee`` and ``task.primitive``."""

from typing import Any

from grs_agents.sim.end_effectors import EndEffector, make_end_effector
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.instance.episode import UnsupportedError
from grs_agents.sim.tabletop_episode import GoalTask, InstanceTask


class Suction:
    """The suction cup at the end of the arm."""


class Spatula:
    """A blade at the end of the arm that pushes along the table and picks nothing up."""


class PickPlace:
    """Picks with suction at one pose and places at another; ``height`` and ``speed`` are CLIPort's, and not used."""

    def __init__(self, height: float = 0.32, speed: float = 0.01) -> None:
        self.height, self.speed = height, speed


def push(*_: Any, **__: Any) -> None:
    """Marks pushing along the table, ``task.primitive = push``; ``env.step`` does it, a call is refused."""
    raise UnsupportedError("the push primitive was called as a function", "use env.step({'pose0': ..., 'pose1': ...})")


def find_end_effector(task: GoalTask, hand: str = DEFAULT_HAND) -> EndEffector:
    """The end effector of a task: an instance's own, else by ``ee`` and ``primitive``, with a robot's hand."""
    if isinstance(task, InstanceTask):
        return task.end_effector
    ee, primitive = getattr(task, "ee", None), getattr(task, "primitive", None)
    pushes = primitive is push or primitive == "push" or ee is Spatula or isinstance(ee, Spatula) or ee == "spatula"
    return make_end_effector("push" if pushes else "pick_place", hand)
