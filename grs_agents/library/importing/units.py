"""Metres, and z up."""

from typing import Final

import numpy as np

from grs_agents.library.importing.types import METRES, Floats, Unit, Up

USUAL: Final = (0.02, 0.7)
"""Longest extent (m) that a thing on a table usually has."""
POSSIBLE: Final = (0.003, 3.0)
_TURNS: Final[dict[str, Floats]] = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
}
"""Rotations that take an axis to z."""


def guess_unit(extent: float) -> tuple[Unit, str]:
    """The unit in which ``extent``, the longest of a thing, is usual on a table, and a note where it was not clear."""
    units: tuple[Unit, ...] = ("m", "cm", "mm")
    low, high = USUAL
    fitting: list[Unit] = [unit for unit in units if low <= extent * METRES[unit] <= high]
    if not fitting:
        low, high = POSSIBLE
        fitting = [unit for unit in units if low <= extent * METRES[unit] <= high]
    if not fitting:
        return "m", f"its longest extent is {extent:.4g}, which is usual in no unit"
    note = (
        f"the unit is not said; {fitting[0]} was taken, for which it is {100 * extent * METRES[fitting[0]]:.3g} cm long"
    )
    if len(fitting) > 1:
        note += f" ({' and '.join(fitting[1:])} would do as well)"
    return fitting[0], note if fitting[0] != "m" or len(fitting) > 1 else ""


def turn_up(up: Up) -> Floats:
    """The rotation (3, 3) that takes the axis ``up`` to z."""
    return _TURNS["z" if up == "auto" else up]


def up_by_height(extents: Floats, height: float, usual: Up) -> Up:
    """The axis along which a thing of these extents is ``height`` high; ``usual`` where another is no better by 5 %.

    Args:
        extents: (3,) along x, y, z, m.
        height: what it is known to be, m.
        usual: the axis of its format.
    """
    axes: tuple[Up, ...] = ("x", "y", "z")
    errors = {axis: abs(float(extent) - height) / height for axis, extent in zip(axes, extents, strict=True)}
    best = min(axes, key=lambda axis: errors[axis])
    return best if usual == "auto" or errors[best] < errors[usual] - 0.05 else usual
