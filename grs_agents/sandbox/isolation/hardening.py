"""The layers inside a process, put on in the order that each needs, never to be taken off."""

from collections.abc import Sequence
from pathlib import Path

from grs_agents.base.errors import GrsError
from grs_agents.sandbox.isolation import kernel, landlock, privileges, seccomp
from grs_agents.sandbox.isolation.privileges import Allowance


class HardeningError(GrsError):
    """This process cannot be hardened."""


def prepare_hardening_before_fork() -> None:
    """Do ahead of a fork what each child would repeat: build the filter, let go of capabilities to be gained."""
    machine = kernel.detect_architecture()
    if machine is not None:
        seccomp.compile_filter(machine, landlock.abi_version())
        privileges.drop_bounding_set()


def create_file_rules(readable: Sequence[Path], writable: Sequence[Path]) -> int | None:
    """What ``harden_process`` leaves of the files, as ``landlock.rules``; None if this kernel has no Landlock."""
    return landlock.create_ruleset(readable, writable) if landlock.abi_version() else None


def harden_process(rules: int | None, allowance: Allowance, visible: bool = False) -> tuple[str, ...]:
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
    _require_single_thread()
    lacks = find_missing_layers()
    layers = ["no capabilities", "limits"]
    alone = privileges.use_unique_user_id()
    privileges.forbid_new_privileges()
    privileges.drop_capabilities()
    privileges.hide_from_other_processes(not visible)
    if privileges.set_resource_limits(allowance, alone):
        layers.append("thread limit")
    version = landlock.abi_version()
    if rules is not None:
        landlock.restrict_file_access(rules)
        layers.append(f"landlock {version}")
    if "seccomp" not in lacks:
        seccomp.install_filter(version)
        layers.append("seccomp")
    return tuple(layers)


def find_missing_layers() -> dict[str, str]:
    """What this kernel lacks of the layers, each with the reason; empty if it has them all."""
    version = landlock.abi_version()
    reasons = {"landlock": landlock.unavailability_reason(), "seccomp": seccomp.unavailability_reason()}
    if 0 < version < 6:
        covered = "files" if version < 4 else "files and TCP"
        reasons["landlock 6"] = f"the kernel has version {version}, which covers {covered}; seccomp covers the rest"
    return {layer: reason for layer, reason in reasons.items() if reason}


def _require_single_thread() -> None:
    try:
        threads = Path("/proc/self/task").stat().st_nlink - 2  # a folder for each, beside "." and ".."
    except FileNotFoundError:
        raise HardeningError("/proc is not mounted, so threads cannot be counted", "mount /proc") from None
    if threads > 1:
        remedy = "fork first, or set OPENBLAS_NUM_THREADS=1 and start no thread before"
        raise HardeningError(f"a process of {threads} threads cannot be hardened, only one of 1", remedy)
