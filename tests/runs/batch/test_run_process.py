"""Processes of runs, forked from a warm parent."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from grs_agents.runs.batch.run_process import RunProcesses

COUNT = """
import os, sys
from grs_agents.runs.batch.warm_parent import preload
preload()
print(len(os.listdir("/proc/self/task")), "grs_agents.cli.run" in sys.modules, "rerun" in sys.modules)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no run is forked")
def test_what_is_imported_before_a_fork_starts_no_thread() -> None:
    done = subprocess.run([sys.executable, "-c", COUNT], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1", "True", "False"]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no run is forked")
def test_a_warm_parent_that_was_killed_is_replaced(tmp_path: Path) -> None:
    processes = RunProcesses()
    with (tmp_path / "log").open("w") as log:
        for _ in range(2):
            with processes.start(["--version"], log) as process:
                assert process.wait(60) == 0
            (child,) = (int(number) for number in _children_of(os.getpid()))
            os.kill(child, signal.SIGKILL)
            os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
        processes.close()


def _children_of(parent: int) -> list[str]:
    """Process numbers of the children whose command is the warm parent."""
    tasks = Path(f"/proc/{parent}/task").iterdir()
    numbers = [number for task in tasks for number in (task / "children").read_text().split()]
    return [each for each in numbers if b"warm_parent" in Path(f"/proc/{each}/cmdline").read_bytes()]
