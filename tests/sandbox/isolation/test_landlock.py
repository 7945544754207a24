"""Landlock alone, without the other layers: what each right covers."""

import ctypes
import errno
import fcntl
import os
import signal
import socket
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation import kernel, landlock
from tests.needs import needs
from tests.sandbox.confined import USERS, Got, become, forked, without_new_privileges

pytestmark = needs("landlock")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A folder that may be read."""
    folder = tmp_path / "library"
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "text").write_text("known")
    return folder


@pytest.fixture
def scratch(tmp_path: Path) -> Path:
    """A folder that may be written."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    return folder


Restricted = Callable[[Callable[[], object]], Got]


@pytest.fixture
def restricted(library: Path, scratch: Path) -> Restricted:
    def run(check: Callable[[], object]) -> Got:
        return without_new_privileges(
            lambda: landlock.restrict_file_access(landlock.create_ruleset([library], [scratch])), check
        )

    return run


def test_what_is_readable_is_read(restricted: Restricted, library: Path) -> None:
    got = restricted(lambda: [(library / "inner" / "text").read_text(), names(library)])
    assert got.value == ["known", ["inner"]]


@pytest.mark.parametrize("path", ["/etc/passwd", "/proc/self/environ", "/root", "/"])
def test_all_else_is_not(restricted: Restricted, path: str) -> None:
    def read() -> object:
        return names(Path(path)) if Path(path).is_dir() else Path(path).read_bytes().hex()

    assert restricted(read).error == "PermissionError"


def test_a_neighbour_is_not_read_by_way_of_a_link(restricted: Restricted, tmp_path: Path, scratch: Path) -> None:
    (tmp_path / "secret").write_text("x")

    def read() -> str:
        (scratch / "link").symlink_to(tmp_path / "secret")
        return (scratch / "link").read_text()

    assert restricted(read).error == "PermissionError"


def test_what_is_readable_is_not_changed(restricted: Restricted, library: Path, scratch: Path) -> None:
    text = library / "inner" / "text"
    (scratch / "own").write_text("x")
    attempts: list[Callable[[], object]] = [
        lambda: text.write_text("forged"),
        text.unlink,
        lambda: text.rename(library / "moved"),
        lambda: text.rename(scratch / "moved"),
        lambda: (scratch / "hard").hardlink_to(text),
        lambda: (library / "link").symlink_to(text),
        (library / "folder").mkdir,
        lambda: (library / "inner").rename(scratch / "inner"),
        lambda: (scratch / "own").rename(text),
    ]
    for attempt in attempts:
        assert restricted(attempt).errno in {errno.EACCES, errno.EXDEV}
    assert text.read_text() == "known"


@needs("landlock 3")
def test_what_is_readable_is_not_truncated(restricted: Restricted, library: Path) -> None:
    text = library / "inner" / "text"
    assert restricted(lambda: os.truncate(text, 0)).error == "PermissionError"
    assert restricted(lambda: os.open(text, os.O_RDONLY | os.O_TRUNC)).error == "PermissionError"
    assert text.read_text() == "known"


@needs("landlock 3")
def test_the_scratch_folder_is_free(restricted: Restricted, scratch: Path) -> None:
    def use() -> list[str]:
        (scratch / "a" / "b").mkdir(parents=True)
        (scratch / "a" / "file").write_text("abc")
        os.truncate(scratch / "a" / "file", 2)
        (scratch / "a" / "file").rename(scratch / "a" / "b" / "moved")
        (scratch / "link").symlink_to("a")
        (scratch / "hard").hardlink_to(scratch / "a" / "b" / "moved")
        left = [(scratch / "link" / "b" / "moved").read_text(), *names(scratch)]
        (scratch / "hard").unlink()
        (scratch / "a" / "b" / "moved").unlink()
        (scratch / "a" / "b").rmdir()
        return left

    assert restricted(use).value == ["ab", "a", "hard", "link"]


def test_no_device_pipe_or_socket_is_made(restricted: Restricted, scratch: Path) -> None:
    attempts: list[Callable[[], object]] = [
        lambda: os.mkfifo(scratch / "node"),
        lambda: socket.socket(socket.AF_UNIX).bind(str(scratch / "node")),
    ]
    if os.geteuid() == 0:
        attempts += [
            lambda: os.mknod(scratch / "node", 0o600 | 0o020000, os.makedev(1, 3)),
            lambda: os.mknod(scratch / "node", 0o600 | 0o060000, os.makedev(7, 0)),
        ]
    for attempt in attempts:
        assert restricted(attempt).error == "PermissionError"
    assert not list(scratch.iterdir())


def test_nothing_is_executed_from_anywhere(restricted: Restricted, library: Path, scratch: Path) -> None:
    for folder in (library, scratch):
        program = folder / "program"
        program.write_text("#!/bin/sh\n")
        program.chmod(0o755)
        assert restricted(lambda program=program: os.execv(program, ["program"])).error == "PermissionError"
    assert restricted(lambda: os.execv(sys.executable, ["python", "-c", ""])).error == "PermissionError"


def test_a_file_is_named_on_its_own(library: Path, tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("before")
    other = library / "other"
    other.write_text("x")

    def check() -> list[object]:
        own.write_text("after")
        denied: list[object] = []
        for attempt in (other.read_text, own.unlink, lambda: names(tmp_path)):
            try:
                attempt()
            except PermissionError as error:
                denied.append(error.errno)
        return [(library / "inner" / "text").read_text(), own.read_text(), *denied]

    got = without_new_privileges(
        lambda: landlock.restrict_file_access(landlock.create_ruleset([library / "inner" / "text"], [own])), check
    )
    assert got.value == ["known", "after", errno.EACCES, errno.EACCES, errno.EACCES]


def test_an_absent_path_is_left_out(library: Path) -> None:
    paths = [library / "none", library / "inner" / "text" / "none", library]
    got = without_new_privileges(
        lambda: landlock.restrict_file_access(landlock.create_ruleset(paths, [library / "none"])),
        (library / "inner" / "text").read_text,
    )
    assert got.value == "known"


def test_it_needs_a_process_that_gains_no_privileges() -> None:
    def confine() -> None:
        become(USERS[-1])
        landlock.restrict_file_access(landlock.create_ruleset([], []))

    assert forked(confine).errno == errno.EPERM


@needs("landlock 4")
@pytest.mark.parametrize("port", [0, 65535])
def test_no_connection_leaves_and_no_port_is_taken(restricted: Restricted, port: int) -> None:
    assert restricted(lambda: socket.socket().bind(("127.0.0.1", port))).error == "PermissionError"
    assert restricted(lambda: socket.socket().connect(("127.0.0.1", port))).error == "PermissionError"


@needs("landlock 5", "/dev/ptmx")
def test_a_device_takes_no_control(library: Path) -> None:
    terminals = Path("/dev/ptmx")

    def number_of_terminal() -> int:
        descriptor = os.open(terminals, os.O_RDWR | os.O_NOCTTY)
        return struct.unpack("I", fcntl.ioctl(descriptor, 0x80045430, bytes(4)))[0]

    got = without_new_privileges(
        lambda: landlock.restrict_file_access(landlock.create_ruleset([library], [terminals])), number_of_terminal
    )
    assert got.error == "PermissionError"


@needs("landlock 6")
def test_no_signal_reaches_a_process_outside(restricted: Restricted) -> None:
    assert restricted(lambda: os.kill(os.getppid(), 0)).error == "PermissionError"
    assert restricted(lambda: os.kill(os.getpid(), signal.SIGTERM)).signal == signal.SIGTERM


@needs("landlock 6")
def test_no_abstract_socket_is_reached(restricted: Restricted) -> None:
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("")  # the kernel chooses an abstract name
        listening.listen()
        name = listening.getsockname()
        assert restricted(lambda: socket.socket(socket.AF_UNIX).connect(name)).error == "PermissionError"


@pytest.mark.parametrize(
    ("version", "rights"), [(1, 0x1FFF), (2, 0x3FFF), (3, 0x7FFF), (4, 0x7FFF), (5, 0xFFFF), (7, 0xFFFF)]
)
def test_an_older_version_is_asked_for_its_rights_alone(
    version: int, rights: int, monkeypatch: pytest.MonkeyPatch, library: Path
) -> None:
    monkeypatch.setattr(landlock, "abi_version", lambda: version)
    asked: list[int] = []
    call = kernel.make_system_call

    def spy(name: str, *arguments: int) -> int:
        if name == "landlock_create_ruleset":
            asked.append(int.from_bytes(ctypes.string_at(arguments[0], 8), "little"))
        return call(name, *arguments)

    def confine_and_tell() -> list[int]:
        kernel.make_system_call = spy
        landlock.restrict_file_access(landlock.create_ruleset([library], []))
        return asked

    got = without_new_privileges(lambda: None, confine_and_tell)
    assert got.value == [rights]
