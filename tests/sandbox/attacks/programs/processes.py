"""Starting processes. Each child that a failed defence lets through does nothing, and ends after 20 seconds."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.sandbox.attacks.kit import REFUSED, World, call, check, gets, libc

SECONDS = 20


def idle(pid: int) -> int:
    """What parent and child do after a fork: the one returns, the other waits and ends."""
    if pid == 0:
        libc.alarm(SECONDS)
        time.sleep(SECONDS)
        os._exit(0)
    return pid


def clone(flags: int) -> int:
    """``clone3``, which no filter can look into."""
    arguments = (ctypes.c_uint64 * 11)(flags, 0, 0, 0, signal.SIGCHLD)
    return call("clone3", arguments, 88)


FORKS: dict[str, Callable[[], int]] = {
    "python": os.fork,
    "C": lambda: check(libc.fork()),
    "clone": lambda: call("clone", int(signal.SIGCHLD), 0, 0, 0, 0),
    "clone without a signal": lambda: call("clone", 0, 0, 0, 0, 0),
    "clone with its parent's parent": lambda: call("clone", int(signal.SIGCHLD) | 0x8000, 0, 0, 0, 0),
    "clone untraced": lambda: call("clone", int(signal.SIGCHLD) | 0x00800000, 0, 0, 0, 0),
    "clone3": lambda: clone(0),
    "clone3 into a cgroup": lambda: clone(0x200000000),
    "pseudo-terminal": lambda: os.forkpty()[0],
}
NAMES = {name: name for name in FORKS}


@gets(*REFUSED, cases=NAMES)
def fork(world: World, name: str) -> int:
    return idle(FORKS[name]())


@gets(*REFUSED)
def daemon(world: World) -> int:
    """Forked twice, in a session of its own, with every descriptor closed."""
    pid = check(libc.fork())
    if pid == 0:
        os.setsid()
        if libc.fork() > 0:
            os._exit(0)
        os.closerange(0, 256)
        idle(0)
    return pid


@gets(*REFUSED)
def fork_storm(world: World) -> int:
    for _ in range(20):
        idle(check(libc.fork()))
    return 20


@gets("RuntimeError", "thread_limit", *REFUSED)
def thread_storm(world: World) -> int:
    threading.stack_size(64 << 10)
    stop = threading.Event()
    threads = [threading.Thread(target=stop.wait, daemon=True) for _ in range(300)]
    try:
        for thread in threads:
            thread.start()
        stop.wait(1)
    finally:
        stop.set()
    return len(threads)


def arguments(*words: bytes) -> "ctypes.Array[ctypes.c_char_p]":
    """``argv`` or ``envp``."""
    return (ctypes.c_char_p * (len(words) + 1))(*words, None)


def spawned() -> int:
    pid = ctypes.c_int(0)
    error = libc.posix_spawn(ctypes.byref(pid), b"/bin/true", None, None, arguments(b"true"), arguments())
    return pid.value if error == 0 else check(-1, error)


def piped() -> int:
    return libc.popen(b"true", b"r") or check(-1)


STARTS: dict[str, Callable[[], Any]] = {
    "exec": lambda: os.execv("/bin/true", ["true"]),
    "exec of C": lambda: check(libc.execv(b"/bin/true", arguments(b"true"))),
    "exec of this program": lambda: check(libc.execv(os.fsencode(sys.executable), arguments(b"python", b"-V"))),
    "exec by descriptor": lambda: call(
        "execveat", os.open(sys.executable, os.O_PATH), b"", arguments(b"x", b"-V"), arguments(), 0x1000
    ),
    "exec by the loader": lambda: check(libc.execv(b"/lib64/ld-linux-x86-64.so.2", arguments(b"ld", b"/bin/true"))),
    "posix_spawn": lambda: os.posix_spawn("/bin/true", ["true"], {}),
    "posix_spawn of C": spawned,
    "subprocess": lambda: subprocess.run(["/bin/true"], check=False).returncode,
    "popen": piped,
    "exec of a script": lambda: os.execv(_script(), ["script"]),
}


def _script() -> str:
    Path("script").write_text("#!/bin/sh\ntrue\n")
    Path("script").chmod(0o755)
    return "./script"


@gets(*REFUSED, "ENOMEM", cases={name: name for name in STARTS})
def start(world: World, name: str) -> str:
    return f"started: {STARTS[name]()}"


@gets(*REFUSED, "32512", "65280")
def shell(world: World) -> str:
    """``system`` of C answers with the status of a shell, or of none."""
    return str(check(libc.system(b"exit 3")))


@gets("nothing", "RuntimeError")
def thread_that_forks(world: World) -> int | None:
    """A new thread is held by the same rules."""
    found: list[int] = []
    thread = threading.Thread(target=lambda: found.append(libc.fork()))
    thread.start()
    thread.join()
    if found[0] == 0:
        idle(0)
    return found[0] if found[0] > 0 else None
