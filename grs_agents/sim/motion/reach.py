"""What the arm can serve and how targets are spoken of: shared by the ways of choosing a target."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.motion.placement import Spot
from grs_agents.sim.world.footprints import Prism

FloatArray = npt.NDArray[np.float64]
TALLEST_STACK: Final = 0.32
"""The arm carries things safely over stacks up to this height, metres."""
_APPROACH: Final = 0.04


@dataclass(frozen=True)
class Blocked:
    """The target is taken by something that can be moved away first.

    Attributes:
        blocker: its id.
        keep_free: where it must not be put.
        otherwise: the target all the same, if the blocker cannot be moved; None if it must be.
    """

    blocker: int
    keep_free: tuple[Prism, ...] = ()
    otherwise: Spot | None = None


Target = Spot | Blocked | Stop


def wrap(angle: float, period: float = 2 * np.pi) -> float:
    """The angle nearest zero that differs by a multiple of ``period``."""
    return float(angle - period * np.round(angle / period))


@dataclass(frozen=True)
class Suits:
    """A test of offsets (N, 2) and rest heights (N,): can the arm bring the cup there and come down from above?"""

    lift: float
    arm: Arm

    def __call__(self, offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        tips = np.column_stack([offsets, heights + self.lift])
        above = tips + np.array([0.0, 0.0, _APPROACH])
        return self.arm.reachable(tips) & self.arm.reachable(above)


def reach_note(tip: Sequence[float], arm: Arm) -> str:
    """How a point lies out of reach, in words."""
    distance = float(np.hypot(tip[0], tip[1]))
    if distance > arm.farthest:
        return f"is {distance:.2f} m from the base, reach is {arm.farthest:.2f} m"
    if distance < arm.nearest:
        return f"is {distance:.2f} m from the base, nearest is {arm.nearest:.2f} m"
    return f"cannot be reached at height {tip[2]:.2f} m with the tool down, {distance:.2f} m from the base"


def at(point: Sequence[float]) -> str:
    """A point (x, y, z) in words, to the centimetre."""
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
