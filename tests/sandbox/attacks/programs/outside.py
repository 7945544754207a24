"""Writing outside of the scratch folder."""

import ctypes
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.sandbox.attacks.kit import HIDDEN, World, call, check, gets, libc, succeeded

AT_FDCWD = -100


@gets("nothing")
def new_files(world: World) -> list[str] | None:
    """In the home folder, /tmp, /dev/shm, the package itself, the libraries of Python, ..."""
    return succeeded({folder: Path(folder, world["token"]).touch for folder in world["folders"]})


@gets("nothing")
def new_folders_links_and_fifos(world: World) -> list[str] | None:
    attempts: dict[str, Callable[[], Any]] = {}
    Path("mine").touch()
    for folder in world["folders"]:
        path = Path(folder, world["token"])
        attempts |= {
            f"mkdir {path}": path.mkdir,
            f"symlink {path}": lambda path=path: path.symlink_to("/"),
            f"link {path}": lambda path=path: os.link("mine", path),
            f"rename {path}": lambda path=path: Path("mine").replace(path),
            f"fifo {path}": lambda path=path: os.mkfifo(path),
            f"device {path}": lambda path=path: os.mknod(path, 0o060600, os.makedev(254, 0)),
            f"socket {path}": lambda path=path: socket.socket(socket.AF_UNIX).bind(str(path)),
        }
    return succeeded(attempts)


def change(path: str) -> dict[str, Callable[[], Any]]:
    """Every way to change a file."""
    new, there = f"{path}.new", os.fsencode(path)
    return {
        "append": lambda: os.write(os.open(path, os.O_WRONLY | os.O_APPEND), b"x"),
        "read and write": lambda: os.open(path, os.O_RDWR),
        "truncate": lambda: os.truncate(path, 0),
        "truncate on opening": lambda: os.open(path, os.O_WRONLY | os.O_TRUNC),
        "delete": lambda: Path(path).unlink(),
        "rename": lambda: Path(path).replace(new),
        "take": lambda: Path(path).replace("taken"),
        "replace": lambda: Path("mine").replace(path),
        "exchange": lambda: check(libc.renameat2(AT_FDCWD, b"mine", AT_FDCWD, there, 2)),
        "permissions": lambda: Path(path).chmod(0o666),
        "permissions of an open file": lambda: os.fchmod(os.open(path, os.O_RDONLY), 0o666),
        "permissions by its number": lambda: Path(f"/proc/self/fd/{os.open(path, os.O_PATH)}").chmod(0o666),
        "permissions, newest call": lambda: check(libc.syscall(452, AT_FDCWD, there, 0o666, 0)),
        "owner": lambda: os.chown(path, 12345, 12345),
        "owner of a link": lambda: os.lchown(path, 12345, 12345),
        "times": lambda: os.utime(path, (1, 1)),
        "attribute": lambda: os.setxattr(path, "user.canary", b"x"),
        "attribute, newest call": lambda: check(libc.syscall(463, AT_FDCWD, there, 0, b"user.canary", b"x", 1, 0)),
        "hard link": lambda: os.link(path, "linked"),
        "hard link by its number": lambda: check(libc.linkat(os.open(path, os.O_PATH), b"", AT_FDCWD, b"held", 0x1000)),
        "lock": lambda: os.lockf(os.open(path, os.O_RDWR), os.F_TLOCK, 0),
    }


CHANGES = {name: name for name in change("")}


@gets("nothing", cases=CHANGES)
def changed_files(world: World, name: str) -> list[str] | None:
    attempts: dict[str, Callable[[], Any]] = {}
    for path in world["files"]:
        Path("mine").write_text("x")
        attempts[path] = change(path)[name]
    return succeeded(attempts)


@gets("nothing", cases={name: name for name in ("permissions", "owner", "times", "attribute")})
def changed_folders(world: World, name: str) -> list[str] | None:
    return succeeded({world["home"]: change(world["home"])[name]})


@gets("nothing")
def roundabout_ways(world: World) -> list[str] | None:
    """The same file by other names."""
    target, token = world["home"], world["token"]
    Path("link").symlink_to(target)
    up = "../" * 40
    folder: list[int] = []

    def by_descriptor() -> int:
        folder.append(os.open(target, os.O_PATH | os.O_DIRECTORY))
        return os.open(token, os.O_CREAT | os.O_WRONLY, dir_fd=folder[-1])

    def by_change_of_folder() -> None:
        os.chdir(target)
        Path(token).touch()

    return succeeded(
        {
            "link": lambda: Path("link", token).touch(),
            "dots": lambda: Path(f"{up}{target[1:]}/{token}").touch(),
            "root of the process": lambda: Path(f"/proc/self/root{target}/{token}").touch(),
            "task": lambda: Path(f"/proc/thread-self/root{target}/{token}").touch(),
            "root of the parent": lambda: Path(f"/proc/{os.getppid()}/root{target}/{token}").touch(),
            "root of the first process": lambda: Path(f"/proc/1/root{target}/{token}").touch(),
            "folder of the host": lambda: Path(f"/proc/{world['host']}/cwd/{token}").touch(),
            "descriptor": by_descriptor,
            "changed folder": by_change_of_folder,
            "nameless file": lambda: os.open(target, os.O_TMPFILE | os.O_WRONLY),
            "openat2": lambda: call("openat2", AT_FDCWD, f"{target}/{token}".encode(), _how(os.O_CREAT | 1), 24),
        }
    )


def _how(flags: int) -> "ctypes.Array[ctypes.c_uint64]":
    return (ctypes.c_uint64 * 3)(flags, 0o600, 0)


_KNOBS = """
/proc/sys/kernel/core_pattern /proc/sys/kernel/hostname /proc/sys/vm/drop_caches /proc/sysrq-trigger
/proc/sys/kernel/ns_last_pid /proc/self/uid_map /proc/self/attr/current /proc/self/loginuid
/proc/self/timerslack_ns /sys/kernel/uevent_helper /sys/power/state /sys/kernel/mm/ksm/run
/sys/fs/cgroup/cgroup.procs /dev/mem /dev/kmsg /dev/vda /dev/sda /dev/fuse /dev/kvm /dev/net/tun /dev/ptmx
/dev/tty /dev/console /dev/userfaultfd /dev/loop-control /dev/vhost-vsock
"""
KNOBS = _KNOBS.split()


@gets("nothing")
def knobs_of_the_kernel(world: World) -> list[str] | None:
    """Opened for writing, never written to."""
    return succeeded(
        {path: lambda path=path: os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY) for path in KNOBS}
    )


@gets("nothing")
def folders_left_open(world: World) -> list[str] | None:
    """Descriptors that were inherited lead out of any root."""
    attempts = {}
    for descriptor in range(1024):
        name = f"{'../' * 40}{world['home'][1:]}/{world['token']}"
        attempts[str(descriptor)] = lambda at=descriptor, name=name: os.open(name, os.O_CREAT | os.O_WRONLY, dir_fd=at)
    return succeeded(attempts)


@gets(*HIDDEN, "ESTALE", "EOPNOTSUPP", "EINVAL", "EBADF")
def files_by_handle(world: World) -> int:
    """An inode's number opens it past every path."""
    handle = (ctypes.c_uint32 * 34)(128)
    mount = ctypes.c_int(0)
    call("name_to_handle_at", AT_FDCWD, world["files"][0].encode(), handle, ctypes.byref(mount), 0)
    root = os.open("/", os.O_RDONLY)
    return call("open_by_handle_at", root, handle, os.O_RDWR)
