"""What can separate a worker from the host, and how each is started."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from grs_agents.sandbox import allowlist

Backend = Literal["bubblewrap", "landlock", "none"]
Choice = Literal["auto", "bubblewrap", "landlock", "none"]
LAYERS: dict[Backend, str] = {
    "bubblewrap": "bubblewrap+landlock+seccomp",
    "landlock": "landlock+seccomp",
    "none": "none",
}
"""The name under which results record each."""
REMEDIES: dict[str, str] = {
    "bubblewrap": "install bubblewrap 0.8 or later (Debian: apt-get install bubblewrap)",
    "landlock": "use Linux 5.13 or later with Landlock enabled (lsm=landlock,... on the kernel's command line)",
}
SCRATCH = Path("/scratch")


def candidates(choice: Choice) -> tuple[Backend, ...]:
    """The backends to try for ``choice``, the strongest first."""
    return ("bubblewrap", "landlock") if choice == "auto" else (choice,)


def absent(backend: Backend) -> str:
    """Why ``backend`` cannot even be tried, or the empty string."""
    if backend == "none":
        return ""
    if not sys.platform.startswith("linux"):
        return f"{backend} needs Linux, this is {sys.platform}"
    if backend == "bubblewrap" and shutil.which("bwrap") is None:
        return "there is no bwrap on the PATH"
    return ""


def wrap(backend: Backend, readable: Sequence[Path], slots: int, scratch_bytes: int) -> list[str]:
    """What to put before the command of a zygote.

    Args:
        readable: files and folders that are visible beside the system's own, read-only.
        slots: how many calls may run at once; each has a file system of ``scratch_bytes`` bytes for scratch.
    """
    if backend != "bubblewrap":
        return []
    command = ["bwrap", "--unshare-all", "--unshare-user", "--cap-drop", "ALL", "--hostname", "sandbox"]
    for path in allowlist.system_paths():
        command += ["--symlink", str(path.readlink()), str(path)] if path.is_symlink() else _bind(path)
    for path in readable:
        command += _bind(path)
    command += ["--proc", "/proc", "--dev", "/dev"]
    for slot in range(slots):
        command += ["--size", str(scratch_bytes), "--tmpfs", str(SCRATCH / str(slot))]
    return [*command, "--remount-ro", "/", "--remount-ro", "/dev", "--chdir", "/"]


def _bind(path: Path) -> list[str]:
    return ["--ro-bind", str(path), str(path)]
