"""What a call holds that no limit of the kernel bounds: its scratch folder as a whole, its threads, on macOS memory."""

import ctypes
import os
import struct
import sys
from contextlib import suppress
from pathlib import Path

ENTRY_BYTES = 4096
"""What a file or folder costs beside its content; it bounds how many there can be."""
_TASK_INFO, _TASK_INFO_BYTES = 4, 96
_TASK_MEMORY, _TASK_THREADS = 8, 84
"""Of macOS's ``proc_pidinfo``: a kind of facts, their size, and where memory (u64) and threads (i32) are in them."""


def scratch_bytes(folder: Path, most: int) -> int:
    """The bytes that the entries below ``folder`` take; counting stops once they exceed ``most``.

    Folders are opened relative to their parents and left through ``..``, so that no path is ever too long, and links
    are not followed. The code in the sandbox may move things meanwhile: then the count is off, not the process.
    """
    total = 0
    here = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    waiting: list[list[str]] = []
    try:
        total += _files(here, folders := [])
        waiting.append(folders)
        while waiting and total <= most:
            if not waiting[-1]:
                waiting.pop()
                here = _move(here, "..") if waiting else here
                continue
            with suppress(OSError):
                here = _move(here, waiting[-1].pop())
                total += _files(here, folders := [])
                waiting.append(folders)
    except OSError:  # the way back up is gone: only code that hides something moves its own folders about
        return most + 1
    finally:
        os.close(here)
    return total


def _move(here: int, name: str) -> int:
    """Open the folder ``name`` beside the descriptor ``here``, which is closed."""
    if not hasattr(os, "O_PATH"):
        with suppress(OSError, NotImplementedError):
            os.chmod(name, 0o700, dir_fd=here, follow_symlinks=False)
        there = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=here)
        os.close(here)
        return there
    handle = os.open(name, os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=here)
    try:
        with suppress(OSError):  # through the handle: the name may be a link to anywhere by now
            Path(f"/proc/self/fd/{handle}").chmod(0o700)
        there = os.open(f"/proc/self/fd/{handle}", os.O_RDONLY | os.O_DIRECTORY)
    finally:
        os.close(handle)
    os.close(here)
    return there


def _files(descriptor: int, folders: list[str]) -> int:
    """The bytes of the entries of one folder; the names of its folders go to ``folders``."""
    total = 0
    with os.scandir(descriptor) as entries:
        for entry in entries:
            total += ENTRY_BYTES
            if entry.is_dir(follow_symlinks=False):
                folders.append(entry.name)
                continue
            with suppress(OSError):
                total += entry.stat(follow_symlinks=False).st_blocks * 512
    return total


def threads(pid: int) -> int:
    """How many threads the process ``pid`` has; 0 once it is gone, 1 where the system does not tell."""
    if sys.platform == "darwin":
        return _task_info(pid)[1]
    try:
        with Path(f"/proc/{pid}/status").open(encoding="ascii", errors="replace") as status:
            found = next((line for line in status if line.startswith("Threads:")), "Threads: 1")
    except FileNotFoundError:
        return 0 if Path("/proc/self").is_dir() else 1
    return int(found.split()[1])


def memory(pid: int) -> int:
    """The bytes of memory that the process ``pid`` holds, where the kernel keeps no limit on them; 0 elsewhere."""
    return _task_info(pid)[0] if sys.platform == "darwin" else 0


def _task_info(pid: int) -> tuple[int, int]:
    """Memory in bytes and threads of a process of macOS."""
    facts = ctypes.create_string_buffer(_TASK_INFO_BYTES)
    none = ctypes.c_uint64(0)
    if ctypes.CDLL(None).proc_pidinfo(pid, _TASK_INFO, none, facts, _TASK_INFO_BYTES) != _TASK_INFO_BYTES:
        return 0, 0  # it is gone
    return struct.unpack_from("=Q", facts, _TASK_MEMORY)[0], struct.unpack_from("=i", facts, _TASK_THREADS)[0]


def file_system_bytes(folder: Path) -> int:
    """The bytes in use on the file system that ``folder`` is the root of, each entry counted as ``ENTRY_BYTES``."""
    facts = os.statvfs(folder)
    entries = max(0, facts.f_files - facts.f_ffree - 1)
    return (facts.f_blocks - facts.f_bfree) * facts.f_frsize + entries * ENTRY_BYTES
