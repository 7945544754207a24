"""The command line of bubblewrap: name spaces of its own, and a file system of what is named."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from grs_agents.sandbox.isolation import allowlist


def wrap(readable: Sequence[Path], scratch: Sequence[Path], scratch_bytes: int) -> list[str]:
    """What to put before a command.

    Args:
        readable: files and folders that are visible beside the system's own, read-only.
        scratch: folders that can be written, each a file system of ``scratch_bytes`` bytes.
    """
    command = [shutil.which("bwrap") or "bwrap", "--unshare-all", "--unshare-user", "--cap-drop", "ALL"]
    command += ["--hostname", "sandbox"]
    for path in allowlist.system_paths():
        command += ["--symlink", str(path.readlink()), str(path)] if path.is_symlink() else _bind(path)
    for path in readable:
        command += _bind(path)
    command += ["--proc", "/proc", "--dev", "/dev"]
    for folder in scratch:
        command += ["--size", str(scratch_bytes), "--tmpfs", str(folder)]
    return [*command, "--remount-ro", "/", "--remount-ro", "/dev", "--chdir", "/"]


def _bind(path: Path) -> list[str]:
    return ["--ro-bind", str(path), str(path)]
