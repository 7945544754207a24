"""Colours by name and as numbers."""

import math
from collections.abc import Sequence

from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject


def color_to_rgba(color: str | Sequence[float], what: str = "") -> tuple[float, float, float, float]:
    """Red, green, blue, alpha, 0..1, from a name or three or four numbers.

    Raises ``SimulationError`` for anything else; its message begins with ``what``.
    """
    if isinstance(color, str):
        if color not in COLORS:
            raise SimulationError(f"{what}colour {color!r} is unknown", f"use one of {', '.join(sorted(COLORS))}")
        color = COLORS[color]
    try:
        values = [min(max(float(value), 0.0), 1.0) for value in color]
    except (TypeError, ValueError):
        values = []
    if len(values) not in (3, 4) or any(math.isnan(value) for value in values):
        raise SimulationError(f"{what}colour {color!r} is not (r, g, b)"[:300], "give three numbers in 0..1")
    return (values[0], values[1], values[2], values[3] if len(values) == 4 else 1.0)


def painted_color(item: InstanceObject) -> str:
    """The nearest name in ``COLORS`` of an object that the program painted; empty for any other object."""
    rgb = item.color or tuple(float(value) for value in item.fill.get("COLOR", ()) if not isinstance(value, str))
    return min(COLORS, key=lambda name: math.dist(COLORS[name], rgb[:3])) if len(rgb) >= 3 else ""


COLORS: dict[str, list[float]] = {
    "blue": [78 / 255, 121 / 255, 167 / 255],
    "red": [255 / 255, 87 / 255, 89 / 255],
    "green": [89 / 255, 169 / 255, 79 / 255],
    "orange": [242 / 255, 142 / 255, 43 / 255],
    "yellow": [237 / 255, 201 / 255, 72 / 255],
    "purple": [176 / 255, 122 / 255, 161 / 255],
    "pink": [255 / 255, 157 / 255, 167 / 255],
    "cyan": [118 / 255, 183 / 255, 178 / 255],
    "brown": [156 / 255, 117 / 255, 95 / 255],
    "white": [1.0, 1.0, 1.0],
    "gray": [186 / 255, 176 / 255, 172 / 255],
    "indigo": [75 / 255, 0.0, 130 / 255],
    "violet": [143 / 255, 0.0, 1.0],
    "black": [0.05, 0.05, 0.05],
    "silver": [192 / 255, 192 / 255, 192 / 255],
    "gold": [1.0, 215 / 255, 0.0],
}
"""Colour name to [r, g, b], each 0..1; lists, since programs append the alpha to them."""
