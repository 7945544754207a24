"""What a zygote is told when it starts, and later."""

from pathlib import Path

from grs_agents.base import Frozen

EXPLAIN = b"explain"
"""What the host sends to have a child write where it is, and end."""


class Settings(Frozen):
    """How a zygote serves its calls.

    Attributes:
        preload: modules to import before the first call.
        tools: shipped tool files to import before the first call.
        layers: whether children harden themselves with Landlock, seccomp and without privileges.
        readable: files and folders that children may read.
        scratch: folder with one scratch folder for each slot, named by its number.
        slots: how many calls may run at once.
        scratch_is_sized: whether each of these is a file system of its own, of ``scratch_bytes``.
        scratch_bytes: the size of such a file system.
    """

    preload: tuple[str, ...] = ()
    tools: tuple[str, ...] = ()
    layers: bool = True
    readable: tuple[Path, ...] = ()
    scratch: Path
    slots: int = 1
    scratch_is_sized: bool = False
    scratch_bytes: int = 0
