"""Work in processes of their own."""

import os
import select
import subprocess
import sys
from pathlib import Path

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


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux ends them")
def test_the_processes_of_a_killed_parent_end() -> None:
    work = "import time; from grs_agents.tasks.worker_pool import map_in_processes as run\n"
    work += "for _ in run(time.sleep, [0, 0, 600, 600], 2, bool): print('done', flush=True)"
    with subprocess.Popen([sys.executable, "-c", work], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert [parent.stdout.readline() for _ in range(2)] == [b"done\n"] * 2
        children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children").read_text().split()
        ended = [os.pidfd_open(int(child)) for child in children]
        parent.kill()
        for child in ended:
            assert select.select([child], [], [], 60)[0]
            os.close(child)
