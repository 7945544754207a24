"""Intervals of success rates: Wilson's for one task, clustered by task for a suite, paired for two policies."""

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from grs_agents.base import Frozen

LEVEL = 0.95
"""Level of all intervals."""


class Interval(Frozen):
    """A mean with the bounds of its confidence interval."""

    mean: float
    low: float
    high: float
    count: int  # episodes


def wilson_interval(successes: int, count: int) -> Interval:
    """Wilson's score interval of a success rate (Wilson 1927); no episodes leave it open from 0 to 1."""
    if not count:
        return Interval(mean=math.nan, low=0.0, high=1.0, count=0)
    low, high = _score_bounds(successes / count, count)
    return Interval(mean=successes / count, low=low, high=high, count=count)


def clustered_interval(values_by_task: Sequence[Sequence[float]]) -> Interval:
    """Interval of the mean over tasks of each task's mean, clustered by task.

    Episodes of one task are alike: the interval is Wilson's for the effective number of independent episodes, which
    follows from the variance of the tasks' means (Kish 1965) and is at least the number of tasks. Where all means are
    equal it is that number.
    """
    rows = [values for values in values_by_task if values]
    count = sum(map(len, rows))
    if len(rows) < 2:
        return wilson_interval(round(sum(map(sum, rows))), count)
    means = np.array([np.mean(values) for values in rows])
    mean, variance = float(means.mean()), float(means.var(ddof=1)) / len(means)
    effective = mean * (1 - mean) / variance if variance > 0 else 0.0
    low, high = _score_bounds(mean, min(max(effective, len(rows)), count))
    return Interval(mean=mean, low=low, high=high, count=count)


def _score_bounds(share: float, count: float) -> tuple[float, float]:
    """Bounds of Wilson's score interval."""
    z = float(stats.norm.ppf((1 + LEVEL) / 2))
    middle, scale = share + z * z / (2 * count), 1 + z * z / count
    half = z * math.sqrt(share * (1 - share) / count + (z / (2 * count)) ** 2)
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


class PairedComparison(Frozen):
    """Two policies on the same episodes."""

    difference: float  # mean over tasks of (second - first)
    low: float  # 95 % interval, clustered by task
    high: float
    episodes: int
    only_first: int  # episodes that only the first solves
    only_second: int
    p_value: float  # exact McNemar test of the episodes


def compare_pairs(pairs_by_task: Sequence[Sequence[tuple[bool, bool]]]) -> PairedComparison:
    """Compare success pairs (first, second) of the same episodes, by task."""
    rows = [pairs for pairs in pairs_by_task if pairs]
    flat = [pair for pairs in rows for pair in pairs]
    only_first = sum(first and not second for first, second in flat)
    only_second = sum(second and not first for first, second in flat)
    means = np.array([np.mean([float(second) - float(first) for first, second in pairs]) for pairs in rows])
    difference = float(means.mean()) if len(means) else math.nan
    far = math.inf
    if len(means) > 1:
        far = float(stats.t.ppf((1 + LEVEL) / 2, len(means) - 1)) * float(means.std(ddof=1)) / math.sqrt(len(means))
    differing = only_first + only_second
    return PairedComparison(
        difference=difference,
        low=max(-1.0, difference - far),
        high=min(1.0, difference + far),
        episodes=len(flat),
        only_first=only_first,
        only_second=only_second,
        p_value=float(stats.binomtest(only_second, differing).pvalue) if differing else 1.0,
    )
