"""Arms, hands, lamps: what comes in from above, or from beyond the picture high over the table, is no object."""

import numpy as np

from grs_agents.perception.frame import Array, Mask
from grs_agents.perception.segmentation.foreground import TALLEST

BORDER = 3
"""What comes within so many pixels of the picture's border is cut by it."""
FEWEST = 10
"""Fewer measured pixels at the border say nothing."""
CLEAR = 0.05
"""At the border an arm is higher than this (m) above the table."""
ROUND = 0.02
"""The heights of the flat top of a thing that the border cuts differ by less than this (m)."""
LONG = 0.15
"""An arm reaches in by more than this (m) along the table."""


def reaches_in(mask: Mask, points: Array) -> bool:
    """Whether a segment, (H, W), comes in from above or from beyond the picture.

    Args:
        mask: (H, W) its pixels.
        points: (H, W, 3) in the robot frame, NaN where unknown.
    """
    whole = _known(points[mask][::5])
    if len(whole) < FEWEST:
        return False
    lowest, highest = np.percentile(whole[:, 2], (2, 99))
    if highest > TALLEST - ROUND:
        return True
    sides = np.ones_like(mask)
    sides[BORDER:, BORDER:-BORDER] = False
    if lowest > CLEAR and len(_known(points[mask & sides])) >= FEWEST:
        return True  # only below the picture could it have a foot
    sides[-BORDER:] = True
    cut = _known(points[mask & sides])
    if len(cut) < FEWEST:
        return False
    low, high = np.percentile(cut[:, 2], (5, 95))
    reach = np.linalg.norm(whole[:, :2] - np.median(cut[:, :2], axis=0), axis=1)
    return bool(low > CLEAR and high - low > ROUND and np.percentile(reach, 98) > LONG)


def _known(points: Array) -> Array:
    return points[np.isfinite(points[:, 2])]
