"""The suction cup: a round nozzle that holds by vacuum, and its geoms at a flange."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import ROBOT_CONTYPE, Tool

CUP_RADIUS: Final = 0.010
_VACUUM: Final = 15.0 / CUP_RADIUS**2
"""Holding force per squared radius, N/m^2: a vacuum of 60 kPa on a disk of 20 mm (18.8 N), times 0.8, is 15 N."""
TOOL_LENGTH: Final = 0.15
"""From the flange to the tip of the suction cup, metres."""


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


class SuctionCupHand:
    """The suction cup at a flange: body and geom ``cup``, site ``tip``."""

    name, body, length = "suction", "cup", TOOL_LENGTH
    tool: Tool = "suction"

    def add_to(
        self,
        spec: Any,
        flange: Any,
        position: Sequence[float],
        quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        moving: bool = True,
    ) -> None:
        """Fix the cup to a flange; it has no moving parts."""
        del spec, moving
        cup = flange.add_body(name="cup", pos=position, quat=quaternion, gravcomp=1.0)
        shared: dict[str, Any] = {"contype": ROBOT_CONTYPE, "conaffinity": 0, "group": 1}
        size = (0.008, 0, 0)
        fromto = (0, 0, 0.0, 0, 0, TOOL_LENGTH - 0.025)
        rgba = (0.2, 0.2, 0.22, 1.0)
        cup.add_geom(
            name="tool", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=size, mass=0.1, fromto=fromto, rgba=rgba, **shared
        )
        cup.add_geom(
            name="cup",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=(CUP_RADIUS, 0.01, 0),
            mass=0.05,
            pos=(0, 0, TOOL_LENGTH - 0.01),
            rgba=(0.1, 0.1, 0.1, 1.0),
            **shared,
        )
        cup.add_site(name="tip", pos=(0, 0, TOOL_LENGTH), size=(0.003, 0.003, 0.003))


SUCTION_CUP: Final = SuctionCupHand()
