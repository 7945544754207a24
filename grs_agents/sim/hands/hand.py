"""A hand: the bodies beyond a flange, built the same on every arm."""

from collections.abc import Sequence
from typing import Any, Final, Literal, Protocol

Tool = Literal["suction", "spatula", "fingers"]
"""Working principle of the tool at the end of the arm."""
DEFAULT_HAND: Final = "suction"
"""Configured name of the hand where none is named."""
GRAVITY: Final = 9.81
"""Gravitational acceleration, m/s^2."""
ROBOT_CONTYPE: Final = 2
"""Robot geoms meet geoms whose ``conaffinity`` has this bit: objects, not the table and not the robot."""


class Hand(Protocol):
    """A hand that is fixed to a flange; z of the flange's frame points out of it.

    ``add_to`` adds the body ``body``, with the site ``tip`` at ``length`` from the flange along z, to a spec.
    """

    @property
    def name(self) -> str:
        """Configured name."""
        ...

    @property
    def tool(self) -> Tool:
        """Working principle."""
        ...

    @property
    def body(self) -> str:
        """Name of the body at the flange."""
        ...

    @property
    def length(self) -> float:
        """Distance from the flange to the tip, metres."""
        ...

    def add_to(
        self,
        spec: Any,
        flange: Any,
        position: Sequence[float],
        quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        moving: bool = True,
    ) -> None:
        """Add the hand to the body ``flange`` of a spec, at ``position`` (m) and ``quaternion`` (wxyz) in its frame.

        Without ``moving`` its parts are fixed, wide open, as for the kinematics of the arm alone.
        """
        ...
