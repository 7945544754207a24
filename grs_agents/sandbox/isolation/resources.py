"""What a process may use up, kept by the kernel's resource limits."""

import _thread
import math
import os
import resource
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from grs_agents.sandbox.isolation import kernel


@dataclass(frozen=True)
class Allowance:
    """What may be used from now on.

    Attributes:
        cpu_seconds: processor time of the whole process, rounded up to whole seconds. ``SIGXCPU`` tells it, and
            ``SIGKILL`` ends it a second later.
        memory_mib: address space on top of what is held. Each thread's stack takes 8 MiB of it.
        file_mib: the largest file that can be written.
        descriptors: the lowest number that no descriptor can have.
        threads: how many may be started. The kernel counts all threads of a *user*, other processes' too, so that
            those of today are added, root's included (a process which hides itself looks like root's): a bound on
            damage, no exact number. It is exact for a process alone in its count.
    """

    cpu_seconds: float = 50
    memory_mib: int = 1024
    file_mib: int = 64
    descriptors: int = 128
    threads: int = 64


def limit(allowance: Allowance, alone: bool) -> bool:
    """Set all limits, soft and hard, for ever; none is raised above what already holds. The stack's is kept.

    Args:
        allowance: what may be used.
        alone: whether no other process counts as this user's (``privileges.leave_roots_count``).

    Returns:
        Whether the limit on threads binds: it does not bind root.
    """
    cpu = math.ceil(time.process_time() + allowance.cpu_seconds)
    _lower("CPU", cpu, cpu + 1)
    _lower("FSIZE", allowance.file_mib << 20)
    _lower("NOFILE", allowance.descriptors)
    _lower("CORE", 0)
    _lower("MEMLOCK", 0)
    _lower("MSGQUEUE", 0)
    _lower("SIGPENDING", 256)
    tasks = allowance.threads + (1 if alone else _tasks(os.getuid()))
    _lower("NPROC", 0, tasks)
    binds = not _starts_a_thread()
    _lower("NPROC", tasks)
    with suppress(FileNotFoundError):  # elsewhere the kernel does not keep a limit on address space
        pages = int(kernel.read("/proc/self/statm").split()[0])
        _lower("AS", pages * resource.getpagesize() + (allowance.memory_mib << 20))
    return binds


def _lower(name: str, soft: int, hard: int | None = None) -> None:
    kind = getattr(resource, f"RLIMIT_{name}", None)
    if kind is None:  # not every system has all of them
        return
    highest = resource.getrlimit(kind)[1]
    wanted = (soft, soft if hard is None else hard)
    if highest != resource.RLIM_INFINITY:
        wanted = (min(wanted[0], highest), min(wanted[1], highest))
    resource.setrlimit(kind, wanted)


def _tasks(user: int) -> int:
    """How many threads a user has, root's included: a process that cannot be traced looks like root's."""
    total = 0
    with suppress(FileNotFoundError), os.scandir("/proc") as entries:
        for entry in entries:
            if entry.name.isdecimal():
                with suppress(OSError):  # it has ended
                    tasks = Path(entry.path, "task").stat()
                    total += max(tasks.st_nlink - 2, 0) if tasks.st_uid in {user, 0} else 0
    return total


def _starts_a_thread() -> bool:
    ended = threading.Lock()
    ended.acquire()
    try:
        _thread.start_new_thread(ended.release, ())
    except RuntimeError:
        return False
    ended.acquire()
    return True
