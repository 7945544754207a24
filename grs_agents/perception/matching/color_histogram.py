"""Histograms of tone: log brightness, log red/green, log blue/green. Light changes mostly the first."""

import numpy as np
import numpy.typing as npt

from grs_agents.perception.types import Array

LEVELS, HUES = 12, 10
BINS = LEVELS * HUES * HUES
_DARK = 0.03  # added to each channel against noise in the dark
LOWEST_LEVEL, LEVEL_WIDTH = -3.3, 0.3  # natural logarithms of brightness
_REACH = 1.3  # bound on the log ratios
_SHARP = (1.2, 0.7)  # standard deviation of the soft bins: of brightness, of hue


def to_log_opponent_colors(colors: Array) -> Array:
    """Natural logarithms (N, 3) of brightness, red/green and blue/green of colours (N, 3) in 0..1."""
    red, green, blue = (colors[:, channel] + _DARK for channel in range(3))
    level = np.log(np.maximum(0.3 * red + 0.55 * green + 0.15 * blue, 1e-3))
    return np.stack([level, np.log(red / green), np.log(blue / green)], axis=1)


def histograms_from_rgb(colors: Array, weights: Array) -> npt.NDArray[np.float32]:
    """Square roots (V, BINS), of length 1, of histograms of colours (N, 3), for each row of weights (V, N)."""
    return histograms_from_log_colors(to_log_opponent_colors(colors), weights)


def histograms_from_log_colors(log_colors: Array, weights: Array) -> npt.NDArray[np.float32]:
    """As `histograms_from_rgb`, of log opponent colours (N, 3)."""
    level = _soft_assign_to_bins((log_colors[:, 0] - LOWEST_LEVEL) / LEVEL_WIDTH, LEVELS, _SHARP[0])
    places = (np.clip(log_colors[:, 1:3], -_REACH, _REACH) / _REACH + 1) / 2 * (HUES - 1)
    hues = [_soft_assign_to_bins(places[:, part], HUES, _SHARP[1]) for part in range(2)]
    both = np.einsum("nj,nk->njk", *hues).reshape(len(log_colors), HUES * HUES)
    summed = np.stack([((level * row[:, None]).T @ both).ravel() for row in weights])
    shares = summed / np.maximum(summed.sum(axis=1, keepdims=True), 1e-12)
    return np.sqrt(shares).astype(np.float32)


def shift_histogram_brightness(roots: npt.NDArray[np.float32], levels: int) -> npt.NDArray[np.float32]:
    """Histograms (V, BINS) of the same colours, brighter by ``levels`` levels of brightness."""
    grid = roots.reshape(-1, LEVELS, HUES * HUES)
    moved = np.zeros_like(grid)
    for level in range(LEVELS):
        target = min(max(level + levels, 0), LEVELS - 1)
        moved[:, target] = np.sqrt(moved[:, target] ** 2 + grid[:, level] ** 2)
    return moved.reshape(roots.shape)


def _soft_assign_to_bins(places: Array, count: int, width: float) -> Array:
    """Shares (N, count) of the bins around places (N,)."""
    apart = np.clip(places, 0, count - 1)[:, None] - np.arange(count)
    shares = np.exp(-0.5 * (apart / width) ** 2)
    return shares / shares.sum(axis=1, keepdims=True)
