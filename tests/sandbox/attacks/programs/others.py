"""Reaching for other processes: the host, the zygote, and one that has nothing to do with it."""

import ctypes
import fcntl
import os
import resource
import signal
from collections.abc import Callable
from typing import Any

from tests.sandbox.attacks.kit import UNKNOWN, World, call, check, gets, libc, succeeded

SIGINFO = bytes(128)


def kill(pid: int, number: int) -> dict[str, Callable[[], Any]]:
    """Every way to send a signal to somebody else: with name spaces of processes the number may be one's own inside."""
    if pid == os.getpid():
        raise ProcessLookupError
    return {
        "kill": lambda: os.kill(pid, number),
        "kill of C": lambda: check(libc.kill(pid, number)),
        "kill by number": lambda: call("kill", pid, number),
        "tgkill": lambda: call("tgkill", pid, pid, number),
        "tkill": lambda: call("tkill", pid, number),
        "sigqueue": lambda: check(libc.sigqueue(pid, number, None)),
        "rt_sigqueueinfo": lambda: call("rt_sigqueueinfo", pid, number, SIGINFO),
        "rt_tgsigqueueinfo": lambda: call("rt_tgsigqueueinfo", pid, pid, number, SIGINFO),
        "pidfd": lambda: call("pidfd_send_signal", call("pidfd_open", pid, 0), number, None, 0),
        "pidfd by folder": lambda: call(
            "pidfd_send_signal", os.open(f"/proc/{pid}", os.O_DIRECTORY | os.O_RDONLY), number, None, 0
        ),
        "group": lambda: os.killpg(pid, number),
        "alarm of a descriptor": lambda: _by_descriptor(pid, number),
    }


def _by_descriptor(pid: int, number: int) -> None:
    """A pipe sends its owner a signal of one's choice as soon as there is something to read."""
    reader, writer = os.pipe()
    fcntl.fcntl(reader, fcntl.F_SETOWN, pid)
    fcntl.fcntl(reader, 10, number)  # F_SETSIG
    fcntl.fcntl(reader, fcntl.F_SETFL, os.O_ASYNC | os.O_NONBLOCK)
    os.write(writer, b"x")
    if fcntl.fcntl(reader, fcntl.F_GETOWN) != pid:
        raise ProcessLookupError


WAYS = {name: name for name in kill(0, 0)}


@gets("nothing", *UNKNOWN, cases=WAYS)
def kill_a_process(world: World, name: str) -> str | None:
    """Whatever the call says, the victim must live: the test looks."""
    kill(world["victim"], signal.SIGKILL)[name]()
    return None if name == "alarm of a descriptor" else name


@gets("nothing", *UNKNOWN, cases=WAYS)
def signal_the_host(world: World, name: str) -> str | None:
    """Signal 0 asks whether one may; the alarm of a descriptor is a harmless signal."""
    harmless = signal.SIGURG if name == "alarm of a descriptor" else 0
    kill(world["host"], harmless)[name]()
    return None if name == "alarm of a descriptor" else name


@gets("nothing", *UNKNOWN, cases=WAYS)
def signal_the_zygote(world: World, name: str) -> str | None:
    harmless = signal.SIGURG if name == "alarm of a descriptor" else 0
    kill(os.getppid() or 1, harmless)[name]()
    return None if name in ("alarm of a descriptor", "group") else name


@gets(*UNKNOWN, cases={"all": -1, "first process": 1})
def signal_everybody(world: World, pid: int) -> str:
    os.kill(pid, 0)
    return "one may"


class _Vector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def meddle(pid: int) -> dict[str, Callable[[], Any]]:
    """Every other call that names a process."""
    limit = (ctypes.c_uint64 * 2)(1, 1)
    old = (ctypes.c_uint64 * 2)()
    byte = ctypes.create_string_buffer(1)
    here = _Vector(ctypes.addressof(byte), 1)
    return {
        "prlimit": lambda: call("prlimit64", pid, resource.RLIMIT_CORE, limit, None),
        "prlimit, reading": lambda: call("prlimit64", pid, resource.RLIMIT_CORE, None, old),
        "ptrace seize": lambda: call("ptrace", 0x4206, pid, 0, 0),
        "process_vm_writev": lambda: call("process_vm_writev", pid, ctypes.byref(here), 1, ctypes.byref(here), 1, 0),
        "process_madvise": lambda: call("process_madvise", call("pidfd_open", pid, 0), ctypes.byref(here), 1, 21, 0),
        "process_mrelease": lambda: call("process_mrelease", call("pidfd_open", pid, 0), 0),
        "pidfd_getfd": lambda: call("pidfd_getfd", call("pidfd_open", pid, 0), 0, 0),
        "kcmp": lambda: call("kcmp", os.getpid(), pid, 1, 0, 0) + 1,
        "migrate_pages": lambda: call("migrate_pages", pid, 1, byref(1), byref(1)) + 1,
        "move_pages": lambda: call("move_pages", pid, 0, 0, 0, 0, 0) + 1,
        "setpriority": lambda: os.setpriority(os.PRIO_PROCESS, pid, 19),
        "ioprio_set": lambda: call("ioprio_set", 1, pid, 3 << 13),
        "sched_setaffinity": lambda: os.sched_setaffinity(pid, {min(os.sched_getaffinity(0))}),
        "sched_setscheduler": lambda: os.sched_setscheduler(pid, os.SCHED_IDLE, os.sched_param(0)),
        "setpgid": lambda: os.setpgid(pid, pid),
        "oom_score_adj": lambda: os.write(os.open(f"/proc/{pid}/oom_score_adj", os.O_WRONLY), b"1000"),
        "namespaces": lambda: check(libc.setns(call("pidfd_open", pid, 0), 0x20000)),
        "namespaces by file": lambda: check(libc.setns(os.open(f"/proc/{pid}/ns/mnt", os.O_RDONLY), 0)),
    }


def byref(value: int) -> Any:
    """A pointer to an unsigned long."""
    return ctypes.byref(ctypes.c_ulong(value))


MEDDLING = {name: name for name in meddle(0)}
_LASTING = """
prlimit setpriority ioprio_set sched_setaffinity sched_setscheduler setpgid oom_score_adj process_mrelease
process_vm_writev
"""
LASTING = ("ptrace seize", *_LASTING.split())


@gets("nothing", cases=MEDDLING)
def meddle_with_others(world: World, name: str) -> list[str] | None:
    pids = {"victim": world["victim"]}
    if name not in LASTING:  # what would last is never tried on the host
        pids |= {"host": world["host"], "first": 1}
    if os.getppid() not in (0, world["host"]):
        pids["parent"] = os.getppid()
    return succeeded({who: meddle(pid)[name] for who, pid in pids.items() if pid != os.getpid()})


@gets("nothing", *UNKNOWN)
def signals_of_descriptors_to_all(world: World) -> list[str] | None:
    """``F_SETOWN`` takes groups as well, and so does the older ``ioctl``."""
    reader, writer = os.pipe()
    attempts = {
        "ioctl": lambda: fcntl.ioctl(reader, 0x8901, world["victim"].to_bytes(4, "little")),
        "thread": lambda: fcntl.fcntl(reader, 15, (0).to_bytes(4, "little") + world["victim"].to_bytes(4, "little")),
    }
    succeeded(attempts)
    fcntl.fcntl(reader, 10, int(signal.SIGKILL))
    fcntl.fcntl(reader, fcntl.F_SETFL, os.O_ASYNC | os.O_NONBLOCK)
    os.write(writer, b"x")
    return None
