"""The layers inside a process, put on in the order that each needs, never to be taken off."""

from collections.abc import Sequence
from pathlib import Path

from grs_agents.errors import GrsError
from grs_agents.sandbox.isolation import kernel, landlock, privileges, seccomp
from grs_agents.sandbox.isolation.privileges import Allowance


class HardeningError(GrsError):
    """This process cannot be hardened."""


def prepare() -> None:
    """Do ahead of a fork what each child would repeat: build the filter, let go of capabilities to be gained."""
    machine = kernel.machine()
    if machine is not None:
        seccomp.prepare(machine, landlock.abi())
        privileges.drop_bounding_set()


def file_rules(readable: Sequence[Path], writable: Sequence[Path]) -> int | None:
    """What ``harden`` leaves of the files, as ``landlock.rules``; None if this kernel has no Landlock."""
    return landlock.rules(readable, writable) if landlock.abi() else None


def harden(rules: int | None, allowance: Allowance, visible: bool = False) -> tuple[str, ...]:
    """Confine the present process to a few files, harmless system calls and bounded resources, for ever.

    The answer names the layers that hold, e.g. ``("no capabilities", "limits", "thread limit", "landlock 7",
    "seccomp")``. What the kernel lacks is left out: the caller compares with what it demands. Descriptors that are open
    stay open. The process can start threads afterwards, but no process. ``visible`` says whether processes of the same
    user outside may see its open files and memory.

    Raises:
        HardeningError: the process has several threads. Landlock and capabilities belong to one thread, and another
            one would stay free.
        OSError: the kernel has a layer, yet would not put it on.
    """
    _one_thread_only()
    lacks = missing()
    layers = ["no capabilities", "limits"]
    alone = privileges.use_unique_user_id()
    privileges.forbid_new_privileges()
    privileges.drop_capabilities()
    privileges.hide(not visible)
    if privileges.limit(allowance, alone):
        layers.append("thread limit")
    version = landlock.abi()
    if rules is not None:
        landlock.restrict_files(rules)
        layers.append(f"landlock {version}")
    if "seccomp" not in lacks:
        seccomp.install(version)
        layers.append("seccomp")
    return tuple(layers)


def missing() -> dict[str, str]:
    """What this kernel lacks of the layers, each with the reason; empty if it has them all."""
    version = landlock.abi()
    reasons = {"landlock": landlock.why_not(), "seccomp": seccomp.why_not()}
    if 0 < version < 6:
        covered = "files" if version < 4 else "files and TCP"
        reasons["landlock 6"] = f"the kernel has version {version}, which covers {covered}; seccomp covers the rest"
    return {layer: reason for layer, reason in reasons.items() if reason}


def _one_thread_only() -> None:
    try:
        threads = Path("/proc/self/task").stat().st_nlink - 2  # a folder for each, beside "." and ".."
    except FileNotFoundError:
        raise HardeningError("/proc is not mounted, so threads cannot be counted", "mount /proc") from None
    if threads > 1:
        raise HardeningError(
            f"a process of {threads} threads cannot be hardened, only one of 1",
            "fork first, or set OPENBLAS_NUM_THREADS=1 and start no thread before",
        )
