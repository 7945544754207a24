"""Filling the disk, and leaving what is hard to clear away; at most 200 MiB and 5,000 files."""

import contextlib
import mmap
import os
import socket
import time
from pathlib import Path

from tests.sandbox.attacks.kit import HIDDEN, REFUSED, World, check, gets, libc

MIB = 1 << 20
FULL = ("ENOSPC", "EFBIG", "EDQUOT", "scratch_limit")
MOST = 200


@gets(*FULL)
def one_large_file(world: World) -> int:
    with Path("large").open("wb") as file:
        for _ in range(MOST):
            file.write(bytes(MIB))
    return MOST


@gets(*FULL)
def many_files(world: World) -> int:
    for number in range(MOST):
        Path(f"file{number}").write_bytes(bytes(MIB))
    return MOST


@gets(*FULL, "EMFILE")
def deleted_files_held_open(world: World) -> int:
    """They are in no folder that anybody could count."""
    held = []
    for _ in range(MOST // 2):
        held.append(os.open("file", os.O_CREAT | os.O_RDWR))
        Path("file").unlink()
        os.write(held[-1], bytes(2 * MIB))
    return len(held)


@gets(*FULL, *REFUSED, "EMFILE", "EOPNOTSUPP")
def nameless_files(world: World) -> int:
    """They never were in any folder."""
    held = []
    for _ in range(MOST // 2):
        held.append(os.open(".", os.O_TMPFILE | os.O_RDWR))
        os.write(held[-1], bytes(2 * MIB))
    return len(held)


@gets(*FULL, "EOPNOTSUPP", *REFUSED)
def reserved_blocks(world: World) -> int:
    with Path("reserved").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, MOST * MIB)
    return Path("reserved").stat().st_blocks * 512


@gets(*FULL)
def a_sparse_file(world: World) -> int:
    with Path("sparse").open("wb") as file:
        file.truncate(1 << 40)
    return Path("sparse").stat().st_size


@gets(*FULL, "ENOMEM", "crashed by SIGBUS")
def a_mapped_file(world: World) -> int:
    with Path("mapped").open("w+b") as file:
        file.truncate(MOST * MIB)
        with mmap.mmap(file.fileno(), 0) as mapped:
            for page in range(0, MOST * MIB, 4096):
                mapped[page] = 1
    return MOST


@gets("nothing", *FULL)
def empty_files(world: World) -> None:
    """None is larger than its name: what counts is that they go."""
    for number in range(5000):
        os.close(os.open(f"empty{number}", os.O_CREAT))


@gets("nothing", *FULL, cases={"too deep for a path": 1100, "slow to clear away": 3000})
def deep_folders(world: World, depth: int) -> None:
    for _ in range(depth):
        Path("d").mkdir()
        os.chdir("d")


@gets("nothing", *FULL)
def folders_that_move(world: World) -> None:
    """Whoever walks through them while they move may find itself above them: ``..`` is somewhere else by now."""
    Path("a/b/leaf").mkdir(parents=True)
    for number in range(4000):  # which take a while to count
        Path(f"a/b/leaf/{number}").touch()
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        Path("a/b/leaf").rename("leaf")
        time.sleep(0.01)
        Path("leaf").rename("a/b/leaf")
        time.sleep(0.01)


@gets("nothing", *FULL)
def folders_without_permissions(world: World) -> None:
    Path("a/b/c").mkdir(parents=True)
    Path("a/b/c/file").write_text("x")
    for name in ("a/b/c", "a/b", "a", "."):
        with contextlib.suppress(PermissionError):
            Path(name).chmod(0)


@gets("nothing", *FULL)
def links_out(world: World) -> None:
    """Clearing away must not follow them."""
    for number, name in enumerate([*world["files"], *world["folders"], "loop"]):
        Path(f"link{number}").symlink_to(name)
    Path("loop").symlink_to("loop")


@gets("nothing", *FULL)
def fifos_and_sockets(world: World) -> None:
    for attempt in (
        lambda: os.mkfifo("fifo"),
        lambda: os.mkfifo("fifo without permissions", 0),
        lambda: socket.socket(socket.AF_UNIX).bind("socket"),
        lambda: os.mknod("device", 0o020666, os.makedev(1, 9)),
    ):
        with contextlib.suppress(OSError):
            attempt()


@gets("nothing", *FULL)
def odd_names(world: World) -> None:
    for name in (b"\xff\xfe", b"a\nb", b"-rf", b" ", b"x" * 255, "ü\u202e".encode()):
        os.close(os.open(name, os.O_CREAT))


@gets(*HIDDEN, "EOPNOTSUPP", "ENOTTY")
def a_file_that_nobody_may_delete(world: World) -> int:
    """``chattr +i``."""
    with Path("stone").open("w") as file:
        got = check(libc.ioctl(file.fileno(), 0x40086602, b"\x10\0\0\0\0\0\0\0"))
        return got + libc.ioctl(file.fileno(), 0x40086602, bytes(8))


@gets(*HIDDEN, "EINVAL", "ENOTSUP")
def an_attribute_that_stays(world: World) -> bool:
    Path("file").touch()
    os.setxattr("file", "trusted.canary", b"x")
    return True


@gets("nothing")
def takes_its_scratch_folder_away(world: World) -> list[str] | None:
    """And puts a link in its place, so that clearing away would empty a folder of the host."""
    scratch = Path.cwd()
    moved = scratch.with_name(world["token"])
    with contextlib.suppress(OSError):
        scratch.rename(moved)
        scratch.symlink_to(world["folder"])
        return [str(moved)]
    with contextlib.suppress(OSError):
        scratch.rmdir()
        scratch.symlink_to(world["folder"])
        return [str(scratch)]
    return None
