"""The colours of pieces, and whether they say that two pieces are one object."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.image_geometry import Index, Labels, compute_percentiles, pixels_by_label
from grs_agents.perception.segmentation.configuration import PlainColor
from grs_agents.perception.types import Array, Image

Colors = npt.NDArray[np.float32]
_BLACK = 16.0  # of CIE L*: L* + 16 is as the cube root of the luminance


def lab_colors(rgb: Image) -> Colors:
    """(H, W, 3) CIE L*, a* and b* of a photo."""
    return np.asarray(cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float32)


def color_bins(colors: Colors) -> Index:
    """(H, W) the bin of each CIE L*a*b* colour: five of lightness, twelve each of a* and b* from -60 to 60."""
    light, red, yellow = np.moveaxis(colors, -1, 0)
    return (
        np.clip(light // 20, 0, 4) * 144 + np.clip(red // 10 + 6, 0, 11) * 12 + np.clip(yellow // 10 + 6, 0, 11)
    ).astype(np.intp)


def color_histogram(bins: Index) -> Array:
    """(720,) square roots of the shares of colours by bin. The product of two histograms is 1 where they agree
    (Bhattacharyya coefficient)."""
    counts = np.bincount(bins, minlength=720).reshape(5, 12, 12).astype(np.float64)
    spread = cv2.GaussianBlur(np.moveaxis(counts, 0, -1), (5, 5), 0.6).reshape(144, 5)
    spread = cv2.GaussianBlur(spread, (5, 1), 0.8).ravel()  # noise at the limit of two bins falls into both
    return np.sqrt(spread / max(float(spread.sum()), 1.0))


@dataclass(frozen=True)
class PieceColor:
    """The colour of a piece inside its border: medians, and the spread of most pixels around them."""

    lightness: float  # CIE L* + 16
    hue: Array  # (2,) a* and b* over L* + 16, which are alike in light and in shadow
    spread: float  # of a* and b*


class PlainColorTest:
    """Tells whether two pieces are of one plain colour, as the plates of a bracket or the wall and the inside of a mug.
    One may be in more light than the other."""

    def __init__(self, labels: Labels, rgb: Image, config: PlainColor) -> None:
        self.config = config
        colors = lab_colors(rgb).reshape(-1, 3)
        square, values = np.ones((3, 3), np.uint8), labels.astype(np.float32)
        inner = np.where(cv2.dilate(values, square) == cv2.erode(values, square), labels, 0).astype(np.int32)
        self.colors = {
            label: _measure_color(colors, pixels)
            for label, pixels in enumerate(pixels_by_label(inner), 1)
            if len(pixels) >= config.fewest
        }

    def is_one_object(self, one: int, other: int) -> bool:
        """Whether two labels, which touch, are of one plain colour."""
        if one not in self.colors or other not in self.colors:
            return False
        first, second, config = self.colors[one], self.colors[other], self.config
        dark, bright = sorted((first.lightness, second.lightness))
        if max(first.spread, second.spread) > config.spread:
            return False
        apart, *chroma = (float(np.linalg.norm(hue)) * dark for hue in (first.hue - second.hue, first.hue, second.hue))
        if min(chroma) > config.chroma:
            return apart < config.colored
        return apart < config.hue and bright**3 <= config.brightness * dark**3


def _measure_color(colors: Colors, pixels: Index) -> PieceColor:
    own = colors.take(pixels, axis=0).astype(np.float64)
    middle = np.median(own, axis=0)
    spread = compute_percentiles(np.abs(own - middle), [80])[0]
    lightness = float(middle[0]) + _BLACK
    return PieceColor(lightness, middle[1:] / lightness, float(np.linalg.norm(spread[1:])))
