"""Rank tests: differences between groups (Kruskal-Wallis), two factors with interaction (Scheirer-Ray-Hare)."""

from collections.abc import Mapping, Sequence
from importlib import import_module

import numpy as np
import numpy.typing as npt

from grs_agents.base import Frozen

Floats = npt.NDArray[np.float64]


class RankTest(Frozen):
    """The result of a test: its effect, statistic, degrees of freedom and probability."""

    effect: str
    statistic: float
    freedom: int
    p: float


def kruskal_wallis(groups: Mapping[str, Sequence[float]], effect: str) -> RankTest | None:
    """Test that groups of values have the same distribution; ``None`` for fewer than two groups, or if all values
    are equal.
    """
    kept = [np.asarray(values, np.float64) for values in groups.values() if len(values)]
    if len(kept) < 2 or np.ptp(np.concatenate(kept)) == 0:
        return None
    statistic, p = import_module("scipy.stats").kruskal(*kept)
    return RankTest(effect=effect, statistic=float(statistic), freedom=len(kept) - 1, p=float(p))


def scheirer_ray_hare(values: Sequence[float], rows: Sequence[str], columns: Sequence[str]) -> tuple[RankTest, ...]:
    """The effects of two factors on ranks, and their interaction (Scheirer, Ray and Hare 1976).

    Args:
        values: measured values.
        rows, columns: the level of either factor for each value.

    Returns:
        Rows, columns and interaction; none if a factor has a single level, a cell is empty, or all values are equal.
    """
    ranks = np.asarray(import_module("scipy.stats").rankdata(np.asarray(values, np.float64)), np.float64)
    row_names, row = np.unique(np.array(rows), return_inverse=True)
    column_names, column = np.unique(np.array(columns), return_inverse=True)
    down, across = len(row_names) - 1, len(column_names) - 1
    cell = row * len(column_names) + column
    whole = len(set(cell.tolist())) == len(row_names) * len(column_names)
    if not (down and across and whole) or np.ptp(ranks) == 0:
        return ()
    by_row, by_column = _between(ranks, row), _between(ranks, column)
    both = _between(ranks, cell) - by_row - by_column
    mean_square = float(((ranks - ranks.mean()) ** 2).sum()) / (len(ranks) - 1)
    effects = (("method", by_row, down), ("model", by_column, across), ("method x model", both, down * across))
    chi2 = import_module("scipy.stats").chi2
    return tuple(
        RankTest(
            effect=effect,
            statistic=square / mean_square,
            freedom=freedom,
            p=float(chi2.sf(max(square / mean_square, 0.0), freedom)),
        )
        for effect, square, freedom in effects
    )


def confidence_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean and 95 % confidence interval (Student's t) of values; the interval of a single value is the value."""
    sample = np.asarray(values, np.float64)
    mean = float(sample.mean())
    if len(sample) < 2:
        return mean, mean, mean
    reach = (
        float(import_module("scipy.stats").t.ppf(0.975, len(sample) - 1))
        * float(sample.std(ddof=1))
        / len(sample) ** 0.5
    )
    return mean, mean - reach, mean + reach


def _between(ranks: Floats, group: npt.NDArray[np.int64]) -> float:
    """The sum of squares between groups of ranks."""
    groups = [ranks[group == number] for number in np.unique(group)]
    return float(sum(len(some) * (some.mean() - ranks.mean()) ** 2 for some in groups))


def mann_whitney(first: Sequence[float], second: Sequence[float]) -> float:
    """The probability (two-sided) that samples differ so much by chance; 1 if all values are alike."""
    if np.ptp(np.asarray([*first, *second], np.float64)) == 0:
        return 1.0
    return float(import_module("scipy.stats").mannwhitneyu(first, second).pvalue)
