"""What experiments with many runs share: options, progress, and figures in files, on the terminal, in Markdown."""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from rich.table import Table
from rich.text import Text

from grs_agents import content, terminal
from grs_agents.config import load_config
from grs_agents.errors import InputError
from grs_agents.files import write_json, write_text
from grs_agents.foreign import read_json
from grs_agents.runs.batch import Done, Job, run_jobs
from grs_agents.terminal import VisibleParser, print_escaped, print_json
from grs_agents.version import __version__

CHECKOUT_ONLY = ("confidence", "correspondence", "perception", "retrieval_scale", "routing", "shapes", "twin")
"""Experiments that measure GRS itself on scenes made for it: neither they nor what they share are in a wheel."""


def load_experiment(name: str) -> ModuleType:
    """The experiment of that name. In a checkout its root comes first among the places to import from."""
    root = content.content_root()
    if name in CHECKOUT_ONLY and name not in content.content_names("evals"):
        remedy = "pip install -e '.[eval]' in a checkout of GRS, and run it there"
        raise InputError(f"experiment {name!r} needs a checkout: an installed GRS does not hold it", remedy)
    if root == content.package_root().parent and str(root) not in sys.path[:1]:
        sys.path.insert(0, str(root))
    return content.load_module("evals", name)


def figures_of_run(done: Done) -> dict[str, Any]:
    """The figures of one run."""
    record = done.record
    counts = record.counts if record else {}
    return {
        "name": done.job.name,
        "status": record.status if record else ("killed" if done.exit_status is None else "failed"),
        "task": _read_task_name(done),
        "candidates": counts.get("candidates", 0),
        "objects": counts.get("objects", 0),
        "matched": counts.get("objects_matched", 0),
        "reachable": counts.get("objects_reachable", 0),
        "used": counts.get("assets_used", 0),
        "moved": counts.get("objects_moved", 0),
        "fixes": sum(counts.get(name, 0) for name in ("code_fixes", "test_fixes", "task_fixes")),
        "seconds": record.seconds.get("total", 0.0) if record else 0.0,
        "reason": "" if record and record.status == "accepted" else (record.reason if record else done.error),
    }


def terminal_table(title: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> Table:
    """The rows for a terminal."""
    result = Table(*columns, title=title)
    for row in rows:
        result.add_row(*(Text(str(row[column])) for column in columns))
    return result


def markdown_table(columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    """The rows as a Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(str(row[column]).replace("|", "/") for column in columns) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _read_task_name(done: Done) -> str:
    file = done.job.out / "task.json"
    return str(read_json(file, "run again").get("task-name", "")) if file.is_file() else ""


def make_experiment_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """The options every experiment of many runs has."""
    parser = VisibleParser(prog=f"grs eval {name}", description=description)
    parser.add_argument("--out", type=Path, default=Path(f"runs/eval-{name}"), help="where runs and figures go")
    parser.add_argument("--workers", type=positive_int, default=2, help="runs at a time")
    parser.add_argument("--timeout", type=float, default=300, help="seconds before a run is killed")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    return parser


def positive_int(text: str) -> int:
    """A whole number from 1, for ``argparse``."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} is less than 1")
    return number


def settings_as_arguments(options: argparse.Namespace) -> tuple[str, ...]:
    """The ``--set`` options as ``grs run`` takes them."""
    return tuple(part for setting in options.settings for part in ("--set", setting))


def run_experiment(jobs: Sequence[Job], options: argparse.Namespace) -> int:
    """Make the runs, write ``figures.json`` and ``figures.md`` to ``options.out``, and print them.

    An interrupted experiment goes on when it is started again with the same ``--out``.

    Returns:
        0 if every run came to a verdict, 1 if not.
    """
    claim_experiment_folder(options.out, jobs, options.settings)

    def tell(done: Done) -> None:
        print_escaped(f"{done.job.name}: {done.record.status if done.record else done.error}", error=True)

    finished = run_jobs(jobs, options.workers, options.timeout, tell)
    rows = [figures_of_run(done) for done in finished]
    summary = summarise_runs(finished, rows)
    write_json(options.out / "figures.json", {"summary": summary, "rows": rows})
    write_text(options.out / "figures.md", markdown_table(list(rows[0]), rows))
    if options.json:
        print_json({"summary": summary, "rows": rows})
    else:
        terminal.make_console().print(
            terminal_table(f"accepted {summary['accepted']} of {summary['runs']}", list(rows[0]), rows)
        )
    return 0 if summary["verdicts"] == len(rows) else 1


def claim_experiment_folder(out: Path, jobs: Sequence[Job], settings: Sequence[str]) -> None:
    """Write into ``experiment.json`` what the figures depend on, so that runs of two experiments are never mixed."""
    file = out / "experiment.json"
    ours: dict[str, Any] = {
        "scenes": sorted({str(job.scene.resolve()) for job in jobs}),
        "config": load_config(None, settings).config.model_dump(mode="json"),
        "content": [str(root) for root in content.content_search_roots()[:-1]],
        "grs-agents": __version__,
    }
    try:
        earlier = json.loads(file.read_text(encoding="utf-8")) if file.exists() else ours
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {file}: {error}", "name another folder with --out") from error
    if earlier != ours:
        differ = [key for key in ours if not isinstance(earlier, dict) or earlier.get(key) != ours[key]]
        raise InputError(f"{out} holds an experiment with other {', '.join(differ)}", "name another --out")
    write_json(file, ours)


def summarise_runs(finished: Sequence[Done], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Verdicts, acceptance, the share of runs that needed a fix, task names and seconds over all runs."""
    accepted = sum(done.record is not None and done.record.status == "accepted" for done in finished)
    seconds = sorted(float(row["seconds"]) for row in rows)
    return {
        "runs": len(rows),
        "verdicts": sum(done.exit_status in (0, 1) for done in finished),
        "accepted": accepted,
        "share_accepted": round(accepted / len(rows), 3),
        "share_with_fixes": round(sum(bool(row["fixes"]) for row in rows) / len(rows), 3),
        "median_seconds": seconds[len(seconds) // 2],
        "tasks": dict(Counter(str(row["task"]) for row in rows)),
    }
