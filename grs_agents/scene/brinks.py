"""Where one part is seen over the upper edge of another: the inside of a hollow thing, or a thing behind a thing.

Along the edge of a hollow thing what is seen lies deep in the middle and comes up to the rim at both ends, where the
near wall meets the far one. A thing behind a thing stays as deep, or goes on down beside it."""

import numpy as np
import numpy.typing as npt

from grs_agents.scene.frame import Array
from grs_agents.scene.geometry import DEEP, Labels

END = 0.2
"""This share of an edge's columns is its end."""
RISEN = 0.5
"""At both ends of a rim the inside comes up to at least this share of its height."""
SPAN = 0.5
"""The edge spans at least this share of the narrower part's columns."""
FEWEST = 8
"""An edge of fewer columns says nothing."""


class Brinks:
    """The upper edges of the parts of an (H, W) label image, and how deep lies the next part that is seen over them.

    Args:
        labels: (H, W), 0 where no part is.
        heights: (H, W) metres above the table.
    """

    def __init__(self, labels: Labels, heights: Array) -> None:
        rows, columns = np.nonzero((labels[1:] != labels[:-1]) & (labels[1:] > 0))
        numbers = np.arange(len(labels))[:, None]
        at = np.maximum.accumulate(np.where(labels > 0, numbers, -1), axis=0)[rows, columns]
        seen = at >= 0
        rows, at, self.columns = rows[seen] + 1, at[seen], columns[seen]
        self.near, self.far = labels[rows, self.columns], labels[at, self.columns]
        self.heights = np.fmin(heights[rows, self.columns], heights[at, self.columns])

    def rename(self, old: int, new: int) -> None:
        """Part ``old`` has become a piece of ``new``."""
        self.near[self.near == old] = new
        self.far[self.far == old] = new

    def span(self, near: int, far: int, width: int) -> bool:
        """Whether ``far`` is seen over most of the edge of ``near``; the narrower of them is ``width`` columns wide.

        What stands in a hollow thing has its far wall behind it, and a whole hollow thing its own inside: these are
        no edges of a wall.
        """
        columns = self._columns(near, far)
        own = np.isin(columns, self._columns(near, near)).sum()
        other = max(int(own), len(self._columns(far, near)))
        return len(columns) >= max(SPAN * width, FEWEST) and other <= SPAN * len(columns)

    def _columns(self, near: int, far: int) -> npt.NDArray[np.int64]:
        return self.columns[(self.near == near) & (self.far == far)]

    def closes(self, near: int, far: int, top: float) -> bool:
        """Whether what is seen of ``far`` over ``near`` comes up at both ends to about ``top``, their height (m)."""
        pairs = (self.near == near) & (self.far == far) & np.isfinite(self.heights)
        columns, heights = self.columns[pairs], self.heights[pairs]
        if len(columns) < FEWEST:
            return False
        first, last = np.quantile(columns, (END, 1 - END))
        middle = float(np.percentile(heights[(columns >= first) & (columns <= last)], 10))
        ends = min(float(heights[columns <= first].max()), float(heights[columns >= last].max()))
        return ends > max(RISEN * top, middle + DEEP)
