"""The cheapest one-to-one assignment of rows to columns."""

import numpy as np

from grs_agents.perception.types import Array


def assign(costs: Array) -> list[tuple[int, int]]:
    """Pair rows and columns of (N, M) finite costs so that the sum is least; every row or every column has a partner.

    Kuhn's method with potentials: rows are added one by one along the cheapest alternating path, O(N^2 M).

    Returns:
        (row, column) by row.
    """
    if costs.shape[0] > costs.shape[1]:
        return sorted((row, column) for column, row in assign(costs.T))
    rows, columns = costs.shape
    owner = np.full(columns + 1, -1)  # of each column; the last column is where a new row begins
    row_price, column_price = np.zeros(rows), np.zeros(columns + 1)
    for row in range(rows):
        owner[columns], column = row, columns
        reach, before = np.full(columns, np.inf), np.full(columns, columns)
        visited = np.zeros(columns + 1, np.bool_)
        while owner[column] >= 0:
            visited[column] = True
            free = ~visited[:columns]
            reduced = costs[owner[column]] - row_price[owner[column]] - column_price[:columns]
            nearer = free & (reduced < reach)
            reach[nearer], before[nearer] = reduced[nearer], column
            following = int(np.where(free, reach, np.inf).argmin())
            step = reach[following]
            row_price[owner[visited]] += step
            column_price[visited] -= step
            reach[free] -= step
            column = following
        while column != columns:
            owner[column] = owner[before[column]]
            column = int(before[column])
    return sorted((int(owner[column]), column) for column in range(columns) if owner[column] >= 0)
