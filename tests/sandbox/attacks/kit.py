"""What every attack program uses. It runs inside the sandbox, and is read by the tests for what they expect.

An attack is a function of the world, and of the case if it has several. What it returns is its loot; an ``OSError`` is
named by its errno, any other exception by its type; an attack that returns None got ``nothing``.
"""

import ctypes
import errno
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from grs_agents.sandbox.harness.captured_error import CapturedError

World = Mapping[str, Any]
"""The host's canaries, as ``world.Canaries.world`` lists them."""

REFUSED = ("EPERM", "EACCES", "ENOSYS", "crashed by SIGSYS")
"""What the kernel says to a call that is not allowed."""
HIDDEN = (*REFUSED, "EROFS", "ENOENT", "ENOTDIR", "EXDEV")
"""What it says of a file that is not there to be touched."""
UNKNOWN = (*REFUSED, "ESRCH", "ENOENT")
"""What it says of a process that is not there to be touched."""


@dataclass(frozen=True)
class Attack:
    """One attack and what it may get.

    Attributes:
        run: makes it.
        answers: the only ones that are no escape.
        limits: other limits for this call.
        cases: it is made once for each of these names, and gets the value of the name.
        machine: it is machine code for this processor, None for any.
        promised_by: the one backend that stops it, None for all.
    """

    run: Callable[..., Any]
    answers: tuple[str, ...]
    limits: Mapping[str, float]
    cases: Mapping[str, Any] | None = None
    machine: str | None = None
    promised_by: str | None = None


def gets(
    *answers: str,
    cases: Mapping[str, Any] | None = None,
    machine: str | None = None,
    promised_by: str | None = None,
    **limits: float,
) -> Callable[[Callable[..., Any]], Attack]:
    """Say what the decorated attack may get; see `Attack`."""
    return lambda run: Attack(run, answers, limits, cases, machine, promised_by)


libc = ctypes.CDLL(None, use_errno=True)
libc.popen.restype = libc.fopen.restype = ctypes.c_void_p

# The numbers of system calls: x86-64 first, then aarch64 ("-": it has none); from 424 on all architectures share them.
_TABLE = """
acct 163 89, add_key 248 217, bpf 321 280, capset 126 91, clone 56 220, execveat 322 281, fanotify_init 300 262,
init_module 175 105, io_setup 206 0, ioperm 173 -, iopl 172 -, ioprio_set 251 30, kcmp 312 272,
kexec_load 246 104, keyctl 250 219, kill 62 129, memfd_create 319 279, migrate_pages 256 238, modify_ldt 154 -,
mount 165 40, move_pages 279 239, mq_open 240 180, msgget 68 186, name_to_handle_at 303 264,
open_by_handle_at 304 265, perf_event_open 298 241, pivot_root 155 41, prlimit64 302 261,
process_vm_readv 310 270, process_vm_writev 311 271, ptrace 101 117, quotactl 179 60, reboot 169 142,
request_key 249 218, rt_sigqueueinfo 129 138, rt_tgsigqueueinfo 297 240, seccomp 317 277, semget 64 190,
setdomainname 171 162, sethostname 170 161, setns 308 268, shmget 29 194, swapon 167 224, syslog 103 116,
tgkill 234 131, tkill 200 130, umount2 166 39, unshare 272 97, userfaultfd 323 282, vhangup 153 58,
vmsplice 278 75, pidfd_send_signal 424 424, io_uring_setup 425 425, open_tree 428 428, fsopen 430 430,
fspick 433 433, pidfd_open 434 434, clone3 435 435, openat2 437 437, pidfd_getfd 438 438,
process_madvise 440 440, mount_setattr 442 442, landlock_create_ruleset 444 444, landlock_add_rule 445 445,
landlock_restrict_self 446 446, memfd_secret 447 447, process_mrelease 448 448
"""
_NUMBERS = {
    name: tuple(int(number) if number.isdecimal() else None for number in numbers)
    for name, *numbers in (row.split() for row in _TABLE.split(","))
}


def call(name: str, *arguments: Any) -> int:
    """The system call ``name``, past every wrapper; ``-ENOSYS`` where the architecture has none."""
    number = _NUMBERS[name][0 if platform.machine() == "x86_64" else 1]
    return check(-1, errno.ENOSYS) if number is None else numbered(number, *arguments)


def numbered(number: int, *arguments: Any) -> int:
    """The system call with this number; its result.

    Raises:
        OSError: it failed.
    """
    whole = [ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments]
    libc.syscall.restype = ctypes.c_long
    return check(libc.syscall(ctypes.c_long(number), *whole))


def check(result: int, error: int | None = None) -> int:
    """The result of a C function, unless it is -1.

    Raises:
        OSError: it is -1; the error is ``errno`` unless one is given.
    """
    if result == -1:
        raise OSError(ctypes.get_errno() if error is None else error, "refused")
    return result


def answer(attack: Callable[..., Any], *arguments: Any) -> Any:
    """What an attack got: its loot, the name of its error, or ``nothing``."""
    with CapturedError() as caught:
        loot = attack(*arguments)
        return "nothing" if loot is None else loot
    if isinstance(caught.error, MemoryError):
        raise caught.error
    number = getattr(caught.error, "errno", None)
    return errno.errorcode.get(number, "") if number else type(caught.error).__name__


def succeeded(attempts: Mapping[str, Callable[[], Any]]) -> list[str] | None:
    """The names of the attempts that raised no error, None if all did."""
    found: list[str] = []
    for name, attempt in attempts.items():
        try:
            attempt()
        except (OSError, ValueError, RuntimeError, LookupError):
            continue
        found.append(name)
    return found or None
