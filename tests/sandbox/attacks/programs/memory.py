"""Memory beyond the limit; every attempt stops at 3 GiB, or 200 MiB where no limit of the process counts it."""

import ctypes
import mmap
import os
import threading

import numpy as np

from tests.sandbox.attacks.kit import REFUSED, World, call, check, gets, libc, numbered

FULL = ("memory_limit", "ENOMEM", "MemoryError")
CHUNK = 64 << 20
MOST = 3 << 30


@gets(*FULL)
def bytes_in_a_list(world: World) -> int:
    held = [bytearray(CHUNK) for _ in range(MOST // CHUNK)]
    return len(held) * CHUNK


@gets(*FULL)
def arrays(world: World) -> int:
    held = [np.ones(CHUNK // 8) for _ in range(MOST // CHUNK)]
    return len(held) * CHUNK


@gets(*FULL)
def one_large_array(world: World) -> int:
    return int(np.zeros(MOST // 8).nbytes)


@gets(*FULL, cases={"shared": mmap.MAP_SHARED, "private": mmap.MAP_PRIVATE, "no reserve": mmap.MAP_PRIVATE | 0x4000})
def anonymous_mapping(world: World, kind: int) -> int:
    held = [mmap.mmap(-1, CHUNK, kind | mmap.MAP_ANONYMOUS) for _ in range(MOST // CHUNK)]
    return len(held) * CHUNK


@gets(*FULL)
def memory_of_c(world: World) -> int:
    libc.malloc.restype = ctypes.c_void_p
    blocks = [libc.malloc(ctypes.c_size_t(CHUNK)) for _ in range(MOST // CHUNK)]
    if not all(blocks):
        raise MemoryError
    return len(blocks) * CHUNK


@gets(*FULL, "RuntimeError")
def stacks_of_threads(world: World) -> int:
    threading.stack_size(CHUNK)
    stop = threading.Event()
    threads = [threading.Thread(target=stop.wait, daemon=True) for _ in range(MOST // CHUNK)]
    try:
        for thread in threads:
            thread.start()
    finally:
        stop.set()
    return len(threads)


@gets(*REFUSED, "ENOMEM", "crashed by SIGBUS")
def huge_pages(world: World) -> int:
    """They are counted by no limit that a process inherits."""
    return mmap.mmap(-1, 2 << 20, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x40000)[0]


@gets(*REFUSED, "ENOMEM", "EAGAIN")
def locked_memory(world: World) -> int:
    held = mmap.mmap(-1, CHUNK)
    address = ctypes.addressof(ctypes.c_char.from_buffer(held))
    return check(libc.mlock(ctypes.c_void_p(address), ctypes.c_size_t(CHUNK)))


@gets(*REFUSED)
def memory_file(world: World) -> int:
    """A file of no file system, which outgrows the address space."""
    return call("memfd_create", b"hog", 0)


@gets(*REFUSED)
def secret_memory(world: World) -> int:
    return call("memfd_secret", 0)


@gets(*REFUSED)
def memory_of_the_next_process(world: World) -> int:
    """System V shared memory outlives whoever made it."""
    return call("shmget", world["key"], CHUNK, 0o1600)


@gets(*REFUSED)
def semaphores(world: World) -> int:
    return call("semget", world["key"], 8, 0o1600)


@gets(*REFUSED)
def message_queue(world: World) -> int:
    return call("msgget", world["key"], 0o1600)


@gets(*REFUSED)
def posix_message_queue(world: World) -> int:
    return call("mq_open", world["token"].encode(), os.O_CREAT | os.O_RDWR, 0o600, None)


@gets(*REFUSED, "ENOENT", "EROFS")
def posix_shared_memory(world: World) -> int:
    return check(libc.shm_open(f"/{world['token']}".encode(), os.O_CREAT | os.O_RDWR, 0o600))


@gets("nothing")
def memory_of_pipes(world: World) -> int | None:
    """What lies in pipes belongs to nobody: 64 MiB at most."""
    pipes, written = [], 0
    try:
        while written < 200 << 20:
            pipes.append(os.pipe2(os.O_NONBLOCK))
            libc.fcntl(pipes[-1][1], 1031, 1 << 20)
            written += os.write(pipes[-1][1], bytes(1 << 20))
    except OSError:
        return written if written > 64 << 20 else None
    return written


@gets(*REFUSED)
def one_endless_pipe(world: World) -> int:
    return check(libc.fcntl(os.pipe()[1], 1031, 64 << 20))


@gets(*REFUSED)
def memory_of_asynchronous_input(world: World) -> int:
    """``io_setup`` pins kernel memory, of which there is one purse for all processes."""
    return call("io_setup", 1024, ctypes.byref(ctypes.c_ulong(0)))


@gets("nothing", "memory_limit")
def a_break_beyond_the_limit(world: World) -> int | None:
    """``brk``, the oldest way to memory."""
    number = 12 if os.uname().machine == "x86_64" else 214
    start = numbered(number, 0)
    return MOST if numbered(number, start + MOST) >= start + MOST else None
