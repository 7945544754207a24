"""Worker processes, one core and a scene each, with a progress bar."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from grs_agents.runs.experiment_run import run_jobs_in_threads, show_progress

EVALS = Path(__file__).parent.parent
_ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_Job = TypeVar("_Job")
_Outcome = TypeVar("_Outcome")


def run_worker(module: str, arguments: Sequence[str], order: str = "") -> subprocess.CompletedProcess[str]:
    """Run a module of `evals.benchmark` in a process that imports from this checkout first.

    Args:
        module: its name.
        arguments: of its command line.
        order: its standard input.
    """
    paths = [str(EVALS.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, "-P", "-m", f"evals.benchmark.{module}", *arguments],
        input=order,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **_ONE_CORE, "PYTHONPATH": os.pathsep.join(paths)},
    )


def error_of(done: subprocess.CompletedProcess[str]) -> str:
    """The last line of a failed worker's output; empty for a successful worker."""
    lines = done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"]
    return lines[-1] if done.returncode else ""


def run_jobs(
    title: str, jobs: Sequence[_Job], work: Callable[[_Job], _Outcome], workers: int, name: Callable[[_Job], str]
) -> list[_Outcome]:
    """Do ``work`` for each job, ``workers`` at a time, behind a bar; an interrupt waits only for those that have begun.

    Returns:
        The outcomes in the order of ``jobs``.
    """
    outcomes: dict[int, _Outcome] = {}
    with show_progress(title, len(jobs)) as advance:

        def keep(number: int, outcome: _Outcome) -> None:
            outcomes[number] = outcome
            advance(name(jobs[number]), "")

        run_jobs_in_threads(range(len(jobs)), lambda number: work(jobs[number]), keep, workers)
    return [outcomes[number] for number in range(len(jobs))]
