"""The ``grs`` command as a user runs it."""

import subprocess
import sys
from pathlib import Path


def grs(*arguments: str, folder: Path, timeout: float = 240) -> "subprocess.CompletedProcess[str]":
    """Run ``grs`` with ``arguments`` in ``folder``."""
    command = [sys.executable, "-m", "grs_agents", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
