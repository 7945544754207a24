"""Histograms of tone: how bright, how red against green, how blue against green; light changes the first the most."""

import numpy as np
import numpy.typing as npt

from grs_agents.perception.types import Array

LEVELS, HUES = 12, 10
BINS = LEVELS * HUES * HUES
_DARK = 0.03  # added to each channel, so that noise in the dark is no hue
_LOW, _STEP = -3.3, 0.3  # natural logarithm of the brightness where the levels begin, and the width of one
_REACH = 1.3  # logarithms of the ratios beyond this count as this
_SHARP = (1.2, 0.7)  # how far a colour spills over, in bins: of brightness, of hue


def to_log_opponent_colors(colors: Array) -> Array:
    """(N, 3) brightness and the two ratios, as natural logarithms, of colours (N, 3) in 0..1."""
    red, green, blue = (colors[:, channel] + _DARK for channel in range(3))
    level = np.log(np.maximum(0.3 * red + 0.55 * green + 0.15 * blue, 1e-3))
    return np.stack([level, np.log(red / green), np.log(blue / green)], axis=1)


def histograms_from_rgb(colors: Array, weights: Array) -> npt.NDArray[np.float32]:
    """(V, BINS) square roots of histograms of colours (N, 3), one for each row of weights (V, N); of length 1."""
    return histograms_from_log_colors(to_log_opponent_colors(colors), weights)


def histograms_from_log_colors(log_colors: Array, weights: Array) -> npt.NDArray[np.float32]:
    """As `histograms_from_rgb`, of tones (N, 3)."""
    level = _soft_assign_to_bins((log_colors[:, 0] - _LOW) / _STEP, LEVELS, _SHARP[0])
    places = (np.clip(log_colors[:, 1:3], -_REACH, _REACH) / _REACH + 1) / 2 * (HUES - 1)
    hues = [_soft_assign_to_bins(places[:, part], HUES, _SHARP[1]) for part in range(2)]
    both = np.einsum("nj,nk->njk", *hues).reshape(len(log_colors), HUES * HUES)
    summed = np.stack([((level * row[:, None]).T @ both).ravel() for row in weights])
    shares = summed / np.maximum(summed.sum(axis=1, keepdims=True), 1e-12)
    return np.sqrt(shares).astype(np.float32)


def shift_histogram_brightness(roots: npt.NDArray[np.float32], levels: int) -> npt.NDArray[np.float32]:
    """Histograms (V, BINS) of the same colours in more light by so many levels of brightness, or in less."""
    grid = roots.reshape(-1, LEVELS, HUES * HUES)
    moved = np.zeros_like(grid)
    for level in range(LEVELS):
        target = min(max(level + levels, 0), LEVELS - 1)
        moved[:, target] = np.sqrt(moved[:, target] ** 2 + grid[:, level] ** 2)
    return moved.reshape(roots.shape)


def _soft_assign_to_bins(places: Array, count: int, width: float) -> Array:
    """(N, count) shares of bins around places."""
    apart = np.clip(places, 0, count - 1)[:, None] - np.arange(count)
    shares = np.exp(-0.5 * (apart / width) ** 2)
    return shares / shares.sum(axis=1, keepdims=True)
