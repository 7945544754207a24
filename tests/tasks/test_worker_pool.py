"""Work in processes of their own."""

import os

import pytest

from grs_agents.tasks.worker_pool import map_in_processes


@pytest.mark.parametrize("workers", [1, 2])
def test_everything_is_done_once_in_any_order(workers: int) -> None:
    assert sorted(map_in_processes(abs, [-3, -1, -2], workers, bool)) == [1, 2, 3]


def test_what_goes_wrong_in_a_process_is_raised_here_and_leaves_nothing_behind() -> None:
    before = dict(os.environ)
    with pytest.raises(ValueError, match="two"):
        list(map_in_processes(int, ["1", "two"], 2, bool))
    assert dict(os.environ) == before
