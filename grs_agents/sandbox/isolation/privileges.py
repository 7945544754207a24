"""Irrevocable loss of privileges (capabilities, gaining any, being traced), and resource limits."""

import _thread
import ctypes
import errno
import math
import os
import resource
import struct
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from grs_agents.sandbox.isolation import kernel

_SET_DUMPABLE, _SET_NO_NEW_PRIVS = 4, 38
_READ_BOUNDING, _DROP_BOUNDING = 23, 24
_AMBIENT, _CLEAR_AMBIENT = 47, 4
_VERSION_3 = 0x2008_0522
"""Version of the capability interface: 64 bits in two halves, each of three words."""
_OWN = ctypes.create_string_buffer(struct.pack("=Ii", _VERSION_3, 0))
_NOTHING = ctypes.create_string_buffer(24)

_ACCOUNTS = 0x7000_0000
"""User ids from here on belong to no account, containers and dynamic users included."""


def forbid_new_privileges() -> None:
    """No program started from here may hold more rights than this process: Landlock and seccomp ask for it."""
    kernel.prctl(_SET_NO_NEW_PRIVS, 1)


def drop_capabilities() -> None:
    """Empty all five sets of this thread; from then on only the ownership of files decides."""
    drop_bounding_set()
    with suppress(OSError):  # the ambient set came with Linux 4.3
        kernel.prctl(_AMBIENT, _CLEAR_AMBIENT)
    kernel.make_system_call("capset", ctypes.addressof(_OWN), ctypes.addressof(_NOTHING))


@cache
def drop_bounding_set() -> None:
    """Let no program started from here gain capabilities. Without CAP_SETPCAP the set stays as it is.
    Once is enough: the set never grows again, and forked processes inherit it."""
    capability = 0
    with suppress(PermissionError):
        while (bounded := _is_in_bounding_set(capability)) is not None:
            if bounded:
                kernel.prctl(_DROP_BOUNDING, capability)
            capability += 1


def hide_from_other_processes(hidden: bool = True) -> None:
    """Forbid processes of the same user to trace this process, read its memory or see its open files; or allow it
    again."""
    kernel.prctl(_SET_DUMPABLE, int(not hidden))


def use_unique_user_id() -> bool:
    """Be counted as a user of its own, since the kernel keeps no limit on the number of root's threads.
    Only the *real* user id changes, by which the kernel counts; files are opened as before. Call it while the process
    still holds its capabilities. False without CAP_SETUID or in a name space of few user ids: all stays as it was."""
    try:
        os.setresuid(_ACCOUNTS + int.from_bytes(os.urandom(3), "little"), -1, -1)
    except OSError as error:
        if error.errno in {errno.EPERM, errno.EINVAL}:
            return False
        raise
    return True


def _is_in_bounding_set(capability: int) -> bool | None:
    try:
        return bool(kernel.prctl(_READ_BOUNDING, capability))
    except OSError:  # there is no capability of this number
        return None


@dataclass(frozen=True)
class Allowance:
    """Limits for the rest of the process."""

    # processor time of the whole process, rounded up to whole seconds. `SIGXCPU` announces the limit, and `SIGKILL`
    # ends the process a second later.
    cpu_seconds: float = 50
    memory_mib: int = 1024  # address space beyond the present size. Each thread's stack takes 8 MiB of it.
    file_mib: int = 64  # the largest file that can be written
    descriptors: int = 128  # the lowest number that no descriptor can have
    # threads that may be started. The kernel counts all threads of a *user*, in other processes too, so the present
    # threads are added, root's included (a process which hides itself looks like root's): a bound on damage, not an
    # exact number. It is exact for a process alone in its count.
    threads: int = 64


def set_resource_limits(allowance: Allowance, alone: bool) -> bool:
    """Set all limits, soft and hard, irrevocably; no limit is raised, and the stack's is kept. ``alone`` says that no
    other process counts as this user's (``use_unique_user_id``). Returns: True if the limit on threads binds; it does
    not bind root."""
    cpu = math.ceil(time.process_time() + allowance.cpu_seconds)
    _lower_resource_limit("CPU", cpu, cpu + 1)
    _lower_resource_limit("FSIZE", allowance.file_mib << 20)
    _lower_resource_limit("NOFILE", allowance.descriptors)
    for name in ("CORE", "MEMLOCK", "MSGQUEUE"):
        _lower_resource_limit(name, 0)
    _lower_resource_limit("SIGPENDING", 256)
    tasks = allowance.threads + (1 if alone else _count_user_threads(os.getuid()))
    _lower_resource_limit("NPROC", 0, tasks)
    binds = not _can_start_thread()
    _lower_resource_limit("NPROC", tasks)
    with suppress(FileNotFoundError):  # elsewhere the kernel does not keep a limit on address space
        pages = int(kernel.read_kernel_file("/proc/self/statm").split()[0])
        _lower_resource_limit("AS", pages * resource.getpagesize() + (allowance.memory_mib << 20))
    return binds


def _lower_resource_limit(name: str, soft: int, hard: int | None = None) -> None:
    kind = getattr(resource, f"RLIMIT_{name}", None)
    if kind is None:  # not every system has all of them
        return
    highest = resource.getrlimit(kind)[1]
    wanted = (soft, soft if hard is None else hard)
    if highest != resource.RLIM_INFINITY:
        wanted = (min(wanted[0], highest), min(wanted[1], highest))
    resource.setrlimit(kind, wanted)


def _count_user_threads(user: int) -> int:
    """Number of threads of a user, root's included: a process that cannot be traced looks like root's."""
    total = 0
    with suppress(FileNotFoundError), os.scandir("/proc") as entries:
        for entry in entries:
            if entry.name.isdecimal():
                with suppress(OSError):  # it has ended
                    tasks = Path(entry.path, "task").stat()
                    total += max(tasks.st_nlink - 2, 0) if tasks.st_uid in {user, 0} else 0
    return total


def _can_start_thread() -> bool:
    ended = threading.Lock()
    ended.acquire()
    try:
        _thread.start_new_thread(ended.release, ())
    except RuntimeError:
        return False
    ended.acquire()
    return True
