"""One run in a process of its own, so that a crash or a hang costs it alone."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from grs_agents import content
from grs_agents.errors import InputError
from grs_agents.perception import is_known_scene, resolve_scene_path
from grs_agents.runs import RunRecord, read_record

ENDED: Final = ("accepted", "rejected", "waiting")
"""What is not run again: verdicts, and what waits for a person."""


@dataclass(frozen=True)
class RunJob:
    """One run to make."""

    name: str  # its folder's name, and how tables call it
    scene: str  # as `grs run` takes it
    seed: int
    folder: Path
    options: tuple[str, ...] = ()  # further options of `grs run`
    known: Path | None = None  # the folder of a run of the same photo, whose scene is taken over where it has one

    @property
    def source(self) -> str:
        """What `grs run` is given."""
        return self.scene if self.known is None or not is_known_scene(self.known) else str(self.known)


@dataclass(frozen=True)
class RunEnd:
    """How the process of a run ended."""

    job: RunJob
    exit_status: int | None  # of the command; `None` if it had to be killed
    error: str = ""  # the last line it wrote on stderr, if it came to no verdict


Watcher = Callable[[RunEnd], None]


def run_job(job: RunJob, timeout: float) -> RunEnd:
    """Make or resume one run in a process of its own, and wait for its end."""
    earlier = read_run_record_or_none(job.folder)
    if earlier is not None and earlier.status in ENDED:
        return RunEnd(job, earlier.exit_status)
    overlays = [part for root in reversed(content.content_search_roots()[:-1]) for part in ("--content", str(root))]
    begin = ("--resume",) if earlier is not None else ("--seed", str(job.seed))
    source = job.source
    if earlier is not None and resolve_scene_path(Path(job.scene)) == Path(earlier.source):
        source = job.scene  # begun before there was a run of the same photo to take the scene over from
    command = [*overlays, "run", source, "--out", str(job.folder), "--json", *begin, *job.options]
    # The environment is the user's own: a model may need its key.
    starter = [sys.executable, "-m", "grs_agents.batch.child", str(os.getpid())]
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    log = job.folder.with_name(f"{job.name}.log")  # no pipe: it would break with us, while the run still speaks
    with log.open("w", encoding="utf-8") as errors:
        try:
            done = subprocess.run(
                [*starter, *command], stdout=subprocess.DEVNULL, stderr=errors, timeout=timeout, check=False
            )
        except subprocess.TimeoutExpired:
            return RunEnd(job, None, f"killed after {timeout:.0f} s")
    return RunEnd(job, done.returncode, _read_last_line(log) if done.returncode > 1 else "")


def _read_last_line(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1].removeprefix("grs: ") if lines else ""


def read_run_record_or_none(folder: Path) -> RunRecord | None:
    """The record of the run in ``folder``, if there is a sound one."""
    try:
        return read_record(folder)
    except InputError:
        return None
