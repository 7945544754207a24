"""Many runs, each in a process of its own, so that a crash or a hang costs one of them."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from grs_agents import content
from grs_agents.errors import InputError
from grs_agents.runs.record import RunRecord, read_record


@dataclass(frozen=True)
class Job:
    """One run to make."""

    name: str  # how it is called in tables
    scene: Path
    out: Path
    options: tuple[str, ...] = ()  # further options of `grs run`


@dataclass(frozen=True)
class Done:
    """A finished job."""

    job: Job
    exit_status: int | None  # of the command; `None` if it had to be killed
    record: RunRecord | None  # its `run.json`, if it wrote one
    error: str  # the last line it wrote on stderr, if it failed


def run_jobs(
    jobs: Sequence[Job], workers: int, timeout: float, done: Callable[[Done], None] = lambda _: None
) -> list[Done]:
    """Run ``jobs``, ``workers`` at a time, killing any that takes more than ``timeout`` seconds.

    A job whose folder already holds an ended run is not run again, so that an interrupted batch goes on.
    """
    results: dict[str, Done] = {}
    with ThreadPoolExecutor(max_workers=workers) as pool:
        for future in as_completed([pool.submit(_run_job, job, timeout) for job in jobs]):
            result = future.result()
            results[result.job.name] = result
            done(result)
    return [results[job.name] for job in jobs]


def _run_job(job: Job, timeout: float) -> Done:
    earlier = _read_record_if_any(job.out)
    if earlier is not None and earlier.status in ("accepted", "rejected"):
        return Done(job, earlier.exit_status, earlier, "")
    resume = ("--resume",) if earlier is not None else job.options
    overlays = [part for root in reversed(content.content_search_roots()[:-1]) for part in ("--content", str(root))]
    arguments = ["run", str(job.scene), "--out", str(job.out), "--json", *resume]
    command = [sys.executable, "-m", "grs_agents", *overlays, *arguments]
    try:
        # The environment is the user's own: a model may need its key.
        finished = subprocess.run(
            command, capture_output=True, text=True, timeout=timeout, check=False, env=dict(os.environ)
        )
    except subprocess.TimeoutExpired:
        return Done(job, None, _read_record_if_any(job.out), f"killed after {timeout:.0f} s")
    lines = finished.stderr.strip().splitlines() or [""]
    return Done(job, finished.returncode, _read_record_if_any(job.out), lines[-1] if finished.returncode > 1 else "")


def _read_record_if_any(folder: Path) -> RunRecord | None:
    try:
        return read_record(folder)
    except InputError:
        return None
