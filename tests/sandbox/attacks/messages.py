"""Where a call might leave a message for the next. Each function leaves one if told to, and says what it finds.

It runs inside the sandbox, in two calls; ``token`` and ``key`` are names that nobody else uses.
"""

import ctypes
import os
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import grs_agents

libc = ctypes.CDLL(None)
FOLDERS = ("..", "/", "/tmp", "/var/tmp", "/dev/shm", "/run", "/dev/mqueue", str(Path(grs_agents.__file__).parent))


def folder_of_the_call(leave: bool, token: str, key: int) -> Any:
    if leave:
        Path(token).write_text("x")
        Path(f".{token}").mkdir()
    return sorted(path.name for path in Path().iterdir())


def other_folders(leave: bool, token: str, key: int) -> Any:
    for folder in [*FOLDERS, os.environ.get("HOME", "/")]:
        with suppress(OSError):
            if leave:
                Path(folder, token).write_text("x")
    return [folder for folder in FOLDERS if Path(folder, token).exists()]


def owner_of_a_folder(leave: bool, token: str, key: int) -> Any:
    """Times and permissions of what one may only read carry messages as well."""
    found: list[Any] = []
    for folder in (".", "..", "/", "/tmp", "/dev", "/proc"):
        with suppress(OSError):
            if leave:
                os.utime(folder, (7, 7))
                Path(folder).chmod(0o701)
        with suppress(OSError):
            found.append([folder, Path(folder).stat().st_mode, Path(folder).stat().st_mtime == 7])
    return None if leave else found


def name_of_a_process(leave: bool, token: str, key: int) -> Any:
    """Of the one that it was forked from."""
    for path in (f"/proc/{os.getppid()}/comm", "/proc/1/comm", "/proc/sys/kernel/hostname"):
        with suppress(OSError):
            if leave:
                Path(path).write_text(token[:10])
    return _read(f"/proc/{os.getppid()}/comm"), _read("/proc/1/comm"), socket.gethostname()


def shared_memory(leave: bool, token: str, key: int) -> Any:
    return None if leave and libc.shmget(key, 4096, 0o1600) else libc.shmget(key, 0, 0)


def semaphores(leave: bool, token: str, key: int) -> Any:
    return None if leave and libc.semget(key, 1, 0o1600) else libc.semget(key, 0, 0)


def message_queue(leave: bool, token: str, key: int) -> Any:
    return None if leave and libc.msgget(key, 0o1600) else libc.msgget(key, 0)


def posix_queue(leave: bool, token: str, key: int) -> Any:
    return libc.mq_open(f"/{token}".encode(), os.O_RDWR | (os.O_CREAT if leave else 0), 0o600, None) >= 0 and not leave


def key_ring(leave: bool, token: str, key: int) -> Any:
    if leave:
        for ring in (-3, -4, -5):
            libc.syscall(248, b"user", token.encode(), b"x", 1, ring)
    return None if leave else [libc.syscall(250, 10, ring, b"user", token.encode(), 0) for ring in (-3, -4, -5)]


def abstract_socket(leave: bool, token: str, key: int) -> Any:
    if leave and (descriptor := libc.socket(socket.AF_UNIX, socket.SOCK_STREAM, 0)) >= 0:
        libc.bind(descriptor, b"\1\0\0left" + token.encode(), 20)
        libc.listen(descriptor, 1)
    return f"left{token}" in _read("/proc/net/unix")


def process(leave: bool, token: str, key: int) -> Any:
    """One that goes on, with the folder of the call as its own."""
    if leave and libc.fork() == 0:
        libc.setsid()
        for _ in range(20):
            time.sleep(1)
            Path(token).write_text("x")
        os._exit(0)
    return [path.name for path in Path().iterdir()]


def pipes(leave: bool, token: str, key: int) -> Any:
    """What is written into every descriptor, and read from every descriptor."""
    found: list[str] = []
    for descriptor in (0, *range(3, 128)):
        with suppress(OSError):
            os.set_blocking(descriptor, False)
            if leave:
                os.write(descriptor, token.encode())
            else:
                found.append(os.read(descriptor, 1000).decode("latin-1"))
    return None if leave else [text for text in found if token in text]


def _read(path: str) -> str:
    with suppress(OSError):
        return Path(path).read_text()
    return ""
