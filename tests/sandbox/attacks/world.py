"""Everything outside the sandbox that an attack might touch, and whether it did."""

import ctypes
import os
import secrets
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import grs_agents

PUBLIC_FOLDERS = (
    "/tmp",
    "/var/tmp",
    "/dev/shm",
    "/run",
    "/etc",
    "/usr/lib",
    "/",
    "/sys/fs",
    "/dev",
    "/var/lib",
    "/opt",
)
PACKAGE = Path(grs_agents.__file__).parent
REPOSITORY = PACKAGE.parent
TRUSTED_FOLDERS = [str(path) for path in (PACKAGE, PACKAGE / "sandbox", REPOSITORY, REPOSITORY / "tools", sys.prefix)]
FILES = ("work/program.py", "home/.bashrc", "runs/trace.rrd", "work/.env", "home/.ssh/id_rsa")
MODEL = '<mujoco><worldbody><body name="{}"/></worldbody></mujoco>'
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


class Canaries:
    """Files with a secret, servers that nobody should reach, and a process that should live.

    Args:
        folder: an empty folder for the files.
        temporary: where the host makes temporary folders.
        beside_the_tools: a folder of content that the user has named, with files that are no content.

    Attributes:
        world: what an attack is told: where all that is.
        secret: what stands in every file that must not be read.
    """

    def __init__(self, folder: Path, temporary: Path, beside_the_tools: Path) -> None:
        self.folder, self._temporary = folder, temporary
        self.secret = f"secret-{secrets.token_hex(16)}"
        self.token = f"grs{secrets.token_hex(5)}"
        self._in_repository = REPOSITORY / f".env.{self.token}"
        self._files = [folder / name for name in FILES]
        self._files += [self._in_repository, beside_the_tools / ".env"]
        self._cwd = Path.cwd()
        self._place()
        self._sockets = Path(tempfile.mkdtemp(prefix="servers-", dir=folder.parent))
        self._servers = {
            "tcp": socket.create_server(("127.0.0.1", 0)),
            "udp": _bound(socket.AF_INET, socket.SOCK_DGRAM, ("127.0.0.1", 0)),
            "unix": _bound(socket.AF_UNIX, socket.SOCK_STREAM, str(self._sockets / "unix")),
            "datagram": _bound(socket.AF_UNIX, socket.SOCK_DGRAM, str(self._sockets / "datagram")),
            "abstract": _bound(socket.AF_UNIX, socket.SOCK_STREAM, f"\0{self.token}"),
        }
        self._start()
        self.world: dict[str, Any] = {
            "token": self.token,
            "key": secrets.randbelow(2**30) + 1,
            "folder": str(folder),
            "home": str(folder / "home"),
            "work": str(folder / "work"),
            "files": [str(path) for path in self._files],
            "key_file": str(folder / "home/.ssh/id_rsa"),
            "model": str(folder / "model.xml"),
            "mesh": str(folder / "mesh.obj"),
            "repository": str(REPOSITORY),
            "folders": [*PUBLIC_FOLDERS, str(Path.home()), str(folder), str(folder / "home"), *TRUSTED_FOLDERS],
            "host": os.getpid(),
            "group": os.getpgrp(),
            "secret_address": id(self.secret),
            "tcp": self._servers["tcp"].getsockname()[1],
            "udp": self._servers["udp"].getsockname()[1],
            "unix": str(self._sockets / "unix"),
            "datagram": str(self._sockets / "datagram"),
            "abstract": self.token,
        }
        self.world["victim"] = self._victim.pid
        self._folders = _entries(temporary)

    def harm(self) -> list[str]:
        """What is not as it was, in words; whatever an attack left is removed."""
        found = [f"{name} changed" for name in self._changed()]
        found += [f"the {name} server was reached" for name, server in self._servers.items() if _reached(server)]
        found += [f"{path} was left" for path in self._left_files()]
        found += [f"process {pid} outlived its call" for pid in self._left_processes()]
        found += [f"a {name} was left" for name in self._left_objects()]
        facts = self._process_facts()
        if facts != self._facts:
            found.append(f"a process is not as it was: {set(facts) ^ set(self._facts)}")
            self._end()
            self._start()
        return found

    def close(self) -> None:
        """Remove the canaries."""
        self._end()
        for server in self._servers.values():
            server.close()
        for path in self._files:
            path.unlink(missing_ok=True)
        shutil.rmtree(self._sockets)
        os.chdir(self._cwd)

    def _place(self) -> None:
        """Write the files with the secret anew."""
        for path in (*_entries(self.folder), *self._files):
            remove(path)
        for path in self._files:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.secret)
        (self.folder / "model.xml").write_text(MODEL.format(self.secret))
        (self.folder / "mesh.obj").write_text(MESH)
        self._temporary.chmod(0o755)
        os.chdir(self.folder / "work")  # where a host might well be started, its ``.env`` beside it
        self._before = self._snapshot()

    def _start(self) -> None:
        """Start the process that should live; the secret is in its environment and on its command line."""
        command = [sys.executable, "-c", f"import sys; held = {self.secret!r}; sys.stdin.read()"]
        environment = {"GRS_CANARY_KEY": self.secret}
        self._victim = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, start_new_session=True)
        self._facts = self._process_facts()

    def _end(self) -> None:
        self._victim.kill()
        self._victim.communicate()

    def _snapshot(self) -> dict[str, tuple[object, ...]]:
        paths = {self.folder, *self.folder.rglob("*"), *self._files}
        found: dict[str, tuple[object, ...]] = {str(self._temporary): (self._temporary.stat().st_mode,)}
        for path in paths:
            if not (path.exists() or path.is_symlink()):
                continue
            facts = path.lstat()
            content = path.read_bytes() if path.is_file() else b""
            names = os.listxattr(path, follow_symlinks=False)
            found[str(path)] = (facts.st_mode, facts.st_uid, facts.st_nlink, facts.st_mtime_ns, content, *names)
        return found

    def _changed(self) -> list[str]:
        after = self._snapshot()
        changed = [name for name in {**self._before, **after} if self._before.get(name) != after.get(name)]
        if changed:  # each harm is told once, by the test that did it
            self._place()
        return changed

    def _left_files(self) -> Iterator[Path]:
        for folder in self.world["folders"]:
            for path in [Path(folder, name) for name in _names(folder) if self.token in name]:
                if path != self._in_repository:
                    yield path
                    remove(path)
        for path in set(_entries(self._temporary)) - set(self._folders):
            if not path.name.startswith("grs-scratch-") or path.is_symlink():
                yield path
                remove(path)

    def _left_processes(self) -> list[int]:
        """Processes that carry an attack's name and do not end, though told to."""
        found: list[int] = []
        for pid in [int(name) for name in _names("/proc") if name.isdigit()]:
            with suppress(OSError):
                if Path(f"/proc/{pid}/comm").read_bytes().strip() == self.token[:15].encode() and not ends(pid):
                    found.append(pid)
                    os.kill(pid, signal.SIGKILL)
        return found

    def _process_facts(self) -> tuple[str, ...]:
        pid = self._victim.pid
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        facts = [{"S": "lives", "R": "lives", "D": "lives"}.get(state, state)]
        for who in (pid, 0):
            facts.append(f"{who}: nice {os.getpriority(os.PRIO_PROCESS, who)} {os.sched_getscheduler(who)}")
            facts.append(f"{who}: processors {sorted(os.sched_getaffinity(who))} group {os.getpgid(who)}")
            folder = Path("/proc", str(who or "self"))
            facts.extend(f"{who}: {line}" for line in (folder / "limits").read_text().splitlines())
            facts.append(f"{who}: memory score {(folder / 'oom_score_adj').read_text()}")
        return (*facts, str(Path.cwd()))

    def _left_objects(self) -> list[str]:
        libc, key = ctypes.CDLL(None), self.world["key"]
        shared, semaphore, queue = libc.shmget(key, 0, 0), libc.semget(key, 0, 0), libc.msgget(key, 0)
        found: list[str] = []
        if shared != -1:
            found.append("shared memory segment")
            libc.shmctl(shared, 0, None)
        if semaphore != -1:
            found.append("semaphore")
            libc.semctl(semaphore, 0, 0)
        if queue != -1:
            found.append("message queue")
            libc.msgctl(queue, 0, None)
        if ctypes.CDLL(None).mq_unlink(f"/{self.token}".encode()) == 0:
            found.append("POSIX message queue")
        return found


def remove(path: Path) -> None:
    """Delete a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def ends(pid: int, seconds: float = 10.0) -> bool:
    """Whether the process is gone, or goes within ``seconds``."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], seconds)[0])
    finally:
        os.close(descriptor)


def _entries(folder: Path) -> list[Path]:
    return [folder / name for name in _names(folder)]


def _names(folder: Path | str) -> list[str]:
    """What a folder holds, as text alone: some hold thousands, and they are looked at for every attack."""
    with suppress(OSError), os.scandir(folder) as entries:
        return [entry.name for entry in entries]
    return []


def _bound(family: int, kind: int, address: Any) -> socket.socket:
    server = socket.socket(family, kind)
    server.bind(address)
    if kind == socket.SOCK_STREAM:
        server.listen()
    return server


def _reached(server: socket.socket) -> bool:
    reached = False
    while select.select([server], [], [], 0)[0]:
        reached = True
        if server.type == socket.SOCK_STREAM:
            server.accept()[0].close()
        else:
            server.recv(1 << 16)
    return reached
