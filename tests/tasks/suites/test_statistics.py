"""Intervals of success rates."""

import math

import numpy as np
import pytest

from grs_agents.tasks.suites.perturbation import FACTORS, Factor, Trial, fit_effects
from grs_agents.tasks.suites.statistics import clustered_interval, compare_pairs, fit_log_odds, wilson_interval


def test_wilson_intervals_are_those_of_the_tables() -> None:
    some, none, nothing = wilson_interval(8, 10), wilson_interval(0, 10), wilson_interval(0, 0)
    assert (some.mean, some.low, some.high) == pytest.approx((0.8, 0.4902, 0.9433), abs=1e-4)
    assert (none.low, none.high) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert (nothing.low, nothing.high, nothing.count) == (0.0, 1.0, 0)


def test_episodes_of_one_task_are_alike() -> None:
    alike = clustered_interval([[1.0] * 10, [0.0] * 10, [1.0] * 10, [0.0] * 10])
    mixed = clustered_interval([[1.0, 0.0] * 5] * 3 + [[1.0] * 6 + [0.0] * 4])
    assert alike.mean == 0.5 and mixed.mean == pytest.approx(0.525)
    # four tasks that are all or nothing tell as much as four episodes, mixed ones as much as forty
    assert (alike.low, alike.high) == pytest.approx((0.15, 0.85), abs=0.01)
    assert mixed.high - mixed.low == pytest.approx(0.295, abs=0.01)
    sure = clustered_interval([[1.0] * 10] * 5)
    assert sure.low == pytest.approx(wilson_interval(5, 5).low)


def test_policies_are_compared_in_pairs() -> None:
    pairs = [[(False, True)] * 6 + [(True, True)] * 4, [(False, True)] * 4 + [(True, False)] * 1 + [(False, False)] * 5]
    compared = compare_pairs(pairs)
    assert (compared.only_first, compared.only_second, compared.episodes) == (1, 10, 20)
    assert compared.difference == pytest.approx(0.45)
    assert compared.p_value == pytest.approx(0.01172, abs=1e-4)
    assert compare_pairs([[(True, True)] * 3]).p_value == 1.0


@pytest.mark.parametrize(("without", "with_it", "costs"), [((8, 10), (3, 10), True), ((10, 10), (0, 10), True)])
def test_the_log_odds_of_a_factor_are_those_of_firths_table(
    without: tuple[int, int], with_it: tuple[int, int], costs: bool
) -> None:
    design = np.repeat([[0.0], [1.0]], [without[1], with_it[1]], axis=0)
    success = [float(row < solved) for solved, count in (without, with_it) for row in range(count)]
    (fitted,) = fit_log_odds(design, np.array(success), np.ones(len(success)))
    # for a single factor the penalty adds half an episode to each cell
    before, after = ((solved + 0.5) / (count - solved + 0.5) for solved, count in (without, with_it))
    assert fitted.value == pytest.approx(math.log(after / before), abs=1e-4)
    assert fitted.low < fitted.value < fitted.high
    assert (fitted.high < 0) == costs


def test_the_factor_that_fails_is_the_one_that_is_shown() -> None:
    conditions: list[tuple[Factor, ...]] = [(), *((factor,) for factor in FACTORS), FACTORS]
    trials = [
        Trial(task=task, factors=factors, tags=("kind",), success="table" not in factors)
        for factors in conditions
        for task in "ab"
        for _ in range(5)
    ]
    shown = [effect for effect in fit_effects(trials) if effect.verdict != "not shown"]
    assert [(effect.factor, effect.verdict, effect.alone.mean) for effect in shown] == [("table", "costs success", 0.0)]
    always = [trial.model_copy(update={"success": True}) for trial in trials]
    assert {effect.verdict for effect in fit_effects(always)} == {"not shown"}
