"""Where an arm can bring its tip with the tool straight down, tabulated once and then looked up."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm_model import ArmModel
from grs_agents.sim.arms.arm_parts import DOWN
from grs_agents.sim.arms.joint_paths import rotations_about_z

_RADII: Final = np.arange(0.14, 1.2, 0.025)
_HEIGHTS: Final = np.concatenate([[0.001], np.arange(0.05, 0.71, 0.06)])
_BEARINGS: Final = np.linspace(-np.pi / 2, np.pi / 2, 13)
_EXPLORING: Final = 25


@dataclass(frozen=True)
class ReachTable:
    """Reach on a grid about the base axis."""

    served: npt.NDArray[np.bool_]  # (bearings, radii, heights); a single bearing stands for all
    bearings: tuple[float, float]  # lowest and highest that a base which turns allows, radians

    @property
    def reachable_radius_range(self) -> tuple[float, float]:
        """The least and the greatest radius that is served anywhere, metres."""
        radii = _RADII[self.served.any(axis=(0, 2))]
        return (float(radii.min()), float(radii.max())) if len(radii) else (0.0, 0.0)

    def __call__(self, tips: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of the points (N, 3) lie in a cell all of whose corners are served."""
        bearing, radius = np.arctan2(tips[:, 1], tips[:, 0]), np.hypot(tips[:, 0], tips[:, 1])
        inside = (bearing >= self.bearings[0]) & (bearing <= self.bearings[1])
        inside &= (radius >= _RADII[0]) & (radius <= _RADII[-1])
        inside &= (tips[:, 2] >= 0.0) & (tips[:, 2] <= _HEIGHTS[-1])
        r = (np.searchsorted(_RADII, radius, side="right") - 1).clip(0, len(_RADII) - 2)
        h = (np.searchsorted(_HEIGHTS, tips[:, 2], side="right") - 1).clip(0, len(_HEIGHTS) - 2)
        b = (np.searchsorted(_BEARINGS, bearing, side="right") - 1).clip(0, len(_BEARINGS) - 2)
        if len(self.served) == 1:
            b = np.zeros_like(b)
        corners = [(b, r + i, h + j) for i in (0, 1) for j in (0, 1)]
        if len(self.served) > 1:
            corners += [(b + 1, r + i, h + j) for i in (0, 1) for j in (0, 1)]
        for corner in corners:
            inside &= self.served[corner]
        return inside


def build_reach_table(posture: ArmModel, home: FloatArray) -> ReachTable:
    """Try the arm on the grid, each point from a neighbour that was served."""
    turning = posture.has_vertical_base_hinge()
    bearings = np.zeros(1) if turning else _BEARINGS
    served = np.array([_reachable_cells_at_bearing(float(bearing), posture, home) for bearing in bearings])
    low, high = (posture.low[0] - home[0], posture.high[0] - home[0]) if turning else (-np.pi / 2, np.pi / 2)
    return ReachTable(served, (float(low), float(high)))


def _reachable_cells_at_bearing(bearing: float, posture: ArmModel, home: FloatArray) -> npt.NDArray[np.bool_]:
    """Which radii and heights (R, H) the arm serves at one bearing (rad)."""
    tool = rotations_about_z(np.array([bearing]))[0] @ DOWN
    served = np.zeros((len(_RADII), len(_HEIGHTS)), dtype=bool)
    nearer: dict[int, FloatArray] = {}  # joint positions at the radius before, by the index of the height
    for row, radius in enumerate(_RADII):
        above: FloatArray | None = None
        before, nearer = nearer, dict[int, FloatArray]()
        for column in reversed(range(len(_HEIGHTS))):
            point = np.array([radius * np.cos(bearing), radius * np.sin(bearing), _HEIGHTS[column]])
            near = (above, *(before.get(column + step) for step in (0, 1, -1)))
            start = next((joints for joints in near if joints is not None), None)
            if start is None and served.any():
                continue
            above = posture.solve_ik(point, tool, home if start is None else start, home, _EXPLORING)
            if above is not None and posture.first_collision_along(above[None]) is not None:
                above = None
            if above is not None:
                served[row, column], nearer[column] = True, above
    return served
