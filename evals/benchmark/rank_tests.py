"""Tests on ranks: whether groups differ (Kruskal-Wallis), two factors and their interaction (Scheirer-Ray-Hare)."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base import Frozen
from grs_agents.errors import InputError

Floats = npt.NDArray[np.float64]


class RankTest(Frozen):
    """The result of a test: what it is about, its statistic, degrees of freedom and probability."""

    effect: str
    statistic: float
    freedom: int
    p: float


def kruskal_wallis(groups: Mapping[str, Sequence[float]], effect: str) -> RankTest | None:
    """Whether groups of values come from one distribution; ``None`` for fewer than two groups, or if all are alike.

    Raises:
        InputError: SciPy is not installed.
    """
    kept = [np.asarray(values, np.float64) for values in groups.values() if len(values)]
    if len(kept) < 2 or np.ptp(np.concatenate(kept)) == 0:
        return None
    statistic, p = _stats().kruskal(*kept)
    return RankTest(effect=effect, statistic=float(statistic), freedom=len(kept) - 1, p=float(p))


def scheirer_ray_hare(values: Sequence[float], rows: Sequence[str], columns: Sequence[str]) -> tuple[RankTest, ...]:
    """The effects of two factors on ranks, and their interaction (Scheirer, Ray and Hare 1976).

    Args:
        values: what was measured.
        rows, columns: the level of either factor for each value.

    Returns:
        Rows, columns and interaction; none where a factor has one level, a cell is empty, or all values are alike.

    Raises:
        InputError: SciPy is not installed.
    """
    first, second = sorted(set(rows)), sorted(set(columns))
    ranks = _ranks(np.asarray(values, np.float64))
    row, column = np.array(rows), np.array(columns)
    cells = [[ranks[(row == one) & (column == two)] for two in second] for one in first]
    whole = len(first) > 1 and len(second) > 1 and all(len(cell) for some in cells for cell in some)
    if not whole or np.ptp(ranks) == 0:
        return ()
    mean_square = float(((ranks - ranks.mean()) ** 2).sum()) / (len(ranks) - 1)
    by_row = _between([ranks[row == one] for one in first])
    by_column = _between([ranks[column == two] for two in second])
    both = _between([cell for some in cells for cell in some]) - by_row - by_column
    down, across = len(first) - 1, len(second) - 1
    chi2 = _stats().chi2
    return tuple(
        RankTest(effect=effect, statistic=square / mean_square, freedom=free,
                 p=float(chi2.sf(max(square / mean_square, 0.0), free)))
        for effect, square, free in (("method", by_row, down), ("model", by_column, across),
                                     ("method x model", both, down * across))
    )  # fmt: skip


def confidence_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean and 95 % confidence interval (Student's t) of values; the interval is the mean for a single one.

    Raises:
        InputError: SciPy is not installed.
    """
    told = np.asarray(values, np.float64)
    mean = float(told.mean())
    if len(told) < 2:
        return mean, mean, mean
    reach = float(_stats().t.ppf(0.975, len(told) - 1)) * float(told.std(ddof=1)) / len(told) ** 0.5
    return mean, mean - reach, mean + reach


def _between(groups: Sequence[Floats]) -> float:
    """The sum of squares between groups of ranks."""
    every = np.concatenate(groups)
    return float(sum(len(group) * (group.mean() - every.mean()) ** 2 for group in groups))


def _ranks(values: Floats) -> Floats:
    """Ranks from 1; equal values share the mean of theirs."""
    return np.asarray(_stats().rankdata(values), np.float64)


def _stats() -> Any:
    try:
        return import_module("scipy.stats")
    except ImportError as error:
        raise InputError("the statistics of this experiment need SciPy", "pip install 'grs-agents[eval]'") from error
