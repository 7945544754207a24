"""Intervals of success rates."""

import pytest

from grs_agents.tasks.suites.statistics import clustered_interval, compare_pairs, wilson_interval


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
