"""What is known of the walls of a bin once they are found."""

from dataclasses import dataclass, field

import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.wall import SIDES, Wall
from grs_agents.perception.types import Array, Mask


@dataclass(frozen=True)
class SeenWalls:
    """Where a photo shows the walls of a bin; nowhere where there is none."""

    pixels: Mask  # (H, W)
    mixed: Mask  # (H, W) beside the robot, and so near to a wall, or beyond it, that the depth may be mixed of both
    walls: tuple[Wall, ...] = ()
    axes: Array = field(default_factory=lambda: np.eye(2))  # (2, 2) the directions across them

    def has_as_rim(self, segment: Array, others: Array) -> bool:
        """Whether a segment is what the robot leaves of the rim of one more wall: long, thin and level, as high as the
        other rims, and nothing lies beyond it.

        Args:
            segment: (N, 3) its points, robot frame.
            others: (M, 3) those of the other segments.
        """
        segment, others = (points[np.isfinite(points[:, 2])] for points in (segment, others))
        if not self.walls or not len(segment):
            return False
        low, middle, high = np.percentile(segment[:, 2], (10, 50, 90))
        if abs(middle - self.walls[0].height) > CONFIG.level or high - low > CONFIG.level:
            return False
        found = {wall.side for wall in self.walls}
        return any(self._is_rim_of(side, segment, others) for side in range(len(SIDES)) if side not in found)

    def _is_rim_of(self, side: int, segment: Array, others: Array) -> bool:
        axis, sign = SIDES[side]
        local = segment[:, :2] @ self.axes.T
        inner, outer = np.percentile(sign * local[:, axis], (10, 90))
        start, end = np.percentile(local[:, 1 - axis], (2, 98))
        beyond = np.count_nonzero(sign * (others[:, :2] @ self.axes.T)[:, axis] > inner)
        return bool(
            outer - inner < CONFIG.thick and end - start > CONFIG.short and beyond <= CONFIG.stray * len(others)
        )
