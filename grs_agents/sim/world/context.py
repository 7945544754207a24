"""Settings that the simulations of a process share: set once in a worker, so that programs need not name them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from grs_agents.base.config.schema import Limits
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import DEFAULT
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world import budget


@dataclass(frozen=True)
class SimContext:
    """Settings of a ``TabletopSim`` whose caller names none, and the surroundings of its scenes.

    Frozen, since programs can reach the context of their environments.

    Attributes:
        library: 3D assets; None for the shipped ones.
        seed: of the random places.
        robot: ``"ur5e"``, ``"panda"`` or the path of an MJCF file.
        hand: name of the hand at its flange.
        background: library name of the fixed surroundings of the robot.
        bystanders: stand on the table before a task sets up its scene.
    """

    library: Library | None = None
    seed: int = 0
    robot: str = DEFAULT
    hand: str = DEFAULT_HAND
    background: str | None = None
    bystanders: tuple[InstanceObject, ...] = ()

    def get_library(self) -> Library:
        """The library, loaded once if none was given."""
        library = self.library or Library()
        object.__setattr__(self, "library", library)
        return library


PROCESS_CONTEXT: Final = SimContext()
"""Context of every ``Environment`` of this process."""


def set_environment_defaults(
    library: Library | None = None,
    seed: int = 0,
    robot: str = DEFAULT,
    limits: Limits | None = None,
    background: str | None = None,
    bystanders: Sequence[InstanceObject] = (),
    hand: str = DEFAULT_HAND,
) -> None:
    """Set the context of every ``Environment`` of this process, e.g. of those that a test program makes.

    ``limits`` bound all environments of the process together from now on; None leaves them.
    """
    present = SimContext(library, seed, robot, hand, background, tuple(bystanders))
    for name, value in vars(present).items():
        object.__setattr__(PROCESS_CONTEXT, name, value)
    if limits is not None:
        budget.set_call_limits(limits)
