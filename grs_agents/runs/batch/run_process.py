"""A run in a separate process, so that a crash or a hang costs that run alone."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import IO, Final

from grs_agents.base.content import list_content_options
from grs_agents.base.errors import InputError
from grs_agents.base.files import open_new_text
from grs_agents.perception.reading.known_scene import is_known_scene
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.runs.record import RunRecord, read_record

ENDED: Final = ("accepted", "rejected", "waiting")
"""Statuses that are not run again: verdicts, and runs that wait for a person."""
_GRACE: Final = 2.5
"""Seconds for an interrupted run to write its record before it is killed. Most supervisors kill a process five
seconds after SIGTERM."""


@dataclass(frozen=True)
class RunJob:
    """A run to make."""

    name: str  # of its folder, and in tables
    scene: str  # as `grs run` takes it
    seed: int
    folder: Path
    options: tuple[str, ...] = ()  # further options of `grs run`
    known: Path | None = None  # folder of a run of the same photo; its comprehended scene, if any, is reused
    # options that point a cluster's worker to the content of the submitting process
    content: tuple[str, ...] = field(default_factory=lambda: tuple(list_content_options()))

    @property
    def source(self) -> str:
        """Argument of `grs run`."""
        return self.scene if self.known is None or not is_known_scene(self.known) else str(self.known)


@dataclass(frozen=True)
class RunEnd:
    """The end of a run's process."""

    job: RunJob
    exit_status: int | None  # of the command; `None` if it had to be killed
    error: str = ""  # last line of stderr, if there is no verdict


Watcher = Callable[[RunEnd], None]


class RunProcess:
    """A run in a process that the warm parent forked."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel, self._waiting = channel, Lock()
        self._status: int | None = None

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit status, negative for a signal. Raises TimeoutError: it runs still after ``timeout`` s."""
        if not self._waiting.acquire(timeout=-1 if timeout is None else timeout):  # another thread waits
            raise TimeoutError
        try:
            if self._status is None:
                self._channel.settimeout(None if timeout is None else max(timeout, 1e-3))  # 0 means something else
                try:
                    told = self._channel.recv(16)
                except ConnectionError:
                    told = b""
                self._channel.close()
                self._status = int(told or -signal.SIGKILL)  # none: the warm parent was killed, its runs with it
            return self._status
        finally:
            self._waiting.release()

    def send_signal(self, number: signal.Signals) -> None:
        """Have the warm parent send a signal, unless the run has ended."""
        with suppress(OSError):
            self._channel.send(bytes([number]))


class RunProcesses:
    """The running processes, ended together: forks of a warm parent, which is started for the first."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[RunProcess | subprocess.Popen[bytes]] = set()
        self._ended = False
        self._parent: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    @contextmanager
    def start(self, command: Sequence[str], errors: IO[str]) -> Generator[RunProcess | subprocess.Popen[bytes]]:
        """Run ``grs`` with the arguments ``command`` within the context. Raises InterruptedError: after ``end``."""
        with self._lock:
            if self._ended:
                raise InterruptedError("the batch ends")
            if sys.platform == "linux":
                process = self._fork_from_warm_parent(command, errors)
            else:  # where libraries do not stand a fork
                process = _start_python("grs_agents", *command, errors=errors)
            self._running.add(process)
        try:
            yield process
        finally:
            with self._lock:
                self._running.discard(process)

    def _fork_from_warm_parent(self, command: Sequence[str], errors: IO[str]) -> RunProcess:
        ours, theirs = socket.socketpair()
        with theirs:
            request, lent = [json.dumps(list(command)).encode()], [theirs.fileno(), errors.fileno()]
            if self._parent is not None:
                try:
                    socket.send_fds(self._parent[1], request, lent)
                except BrokenPipeError:  # it was killed
                    self._close_warm_parent()
            if self._parent is None:
                control, served = socket.socketpair(type=socket.SOCK_SEQPACKET)
                with served:
                    warm = _start_python("grs_agents.runs.batch.warm_parent", errors=errors, stdin=served.fileno())
                self._parent = warm, control
                socket.send_fds(control, request, lent)
        return RunProcess(ours)

    def _close_warm_parent(self) -> None:
        if self._parent is not None:
            self._parent[1].close()
            self._parent[0].wait()
            self._parent = None

    def close(self) -> None:
        """End the warm parent, when no run is left."""
        with self._lock:
            self._close_warm_parent()

    def end(self) -> None:
        """Ask all processes to end, kill those still running, and let no new process start."""
        with self._lock:
            self._ended = True
            running = list(self._running)
        try:
            for process in running:
                process.send_signal(signal.SIGTERM)
            latest = time.monotonic() + _GRACE
            for process in running:
                process.wait(max(0.0, latest - time.monotonic()))
        except (TimeoutError, subprocess.TimeoutExpired):
            pass
        finally:  # also after a second interruption
            for process in running:
                process.send_signal(signal.SIGKILL)
            self.close()


def _start_python(
    module: str, *arguments: str, errors: IO[str], stdin: int = subprocess.DEVNULL
) -> subprocess.Popen[bytes]:
    """Start a module in a process group of its own: Ctrl-C reaches the driver alone, which asks each run once."""
    command = [sys.executable, "-m", module, *arguments]
    return subprocess.Popen(command, stdin=stdin, stdout=subprocess.DEVNULL, stderr=errors, process_group=0)


def run_job(job: RunJob, timeout: float, processes: RunProcesses) -> RunEnd:
    """Make or resume a run in a separate process, and wait for its end."""
    earlier = read_run_record_or_none(job.folder)
    if earlier is not None and earlier.status in ENDED:
        return RunEnd(job, earlier.exit_status)
    begin = ("--resume",) if earlier is not None else ("--seed", str(job.seed))
    source = job.source
    if earlier is not None and resolve_scene_path(Path(job.scene)) == Path(earlier.source):
        source = job.scene  # begun before there was a scene to reuse
    command = [*job.content, "run", source, "--out", str(job.folder), "--json", *begin, *job.options]
    # The run gets the user's whole environment, from the warm parent: a model may need its key.
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    if job.folder.is_symlink():  # the batch's folder may be foreign
        return RunEnd(job, 2, f"{job.folder} is a link; remove it, or name another folder with --out")
    log = job.folder.with_name(f"{job.name}.log")  # a pipe would break if this process ended before the run
    with open_new_text(log) as errors, processes.start(command, errors) as process:
        try:
            status = process.wait(timeout)
        except (TimeoutError, subprocess.TimeoutExpired):
            process.send_signal(signal.SIGKILL)
            process.wait()
            return RunEnd(job, None, f"killed after {timeout:.0f} s")
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines() if status > 1 else []
    return RunEnd(job, status, lines[-1].removeprefix("grs: ") if lines else "")


def read_run_record_or_none(folder: Path) -> RunRecord | None:
    """The record of the run in ``folder``; None without a valid record."""
    try:
        return read_record(folder)
    except InputError:
        return None
