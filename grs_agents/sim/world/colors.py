"""Colours as programs write them."""

from collections.abc import Sequence

from grs_agents.sim.cliport import utils
from grs_agents.sim.instance.episode import SimulationError


def rgba(color: str | Sequence[float]) -> tuple[float, float, float, float]:
    """Red, green, blue, alpha, each 0..1, of a name of ``utils.COLORS`` or of three or four numbers.

    Raises:
        SimulationError: it is neither.
    """
    if isinstance(color, str):
        if color not in utils.COLORS:
            raise SimulationError(f"colour {color!r} is unknown", f"use one of {', '.join(sorted(utils.COLORS))}")
        color = utils.COLORS[color]
    values = [min(max(float(value), 0.0), 1.0) for value in color]
    if len(values) not in (3, 4):
        raise SimulationError(f"colour {list(color)!r} is not (r, g, b)", "give three numbers in 0..1")
    return (values[0], values[1], values[2], values[3] if len(values) == 4 else 1.0)
