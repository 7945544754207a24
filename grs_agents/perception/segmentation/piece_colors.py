"""Colours of pieces: histograms, and the test whether two pieces have the same plain colour."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.image_geometry import Index, Labels, compute_percentiles, pixels_by_label
from grs_agents.perception.segmentation.configuration import PlainColor
from grs_agents.perception.types import Array, Image

Colors = npt.NDArray[np.float32]
COLOR_BINS = 720  # of lightness, a* and b*
_BLACK = 16.0  # of CIE L*: L* + 16 is proportional to the cube root of the luminance


def lab_colors(rgb: Image) -> Colors:
    """(H, W, 3) CIE L*, a* and b* of a photo."""
    return np.asarray(cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float32)


def color_bins(colors: Colors) -> Index:
    """(H, W) bins of CIE L*a*b* colours: five of lightness, twelve each of a* and b* from -60 to 60."""
    light, red, yellow = np.moveaxis(colors, -1, 0)
    return (
        np.clip(light // 20, 0, 4) * 144 + np.clip(red // 10 + 6, 0, 11) * 12 + np.clip(yellow // 10 + 6, 0, 11)
    ).astype(np.intp)


def color_histogram(bins: Index) -> Array:
    """(720,) square roots of the shares of colours by bin. The dot product of two histograms is their Bhattacharyya
    coefficient: 1 if they agree."""
    counts = np.bincount(bins, minlength=COLOR_BINS).reshape(5, 12, 12).astype(np.float64)
    spread = cv2.GaussianBlur(np.moveaxis(counts, 0, -1), (5, 5), 0.6).reshape(144, 5)
    spread = cv2.GaussianBlur(spread, (5, 1), 0.8).ravel()  # noise at the boundary of two bins falls into both
    return np.sqrt(spread / max(float(spread.sum()), 1.0))


@dataclass(frozen=True)
class PieceColor:
    """The colour of a piece inside its border: medians, and the spread of most pixels around them."""

    lightness: float  # CIE L* + 16
    hue: Array  # (2,) a* and b* over L* + 16, invariant to light and shadow
    spread: float  # of a* and b*


class PlainColorTest:
    """Tests whether two pieces have the same plain colour, as the plates of a bracket or the wall and the inside of a
    mug. Either piece may be in more light."""

    def __init__(self, labels: Labels, rgb: Image, config: PlainColor) -> None:
        self.config = config
        colors = lab_colors(rgb).reshape(-1, 3)
        square, values = np.ones((3, 3), np.uint8), labels.astype(np.float32)
        inner = np.where(cv2.dilate(values, square) == cv2.erode(values, square), labels, 0).astype(np.int32)
        self.colors: dict[int, PieceColor] = {}
        for label, pixels in enumerate(pixels_by_label(inner), 1):
            if len(pixels) >= config.fewest:
                sample = colors.take(pixels, axis=0).astype(np.float64)
                middle = np.median(sample, axis=0)
                spread = compute_percentiles(np.abs(sample - middle), [80])[0]
                lightness = float(middle[0]) + _BLACK
                self.colors[label] = PieceColor(lightness, middle[1:] / lightness, float(np.linalg.norm(spread[1:])))

    def is_one_object(self, first: int, second: int) -> bool:
        """Whether two touching labels have the same plain colour."""
        if first not in self.colors or second not in self.colors:
            return False
        a, b, config = self.colors[first], self.colors[second], self.config
        dark, bright = sorted((a.lightness, b.lightness))
        if max(a.spread, b.spread) > config.spread:
            return False
        apart = float(np.linalg.norm(a.hue - b.hue)) * dark
        return apart < config.hue and bright**3 <= config.brightness * dark**3
