"""The nozzles that the arm picks with: the suction cup, and a narrow one for what is too small for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from grs_agents.sim.arms.arm_parts import CUP_RADIUS

_VACUUM: Final = 15.0 / CUP_RADIUS**2
"""Newtons for each square metre of radius squared: 60 kPa below the air's pressure on a disk of 20 mm (18.8 N), times
0.8, are 15 N."""


@dataclass(frozen=True)
class Nozzle:
    """A round suction nozzle.

    Attributes:
        radius: of its body, metres.
        lip: where its lip seals, metres from its axis.
    """

    radius: float
    lip: float

    @property
    def holding_force(self) -> float:
        """What it holds, newtons."""
        return _VACUUM * self.radius**2

    @property
    def peeling_moment(self) -> float:
        """What bends its lip off, newton metres: so much tips a disk, which that force holds, over its edge."""
        return self.holding_force * self.radius

    def is_wider_than(self, size: Sequence[float]) -> bool:
        """Whether its lip finds room on no face of a box of ``size`` (3,), metres."""
        return sorted(size)[1] < 2 * self.lip


CUP: Final = Nozzle(CUP_RADIUS, 0.008)
NARROW: Final = Nozzle(0.004, 0.0028)
"""For what is under 16 mm: on a cube of 1 cm its body stays 1 mm from the edges."""
