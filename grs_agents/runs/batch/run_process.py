"""A run in a separate process, so that a crash or a hang costs that run alone."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
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


class RunProcesses:
    """The running processes, ended together."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._ended = False

    @contextmanager
    def start(self, command: Sequence[str], errors: IO[str]) -> Generator[subprocess.Popen[bytes]]:
        """Run a process within the context. Raises InterruptedError: after ``end``."""
        with self._lock:
            if self._ended:
                raise InterruptedError("the batch ends")
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                process_group=0,  # Ctrl-C reaches the driver alone, which asks each run once
            )
            self._running.add(process)
        try:
            yield process
        finally:
            with self._lock:
                self._running.discard(process)

    def end(self) -> None:
        """Ask all processes to end, kill those still running, and let no new process start."""
        with self._lock:
            self._ended = True
            running = list(self._running)
        try:
            for process in running:
                process.terminate()
            latest = time.monotonic() + _GRACE
            for process in running:
                process.wait(max(0.0, latest - time.monotonic()))
        except subprocess.TimeoutExpired:
            pass
        finally:  # also after a second interruption
            for process in running:
                process.kill()


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
    # The run gets the user's whole environment: a model may need its key.
    starter = [sys.executable, "-m", "grs_agents.runs.batch.child", str(os.getpid())]
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    if job.folder.is_symlink():  # the batch's folder may be foreign
        return RunEnd(job, 2, f"{job.folder} is a link; remove it, or name another folder with --out")
    log = job.folder.with_name(f"{job.name}.log")  # a pipe would break if this process ended before the run
    with open_new_text(log) as errors, processes.start([*starter, *command], errors) as process:
        try:
            status = process.wait(timeout)
        except subprocess.TimeoutExpired:
            process.kill()
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
