"""Intervals of success rates: Wilson's for one task, clustered for a suite, paired for two policies, and of factors."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import special, stats

from grs_agents.base import Frozen

LEVEL = 0.95
"""Level of all intervals."""
_FARTHEST_LOG_ODDS, _BOUND_PRECISION = 16.0, 1e-3
_LONGEST_STEP, _CONVERGED, _NEWTON_STEPS = 2.0, 1e-6, 100


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


class Coefficient(Frozen):
    """Change of the log odds of success by a factor, with the bounds of its interval."""

    value: float
    low: float
    high: float


def fit_log_odds(
    design: npt.NDArray[np.float64], successes: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]
) -> list[Coefficient]:
    """Logistic regression with Firth's penalty and intervals of its profile likelihood (Heinze and Schemper 2002).

    The penalty keeps coefficients finite where a factor decides every episode, and where all episodes are alike.

    Args:
        design: (N, K) factors of each episode, 0 or 1, of full rank with the intercept.
        successes: (N,) 0 or 1.
        weights: (N,) number of independent episodes that each counts as.
    """
    columns = np.column_stack([np.ones(len(design)), design])
    rows, group = np.unique(columns, axis=0, return_inverse=True)
    group = group.ravel()
    counts = np.bincount(group, weights, len(rows)).astype(np.float64)
    solved = np.bincount(group, weights * successes, len(rows)).astype(np.float64)
    best, top = _maximize_firth(rows, solved, counts)
    wanted = float(stats.chi2.ppf(LEVEL, 1))
    fitted: list[Coefficient] = []
    for column in range(1, rows.shape[1]):

        def excess(value: float, column: int = column) -> float:
            return 2 * (top - _maximize_firth(rows, solved, counts, column, value)[1]) - wanted

        bounds: list[float] = []
        for side in (-1, 1):
            reach = 1.0
            while reach < _FARTHEST_LOG_ODDS and excess(best[column] + side * reach) < 0:
                reach *= 2
            near, far = float(best[column]), float(best[column]) + side * reach
            while abs(far - near) > _BOUND_PRECISION and excess(far) > 0:
                middle = (near + far) / 2
                near, far = (near, middle) if excess(middle) > 0 else (middle, far)
            bounds.append(far)
        fitted.append(Coefficient(value=float(best[column]), low=bounds[0], high=bounds[1]))
    return fitted


def _maximize_firth(
    rows: npt.NDArray[np.float64],
    solved: npt.NDArray[np.float64],
    counts: npt.NDArray[np.float64],
    fixed: int | None = None,
    value: float = 0.0,
) -> tuple[npt.NDArray[np.float64], float]:
    """Coefficients (K,) and the penalized log likelihood at its maximum, with one coefficient ``fixed`` at a value."""
    free = np.array([column for column in range(rows.shape[1]) if column != fixed])
    now = np.zeros(rows.shape[1])
    if fixed is not None:
        now[fixed] = value

    def information(beta: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        chance = special.expit(rows @ beta)
        return rows.T @ (rows * (counts * chance * (1 - chance))[:, None])

    def likelihood(beta: npt.NDArray[np.float64]) -> float:
        linear = rows @ beta
        fit = solved @ special.log_expit(linear) + (counts - solved) @ special.log_expit(-linear)
        return float(fit + 0.5 * np.linalg.slogdet(information(beta))[1])

    height = likelihood(now)
    for _ in range(_NEWTON_STEPS):
        matrix, chance = information(now), special.expit(rows @ now)
        leverage = counts * chance * (1 - chance) * np.einsum("ij,jk,ik->i", rows, np.linalg.pinv(matrix), rows)
        score = rows.T @ (solved - counts * chance + leverage * (0.5 - chance))
        step = np.linalg.pinv(matrix[np.ix_(free, free)]) @ score[free]
        step *= min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        while True:
            tried = now.copy()
            tried[free] += step
            risen = likelihood(tried)
            if risen >= height or float(np.abs(step).max()) < _CONVERGED:
                break
            step /= 2
        now, height = (tried, risen) if risen >= height else (now, height)
        if float(np.abs(step).max()) < _CONVERGED:
            break
    return now, height
