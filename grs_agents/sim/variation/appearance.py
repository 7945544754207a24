"""How a varied scene looks: its light and its table top."""

import colorsys
from collections.abc import Sequence
from typing import Final

import numpy as np

from grs_agents.sim.instance.task_instance import InstanceLight, InstanceTable, TaskInstance

_ASIDE: Final = 0.6
"""Metres that the light may be moved along x and y, either way; half of it upwards."""
_LOWEST: Final = 1.0
_DIM, _BRIGHT = 0.6, 1.3
_APART: Final = 0.25
"""Least distance of the table's colours from those of marks on it, of 0..1 in red, green and blue."""
_TRIES: Final = 50
_PATTERNS: Final = ("plain", "checker", "speckled")


def vary_light(light: InstanceLight, rng: np.random.Generator) -> InstanceLight:
    """The light moved by up to 60 cm, and between 0.6 and 1.3 times as bright."""
    x, y, z = light.position
    aside = rng.uniform(-_ASIDE, _ASIDE, 3) * (1.0, 1.0, 0.5)
    direct, everywhere = rng.uniform(_DIM, _BRIGHT, 2)
    return InstanceLight(
        position=(float(x + aside[0]), float(y + aside[1]), max(_LOWEST, float(z + aside[2]))),
        target=light.target,
        diffuse=_scale_color(light.diffuse, float(direct)),
        ambient=_scale_color(light.ambient, float(everywhere)),
    )


def _scale_color(color: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    red, green, blue = (min(1.0, channel * factor) for channel in color)
    return (red, green, blue)


def vary_table(instance: TaskInstance, rng: np.random.Generator) -> InstanceTable:
    """Another table top: its pattern and two colours, neither of them near that of a mark on it."""
    marks = [item.fill["COLOR"] for item in instance.objects if item.category == "fixed" and "COLOR" in item.fill]
    first = _table_color(rng, marks)
    return InstanceTable(
        color=first,
        pattern=_PATTERNS[int(rng.integers(len(_PATTERNS)))],
        second_color=_table_color(rng, marks),
    )


def _table_color(rng: np.random.Generator, marks: Sequence[Sequence[float | str]]) -> tuple[float, float, float, float]:
    """Of a material that tables have: little saturated, neither black nor glaring."""
    red, green, blue = 0.8, 0.72, 0.6
    for _ in range(_TRIES):
        hue, saturation, value = rng.uniform((0.0, 0.0, 0.3), (1.0, 0.45, 0.95))
        red, green, blue = colorsys.hsv_to_rgb(float(hue), float(saturation), float(value))
        away = [np.linalg.norm(np.subtract((red, green, blue), [float(part) for part in mark[:3]])) for mark in marks]
        if min(away, default=1.0) >= _APART:
            break
    return (red, green, blue, 1.0)
