"""Processes of runs, forked from a warm parent."""

import subprocess
import sys

import pytest

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
