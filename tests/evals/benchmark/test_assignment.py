"""Assignments: none is cheaper."""

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from evals.benchmark.assignment import assign

COSTS = arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=5), elements=st.integers(-3, 3).map(float))


@given(costs=COSTS)
def test_no_assignment_is_cheaper(costs: np.ndarray) -> None:
    pairs = assign(costs)
    few = costs if costs.shape[0] <= costs.shape[1] else costs.T
    choices = permutations(range(few.shape[1]), few.shape[0])
    least = min(sum(few[row, column] for row, column in enumerate(choice)) for choice in choices)
    assert sum(costs[pair] for pair in pairs) == least
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs) == min(costs.shape)


def test_nothing_is_assigned_to_nothing() -> None:
    assert assign(np.zeros((0, 3))) == assign(np.zeros((3, 0))) == []
