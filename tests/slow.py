"""The mark of tests that `make test` leaves to `make test-all`: instruments, and further cases of one kind."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest

SLOW = pytest.mark.slow


def slow_where(is_slow: Callable[[Any], bool], cases: Iterable[Any]) -> list[Any]:
    """Parameters of a test: all ``cases``, those with ``is_slow`` marked slow."""
    return [pytest.param(case, marks=[SLOW] * is_slow(case)) for case in cases]
