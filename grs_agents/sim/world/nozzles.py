"""Suction nozzles of the arm: the cup, and a narrow nozzle for objects too small for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from grs_agents.sim.arms.arm_parts import CUP_RADIUS

_VACUUM: Final = 15.0 / CUP_RADIUS**2
"""Holding force per squared radius, N/m^2: a vacuum of 60 kPa on a disk of 20 mm (18.8 N), times 0.8, is 15 N."""


@dataclass(frozen=True)
class Nozzle:
    """A round suction nozzle.

    Attributes:
        radius: of its body, metres.
        lip: radius of its sealing lip, metres.
    """

    radius: float
    lip: float

    @property
    def holding_force(self) -> float:
        """Force that it holds, newtons."""
        return _VACUUM * self.radius**2

    @property
    def peeling_moment(self) -> float:
        """Moment that peels its lip off, newton metres: it tips a disk held by that force over its edge."""
        return self.holding_force * self.radius

    def is_wider_than(self, size: Sequence[float]) -> bool:
        """Whether its lip fits on no face of a box of ``size`` (3,), metres."""
        return sorted(size)[1] < 2 * self.lip


CUP: Final = Nozzle(CUP_RADIUS, 0.008)
NARROW: Final = Nozzle(0.004, 0.0028)
"""For objects under 16 mm: on a cube of 1 cm its body stays 1 mm from the edges."""
