"""Statistics of a feature as LeRobot keeps them, of one episode and of all."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray

Statistics = dict[str, FloatArray]
"""``min``, ``max``, ``mean``, ``std``, quantiles ``q01`` to ``q99``, and ``count`` (1,)."""
_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_SAMPLED: Final = 20
"""Pictures of an episode that its statistics are taken of."""


def measure_rows(rows: npt.NDArray[Any]) -> Statistics:
    """Of the columns of rows (T, D) or (T,)."""
    values = np.asarray(rows, dtype=np.float64).reshape(len(rows), -1)
    found: Statistics = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
    }
    return found | dict(zip(_QUANTILES, np.quantile(values, [*_QUANTILES.values()], axis=0), strict=True))


def measure_images(images: npt.NDArray[np.uint8]) -> Statistics:
    """Of the channels of pictures (T, H, W, 3), 0..1; each statistic is (3, 1, 1)."""
    sample = images[:: max(1, len(images) // _SAMPLED)]
    levels = np.arange(256) / 255
    counts = np.stack([np.bincount(sample[..., channel].ravel(), minlength=256) for channel in range(3)])
    shares = counts / counts.sum(axis=1, keepdims=True)
    total, present = shares.cumsum(axis=1), counts > 0
    mean = shares @ levels
    found: Statistics = {
        "min": levels[present.argmax(axis=1)],
        "max": levels[255 - present[:, ::-1].argmax(axis=1)],
        "mean": mean,
        "std": np.sqrt((shares * (levels - mean[:, None]) ** 2).sum(axis=1)),
    }
    found |= {name: levels[(total >= share).argmax(axis=1)] for name, share in _QUANTILES.items()}
    return {name: value.reshape(3, 1, 1) for name, value in found.items()} | {"count": np.array([len(images)])}


def pool(parts: Sequence[Statistics]) -> Statistics:
    """Of all episodes; quantiles are the means of theirs, weighted by their length, as LeRobot pools them."""
    count = np.array([part["count"][0] for part in parts], dtype=np.float64)
    weights = (count / count.sum()).reshape(-1, *[1] * parts[0]["mean"].ndim)
    stacked = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    mean = (weights * stacked["mean"]).sum(axis=0)
    spread = stacked["std"] ** 2 + (stacked["mean"] - mean) ** 2
    found: Statistics = {
        "min": stacked["min"].min(axis=0),
        "max": stacked["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt((weights * spread).sum(axis=0)),
        "count": np.array([int(count.sum())]),
    }
    return found | {name: (weights * stacked[name]).sum(axis=0) for name in _QUANTILES}
