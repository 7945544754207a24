"""What a process gives up for good: capabilities, gaining any, being looked into, root's freedom to start threads."""

import ctypes
import errno
import os
import struct
from contextlib import suppress
from functools import cache

from grs_agents.sandbox.isolation import kernel

_SET_DUMPABLE, _SET_NO_NEW_PRIVS = 4, 38
_READ_BOUNDING, _DROP_BOUNDING = 23, 24
_AMBIENT, _CLEAR_AMBIENT = 47, 4
_VERSION_3 = 0x2008_0522
"""Of the capability interface: 64 bits in two halves, each of three words."""
_OWN = ctypes.create_string_buffer(struct.pack("=Ii", _VERSION_3, 0))
_NOTHING = ctypes.create_string_buffer(24)

_ACCOUNTS = 0x7000_0000
"""User ids from here on are given to nobody, containers and dynamic users included."""


def gain_no_more() -> None:
    """No program started from here may hold more rights than this process: Landlock and seccomp ask for it."""
    kernel.prctl(_SET_NO_NEW_PRIVS, 1)


def drop_capabilities() -> None:
    """Empty all five sets of this thread; what it may still do is decided by the owner of a file."""
    drop_bounding_set()
    with suppress(OSError):  # the ambient set came with Linux 4.3
        kernel.prctl(_AMBIENT, _CLEAR_AMBIENT)
    kernel.call("capset", ctypes.addressof(_OWN), ctypes.addressof(_NOTHING))


@cache
def drop_bounding_set() -> None:
    """Let no program started from here gain capabilities. Without CAP_SETPCAP the set stays as it is.

    Once is enough: the set never grows again, and forked processes inherit it.
    """
    capability = 0
    with suppress(PermissionError):
        while (bounded := _in_bounding_set(capability)) is not None:
            if bounded:
                kernel.prctl(_DROP_BOUNDING, capability)
            capability += 1


def hide(hidden: bool = True) -> None:
    """Let no process of the same user trace this one, read its memory or see its open files; or let them again."""
    kernel.prctl(_SET_DUMPABLE, int(not hidden))


def leave_roots_count() -> bool:
    """Be counted as a user of its own, since the kernel keeps no limit on the number of root's threads.

    Only the *real* user id changes, by which the kernel counts; files are opened as before. Call it while the process
    still holds its capabilities.

    Returns:
        Whether it is; without CAP_SETUID or in a name space of few user ids everything stays as it was.
    """
    try:
        os.setresuid(_ACCOUNTS + int.from_bytes(os.urandom(3), "little"), -1, -1)
    except OSError as error:
        if error.errno in {errno.EPERM, errno.EINVAL}:
            return False
        raise
    return True


def _in_bounding_set(capability: int) -> bool | None:
    try:
        return bool(kernel.prctl(_READ_BOUNDING, capability))
    except OSError:  # there is no capability of this number
        return None
