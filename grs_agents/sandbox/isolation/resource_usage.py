"""Resource usage that no limit of the kernel bounds: the scratch folder as a whole, threads, memory on macOS."""

import ctypes
import os
import re
import stat
import struct
import sys
from contextlib import suppress
from pathlib import Path

from grs_agents.sandbox.isolation import kernel

ENTRY_BYTES = 64 << 10
"""Cost of a file or folder beside its content. It bounds their number, 1,024 in 64 MiB: removing each takes up to 4 ms
(ext4), and no call begins meanwhile."""
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW
_TRIES = 3
_THREADS = re.compile(rb"^Threads:\s*(\d+)", re.MULTILINE)
_TASK_INFO, _TASK_INFO_BYTES = 4, 96
_TASK_MEMORY, _TASK_THREADS = 8, 84
"""macOS's ``proc_pidinfo``: a kind of facts, their size, and the offsets of memory (u64) and threads (i32) in them."""


def count_scratch_bytes(folder: Path, most: int) -> int:
    """The bytes that the entries below ``folder`` take; counting stops once they exceed ``most``.

    Folders are opened relative to their parents and left through ``..``, so that no path is ever too long, and links
    are not followed. Nothing is changed. A folder that cannot be looked into, or that is moved about whenever it is
    looked at, counts as too much.
    """
    for _ in range(_TRIES):
        total = _try_counting_bytes(folder, most)
        if total is not None:
            return total
    return most + 1


def _try_counting_bytes(folder: Path, most: int) -> int | None:
    """A single attempt at counting; None if a folder moved or vanished meanwhile."""
    here = os.open(folder, _FOLDER)
    try:
        total, names = _measure_folder_entries(here)
        way = [(_device_inode(here), names)]
        while total <= most:
            name = way[-1][1].pop() if way[-1][1] else ".."
            if name == ".." and len(way) == 1:
                break
            there = os.open(name, _FOLDER, dir_fd=here)
            os.close(here)
            here = there
            if name == "..":
                way.pop()
                if (
                    _device_inode(here) != way[-1][0]
                ):  # its parent has changed, perhaps to a folder out of the scratch folder
                    return None
                continue
            taken, names = _measure_folder_entries(here)
            way.append((_device_inode(here), names))
            total += taken
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError:  # made so that it cannot be opened
        return most + 1
    finally:
        os.close(here)
    return total


def _device_inode(descriptor: int) -> tuple[int, int]:
    facts = os.fstat(descriptor)
    return facts.st_dev, facts.st_ino


def _measure_folder_entries(descriptor: int) -> tuple[int, list[str]]:
    """The bytes of a folder's entries, and the names of its folders."""
    total = 0
    folders: list[str] = []
    with os.scandir(descriptor) as entries:
        for entry in entries:
            total += ENTRY_BYTES
            if entry.is_dir(follow_symlinks=False):
                folders.append(entry.name)
                continue
            with suppress(OSError):
                total += entry.stat(follow_symlinks=False).st_blocks * 512
    return total, folders


def count_unlinked_bytes(pid: int) -> int:
    """The bytes of unlinked files that the process ``pid`` holds open; 0 if unknown."""
    total = 0
    with suppress(OSError), os.scandir(f"/proc/{pid}/fd") as entries:
        for entry in entries:
            with suppress(OSError):
                facts = entry.stat()  # of the open file, which the entry is a link to
                if stat.S_ISREG(facts.st_mode) and facts.st_nlink == 0:
                    total += facts.st_blocks * 512
    return total


def count_threads(pid: int) -> int:
    """Number of threads of the process ``pid``; 0 after its end, 1 if the system does not say."""
    if sys.platform == "darwin":
        return _macos_memory_and_threads(pid)[1]
    try:
        status = kernel.read_kernel_file(f"/proc/{pid}/status")
    except (FileNotFoundError, ProcessLookupError):
        return 0 if Path("/proc/self").is_dir() else 1
    match = _THREADS.search(status)
    return int(match[1]) if match else 1


def count_memory_bytes(pid: int) -> int:
    """The bytes of memory that the process ``pid`` holds, if the kernel keeps no limit on them; 0 elsewhere."""
    return _macos_memory_and_threads(pid)[0] if sys.platform == "darwin" else 0


def _macos_memory_and_threads(pid: int) -> tuple[int, int]:
    """Memory in bytes and threads of a process of macOS."""
    facts = ctypes.create_string_buffer(_TASK_INFO_BYTES)
    none = ctypes.c_uint64(0)
    if ctypes.CDLL(None).proc_pidinfo(pid, _TASK_INFO, none, facts, _TASK_INFO_BYTES) != _TASK_INFO_BYTES:
        return 0, 0  # it is gone
    return struct.unpack_from("=Q", facts, _TASK_MEMORY)[0], struct.unpack_from("=i", facts, _TASK_THREADS)[0]


def count_file_system_bytes(folder: Path) -> int:
    """The bytes in use on the file system that ``folder`` is the root of, each entry counted as ``ENTRY_BYTES``."""
    facts = os.statvfs(folder)
    entries = max(0, facts.f_files - facts.f_ffree - 1)
    return (facts.f_blocks - facts.f_bfree) * facts.f_frsize + entries * ENTRY_BYTES
