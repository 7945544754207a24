"""Tests on ranks: they agree with what is published or plain, and say nothing where nothing can be said."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evals.benchmark.rank_tests import confidence_interval, kruskal_wallis, scheirer_ray_hare


def test_groups_apart_differ() -> None:
    found = kruskal_wallis({"one": [1, 2, 3, 4, 5], "other": [6, 7, 8, 9, 10]}, "method")
    assert found is not None
    # by hand: H = 12/(10*11) * (15^2/5 + 40^2/5) - 3*11
    assert found.statistic == pytest.approx(6.8182, abs=1e-4)
    assert (found.effect, found.freedom) == ("method", 1)
    assert found.p == pytest.approx(0.00902, abs=1e-5)


@pytest.mark.parametrize(
    "groups", [{}, {"one": [1.0, 2.0]}, {"one": [1.0], "other": []}, {"a": [2.0, 2.0], "b": [2.0]}]
)
def test_nothing_is_said_of_one_group_or_of_equal_values(groups: dict[str, list[float]]) -> None:
    assert kruskal_wallis(groups, "method") is None


def test_two_factors_are_told_apart() -> None:
    rows, columns = ["a"] * 8 + ["b"] * 8, (["x"] * 4 + ["y"] * 4) * 2
    values = [float(number) for number in range(16)]  # all of b above all of a, and within each y above x
    by_row, by_column, both = scheirer_ray_hare(values, rows, columns)
    assert [one.effect for one in (by_row, by_column, both)] == ["method", "model", "method x model"]
    # by hand: sums of squares of ranks 256 and 64 and 0, mean square 340/15
    assert by_row.statistic == pytest.approx(256 / (340 / 15))
    assert by_column.statistic == pytest.approx(64 / (340 / 15))
    assert both.statistic == pytest.approx(0, abs=1e-9)
    assert by_row.p < 0.001 < by_column.p < both.p
    assert (by_row.freedom, by_column.freedom, both.freedom) == (1, 1, 1)


def test_an_interaction_shows() -> None:
    rows, columns = ["a"] * 8 + ["b"] * 8, (["x"] * 4 + ["y"] * 4) * 2
    values = [1, 2, 3, 4, 13, 14, 15, 16, 9, 10, 11, 12, 5, 6, 7, 8]
    by_row, _, both = scheirer_ray_hare(values, rows, columns)
    assert by_row.statistic == pytest.approx(0, abs=1e-9)
    assert both.statistic > 2


def test_an_empty_cell_or_one_level_is_not_tested() -> None:
    assert scheirer_ray_hare([1, 2, 3], ["a", "a", "b"], ["x", "y", "x"]) == ()
    assert scheirer_ray_hare([1, 2], ["a", "a"], ["x", "y"]) == ()
    assert scheirer_ray_hare([3, 3, 3, 3], ["a", "a", "b", "b"], ["x", "y", "x", "y"]) == ()


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=40))
def test_the_interval_is_about_the_mean(values: list[float]) -> None:
    mean, low, high = confidence_interval(values)
    assert mean == pytest.approx(np.mean(values), abs=1e-9)
    assert low <= mean <= high
    assert high - mean == pytest.approx(mean - low, abs=1e-6)


def test_the_interval_is_students() -> None:
    mean, low, high = confidence_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    # t(0.975, 4) = 2.776, deviation 1.5811, root of five
    assert (mean, low, high) == pytest.approx((3.0, 3 - 1.9632, 3 + 1.9632), abs=1e-4)
    assert confidence_interval([0.7]) == (0.7, 0.7, 0.7)
