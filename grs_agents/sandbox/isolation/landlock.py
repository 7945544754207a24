"""Landlock rules of the kernel for files, connections and signals. Landlock does not cover attributes of a path:
permission bits, owner, times, extended attributes. The seccomp filter denies those calls."""

import ctypes
import errno
import os
import stat
import struct
from collections.abc import Sequence
from contextlib import suppress
from enum import IntFlag
from pathlib import Path

from grs_agents.sandbox.isolation import kernel


class Access(IntFlag):
    """The kernel's rights on files, in its order of bits."""

    EXECUTE = 1 << 0
    WRITE_FILE = 1 << 1
    READ_FILE = 1 << 2
    READ_DIR = 1 << 3
    REMOVE_DIR = 1 << 4
    REMOVE_FILE = 1 << 5
    MAKE_CHAR = 1 << 6
    MAKE_DIR = 1 << 7
    MAKE_REG = 1 << 8
    MAKE_SOCK = 1 << 9
    MAKE_FIFO = 1 << 10
    MAKE_BLOCK = 1 << 11
    MAKE_SYM = 1 << 12
    REFER = 1 << 13
    TRUNCATE = 1 << 14
    IOCTL_DEV = 1 << 15


_READ = Access.READ_FILE | Access.READ_DIR
_ON_A_FILE = Access.READ_FILE | Access.WRITE_FILE | Access.TRUNCATE
_REMOVE = Access.REMOVE_DIR | Access.REMOVE_FILE
_MAKE = Access.MAKE_DIR | Access.MAKE_REG | Access.MAKE_SYM
_WRITE = _READ | _ON_A_FILE | _REMOVE | _MAKE | Access.REFER

_FIRST_ABI = {Access.REFER: 2, Access.TRUNCATE: 3, Access.IOCTL_DEV: 5}
"""Rights younger than the first version."""

_BIND_AND_CONNECT_TCP = 1 << 0 | 1 << 1
_ABSTRACT_SOCKETS_AND_SIGNALS = 1 << 0 | 1 << 1
_VERSION = 1 << 0
_BENEATH = 1
_ABSENT = (FileNotFoundError, NotADirectoryError, PermissionError)


def abi_version() -> int:
    """The version of Landlock that this kernel offers; 0 if it has none, or does not enable it."""
    try:
        return kernel.make_system_call("landlock_create_ruleset", 0, 0, _VERSION)
    except OSError:
        return 0


def unavailability_reason() -> str:
    """Reason why this kernel offers no Landlock; empty if it does."""
    try:
        kernel.make_system_call("landlock_create_ruleset", 0, 0, _VERSION)
    except OSError as error:
        if error.errno == errno.EOPNOTSUPP:
            return "the kernel was started without it: add landlock to the boot parameter lsm="
        return f"the kernel has none, it came with Linux 5.13: {error.strerror}"
    return ""


def create_ruleset(readable: Sequence[Path], writable: Sequence[Path]) -> int:
    """A descriptor of the rights that ``restrict_file_access`` leaves; a forked process inherits it.

    Folders include all of their content; an absent path is left out. In ``writable`` folders files, folders and links
    may be made and removed. Nothing may be executed, no device, socket or pipe be made. Version 4 also denies TCP,
    version 6 signals to processes outside and sockets of the abstract name space. ``OSError`` if there is no Landlock.
    """
    version = abi_version()
    # All rights that this version knows, since unhandled rights stay free.
    handled = Access(sum(right for right in Access if version >= _FIRST_ABI.get(right, 1)))
    fields: list[int] = [handled]
    if version >= 4:
        fields.append(_BIND_AND_CONNECT_TCP)
    if version >= 6:
        fields.append(_ABSTRACT_SOCKETS_AND_SIGNALS)
    attributes = ctypes.create_string_buffer(struct.pack(f"={len(fields)}Q", *fields))
    ruleset = kernel.make_system_call("landlock_create_ruleset", ctypes.addressof(attributes), 8 * len(fields), 0)
    for paths, rights in ((readable, _READ), (writable, _WRITE)):
        for path in paths:
            with suppress(*_ABSENT):
                granted = rights & handled
                descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
                try:
                    if not stat.S_ISDIR(os.fstat(descriptor).st_mode):
                        granted &= _ON_A_FILE
                    rule = ctypes.create_string_buffer(struct.pack("=Qi", granted, descriptor))
                    kernel.make_system_call("landlock_add_rule", ruleset, _BENEATH, ctypes.addressof(rule), 0)
                finally:
                    os.close(descriptor)
    return ruleset


def restrict_file_access(ruleset: int) -> None:
    """Restrict this thread, and all it will start, to the file rights of ``create_ruleset``, irrevocably. ``OSError``
    if the kernel has no Landlock, or the process may still gain privileges."""
    kernel.make_system_call("landlock_restrict_self", ruleset, 0)
