"""The layers inside a process, put on in the order that each needs, never to be taken off."""

from collections.abc import Sequence
from pathlib import Path

from grs_agents.base.errors import GrsError
from grs_agents.sandbox.isolation import kernel, landlock, privileges, seccomp
from grs_agents.sandbox.isolation.privileges import Allowance


class HardeningError(GrsError):
    """This process cannot be hardened."""


def prepare_hardening_before_fork() -> None:
    """Do the shared work of all children ahead of a fork: build the filter, drop the capability bounding set."""
    machine = kernel.detect_architecture()
    if machine is not None:
        seccomp.compile_filter(machine, landlock.abi_version())
        privileges.drop_bounding_set()


def create_file_rules(readable: Sequence[Path], writable: Sequence[Path]) -> int | None:
    """The file rules of ``harden_process``, as of ``landlock.create_ruleset``; None without Landlock in this kernel."""
    return landlock.create_ruleset(readable, writable) if landlock.abi_version() else None


def harden_process(rules: int | None, allowance: Allowance, visible: bool = False) -> tuple[str, ...]:
    """Confine this process to a few files, harmless system calls and bounded resources, irrevocably.

    Returns: the names of the active layers, e.g. ``("no capabilities", "limits", "thread limit", "landlock 7",
    "seccomp")``. Layers that the kernel lacks are left out: the caller compares with its demands. Open descriptors stay
    open. The process can start threads afterwards, but no process. ``visible`` lets processes of the same user outside
    see its open files and memory.

    Raises:
        HardeningError: the process has several threads. Landlock and capabilities apply to a single thread, and the
            others would stay free.
        OSError: the kernel has a layer, yet would not put it on.
    """
    try:
        threads = Path("/proc/self/task").stat().st_nlink - 2  # a folder for each, beside "." and ".."
    except FileNotFoundError:
        raise HardeningError("/proc is not mounted, so threads cannot be counted", "mount /proc") from None
    if threads > 1:
        remedy = "fork first, or set OPENBLAS_NUM_THREADS=1 and start no thread before"
        raise HardeningError(f"a process of {threads} threads cannot be hardened, only one of 1", remedy)
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
    """Layers that this kernel lacks, each with the reason; empty if it has them all."""
    version = landlock.abi_version()
    reasons = {"landlock": landlock.unavailability_reason(), "seccomp": seccomp.unavailability_reason()}
    if 0 < version < 6:
        covered = "files" if version < 4 else "files and TCP"
        reasons["landlock 6"] = f"the kernel has version {version}, which covers {covered}; seccomp covers the rest"
    return {layer: reason for layer, reason in reasons.items() if reason}
