"""The few system calls that Python has no function for; a failure is an ``OSError``, as elsewhere in Python."""

import ctypes
import os
import sys
from typing import Literal

from grs_agents.sandbox.isolation.syscalls import NUMBERS

Machine = Literal["x86_64", "aarch64"]

_libc = ctypes.CDLL(None, use_errno=True)
if sys.platform == "linux":
    _libc.syscall.restype = ctypes.c_long
    _libc.syscall.argtypes = [ctypes.c_long] * 7
    _libc.prctl.argtypes = [ctypes.c_int] + [ctypes.c_long] * 4


def machine() -> Machine | None:
    """Which table of system calls this process uses; None if it is neither of the two that are known here."""
    if sys.platform != "linux" or sys.maxsize < 1 << 32:
        return None
    match os.uname().machine:
        case "x86_64" | "aarch64" as known:
            return known
        case _:
            return None


def call(name: str, *arguments: int) -> int:
    """Make a system call by name; addresses are passed as integers.

    Raises:
        OSError: what the kernel answered; ENOSYS (38) also if the machine is not known.
    """
    kind = machine()
    if kind is None:
        raise OSError(38, f"{name} is a system call of Linux on x86-64 and aarch64")
    return _checked(_libc.syscall(NUMBERS[kind][name], *_padded(arguments, 6)))


def prctl(option: int, *arguments: int) -> int:
    """Read or set a property of this thread or process; arguments left out are 0.

    Raises:
        OSError: what the kernel answered.
    """
    return _checked(_libc.prctl(option, *_padded(arguments, 4)))


def read(path: str) -> bytes:
    """What the kernel tells in one of its small files, without the buffers that a file object sets up.

    Raises:
        OSError: it does not.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        return os.read(descriptor, 1 << 16)
    finally:
        os.close(descriptor)


def write(path: str, data: bytes) -> None:
    """Tell the kernel something through one of its small files.

    Raises:
        OSError: it does not take it.
    """
    descriptor = os.open(path, os.O_WRONLY)
    try:
        os.write(descriptor, data)
    finally:
        os.close(descriptor)


def _padded(arguments: tuple[int, ...], count: int) -> tuple[int, ...]:
    return arguments + (0,) * (count - len(arguments))


def _checked(result: int) -> int:
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))
    return result
