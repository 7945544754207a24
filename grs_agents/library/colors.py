"""Colour names: a palette for cubes, proxies and descriptions."""

import colorsys

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3

COLORS: dict[str, Vec3] = {
    "red": (0.85, 0.16, 0.16),
    "green": (0.20, 0.62, 0.25),
    "blue": (0.16, 0.36, 0.80),
    "yellow": (0.95, 0.79, 0.15),
    "orange": (0.95, 0.50, 0.12),
    "purple": (0.50, 0.25, 0.65),
    "cyan": (0.25, 0.75, 0.80),
    "brown": (0.45, 0.29, 0.18),
    "pink": (0.95, 0.60, 0.68),
    "gray": (0.52, 0.52, 0.52),
    "white": (0.95, 0.95, 0.95),
    "black": (0.10, 0.10, 0.10),
}
"""Red, green, blue in 0..1 by name."""

_HUES = ((15, "red"), (42, "orange"), (68, "yellow"), (165, "green"), (200, "cyan"), (255, "blue"), (315, "purple"))
"""Upper bounds of the hues, degrees; from 315 on the hue is red again."""
_SHARE = 0.08
"""Least share of the surface for a second or third colour."""


def color_name_from_rgb(rgb: Vec3) -> str:
    """The name in `COLORS` that a person would give a colour (red, green, blue in 0..1)."""
    hue, saturation, value = colorsys.rgb_to_hsv(*rgb)
    if value < 0.18:
        return "black"
    if saturation < 0.18:
        return "white" if value > 0.78 else "gray"
    degrees = hue * 360
    name = next((name for limit, name in _HUES if degrees < limit), "red")
    if name in ("red", "orange") and value < 0.62 and degrees >= 8 and saturation < 0.85:
        return "brown"
    return "pink" if name in ("red", "purple") and value > 0.7 and saturation < 0.5 else name


def main_color_names(
    colors: npt.NDArray[np.uint8], step: int, amounts: npt.NDArray[np.float64] | None = None
) -> list[str]:
    """Names of the colours among (N, 3) reds, greens and blues, the most frequent first, at most three.

    Args:
        colors: of points.
        step: colours that differ by less in each channel count as equal.
        amounts: (N,) weights of the points; 1 by default.
    """
    levels, number = np.unique(colors // step, axis=0, return_inverse=True)
    shares: dict[str, float] = {}
    for level, amount in zip(levels, np.bincount(number.ravel(), amounts, len(levels)), strict=True):
        red, green, blue = ((float(channel) * step + step / 2) / 255 for channel in level)
        name = color_name_from_rgb((min(red, 1.0), min(green, 1.0), min(blue, 1.0)))
        shares[name] = shares.get(name, 0.0) + float(amount)
    total = sum(shares.values()) or 1.0
    ranked = sorted(shares, key=lambda name: (-shares[name], name))
    return ranked[:1] + [name for name in ranked[1:3] if shares[name] >= _SHARE * total]
