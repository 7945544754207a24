"""Pieces of one plain colour that touch are one object: the plates of a bracket, the wall and the inside of a mug."""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.image_geometry import Index, Labels, compute_percentiles, pixels_by_label
from grs_agents.perception.segmentation.configuration import PlainColor
from grs_agents.perception.types import Array, Image

_BLACK = 16.0  # of CIE L*: L* + 16 is as the cube root of the luminance


@dataclass(frozen=True)
class PieceColor:
    """The colour of a piece inside its border: medians, and the spread of most pixels around them."""

    lightness: float  # CIE L* + 16
    hue: Array  # (2,) a* and b* over L* + 16, which are alike in light and in shadow
    spread: float  # of a* and b*


class PlainColorTest:
    """Tells whether two pieces are of one plain colour, one of them perhaps in more light."""

    def __init__(self, labels: Labels, rgb: Image, config: PlainColor) -> None:
        self.config = config
        color = np.asarray(cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float64).reshape(-1, 3)
        square, values = np.ones((3, 3), np.uint8), labels.astype(np.float32)
        inner = np.where(cv2.dilate(values, square) == cv2.erode(values, square), labels, 0).astype(np.int32)
        self.colors = {
            label: _measure_color(color, pixels)
            for label, pixels in enumerate(pixels_by_label(inner), 1)
            if len(pixels) >= config.fewest
        }

    def is_one_object(self, one: int, other: int) -> bool:
        """Whether two labels, which touch, are of one plain colour."""
        if one not in self.colors or other not in self.colors:
            return False
        first, second, config = self.colors[one], self.colors[other], self.config
        dark, bright = sorted((first.lightness, second.lightness))
        if max(first.spread, second.spread) > config.spread or bright**3 > config.brightness * dark**3:
            return False
        return bool(np.linalg.norm(first.hue - second.hue) * dark < config.hue)


def _measure_color(color: Array, pixels: Index) -> PieceColor:
    own = color.take(pixels, axis=0)
    middle = np.median(own, axis=0)
    spread = compute_percentiles(np.abs(own - middle), [80])[0]
    lightness = float(middle[0]) + _BLACK
    return PieceColor(lightness, middle[1:] / lightness, float(np.linalg.norm(spread[1:])))
