"""Backends that separate a worker from the host, and their requirements."""

import os
import shutil
import sys
from pathlib import Path
from typing import Literal

Backend = Literal["bubblewrap", "landlock", "sandbox-exec", "none"]
BackendChoice = Literal["auto", "bubblewrap", "landlock", "sandbox-exec", "none"]
LAYERS: dict[Backend, str] = {
    "bubblewrap": "bubblewrap+landlock+seccomp",
    "landlock": "landlock+seccomp",
    "sandbox-exec": "sandbox-exec",
    "none": "none",
}
"""The name under which results record each."""
BACKEND_REMEDIES: dict[str, str] = {
    "bubblewrap": "install bubblewrap 0.8 or later (Debian: apt-get install bubblewrap)",
    "landlock": "use Linux 5.13 or later with Landlock enabled (lsm=landlock,... on the kernel's command line)",
    "sandbox-exec": "use macOS, which comes with sandbox-exec",
}
PROGRAMS: dict[str, str] = {"bubblewrap": "bwrap", "sandbox-exec": "sandbox-exec"}
"""Program of each backend, on the PATH."""
SCRATCH = Path("/scratch")
"""Folder of the scratch folders in a file system of their own."""


def backend_candidates(choice: BackendChoice) -> tuple[Backend, ...]:
    """The backends to try for ``choice``, the strongest first."""
    if choice != "auto":
        return (choice,)
    return ("sandbox-exec",) if sys.platform == "darwin" else ("bubblewrap", "landlock")


def missing_requirements(backend: Backend) -> list[tuple[str, str]]:
    """Requirements that ``backend`` misses, each with its remedy; empty if it can be tried."""
    if os.name != "posix":
        return [(f"it needs Linux or macOS, this is {sys.platform}", "use Linux, or a container of it")]
    reasons: list[tuple[str, str]] = []
    if (program := PROGRAMS.get(backend)) and shutil.which(program) is None:
        reasons.append((f"there is no {program} on the PATH", BACKEND_REMEDIES[backend]))
    if backend in ("bubblewrap", "landlock"):
        if sys.platform != "linux":
            return [(f"it needs Linux, this is {sys.platform}", "use Linux")]
        from grs_agents.sandbox.isolation import hardening

        lacks = hardening.find_missing_layers()
        gaps = [f"no {layer}: {lacks[layer]}" for layer in ("landlock", "seccomp") if layer in lacks]
        reasons += [(reason, BACKEND_REMEDIES["landlock"]) for reason in gaps]
    return reasons
