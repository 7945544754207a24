"""What experiments that make many runs share: options, progress, figures in files and on the terminal."""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from grs_agents.files import write_json, write_text
from grs_agents.run.batch import Done, Job, run_jobs
from grs_agents.run.tables import COLUMNS, markdown, row, table


def experiment_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """The options every experiment of many runs has."""
    parser = argparse.ArgumentParser(prog=f"grs eval {name}", description=description)
    parser.add_argument("--out", type=Path, default=Path(f"runs/eval-{name}"), help="where runs and figures go")
    parser.add_argument("--workers", type=int, default=2, help="runs at a time")
    parser.add_argument("--timeout", type=float, default=300, help="seconds before a run is killed")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    return parser


def job_settings(options: argparse.Namespace) -> tuple[str, ...]:
    """The ``--set`` options as ``grs run`` takes them."""
    return tuple(part for setting in options.settings for part in ("--set", setting))


def run_experiment(jobs: Sequence[Job], options: argparse.Namespace) -> int:
    """Make the runs, write ``figures.json`` and ``figures.md`` to ``options.out``, and print them.

    An interrupted experiment goes on when it is started again with the same ``--out``.

    Returns:
        0 if every run came to a verdict, 1 if not.
    """

    def tell(done: Done) -> None:
        print(f"{done.job.name}: {done.record.status if done.record else done.error}", file=sys.stderr)

    finished = run_jobs(jobs, options.workers, options.timeout, tell)
    rows = [row(done) for done in finished]
    summary = summarise(finished, rows)
    write_json(options.out / "figures.json", {"summary": summary, "rows": rows})
    write_text(options.out / "figures.md", markdown(COLUMNS, rows))
    if options.json:
        print(json.dumps({"summary": summary, "rows": rows}, indent=2))
    else:
        Console().print(table(f"accepted {summary['accepted']} of {summary['runs']}", COLUMNS, rows))
    return 0 if summary["verdicts"] == len(rows) else 1


def summarise(finished: Sequence[Done], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Verdicts, acceptance, the share of runs that needed a fix, task names and seconds over all runs."""
    accepted = sum(done.record is not None and done.record.status == "accepted" for done in finished)
    seconds = sorted(float(one["seconds"]) for one in rows)
    return {
        "runs": len(rows),
        "verdicts": sum(done.exit_status in (0, 1) for done in finished),
        "accepted": accepted,
        "share_accepted": round(accepted / len(rows), 3),
        "share_with_fixes": round(sum(bool(one["fixes"]) for one in rows) / len(rows), 3),
        "median_seconds": seconds[len(seconds) // 2],
        "tasks": dict(Counter(str(one["task"]) for one in rows)),
    }
