"""Keep results of experiments in ``evals/results``, and write their tables into docs/evals.md.

Usage: ``python scripts/figures.py [NAME=FILE ...]``. FILE is the ``result.json`` of an experiment or the
``results.json`` of a batch. The table between ``<!-- NAME: begin -->`` and ``<!-- NAME: end -->`` has the rows of
``NAME.json`` and of every ``NAME.*.json``, with the command, version and date of each. Without arguments the page is
written anew.
"""

import json
import re
import statistics
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

from grs_agents.base.files import write_json, write_text
from grs_agents.runs.experiments import markdown_table

ROOT = Path(__file__).parent.parent
PAGE, RESULTS = ROOT / "docs" / "evals.md", ROOT / "evals" / "results"
_UNTOLD = {"--out": 1, "--workers": 1, "--json": 0}
"""Options that change no figure, with the number of their values."""
_FEW = 8  # scenes that a command names one by one
_PART = re.compile(r"<!-- (?P<name>\w+): begin -->\n.*?<!-- (?P=name): end -->", re.DOTALL)


def keep(name: str, file: Path) -> None:
    """Copy the parts of a result that the page needs into ``evals/results``."""
    result = json.loads(file.read_text(encoding="utf-8"))
    if "experiment" in result:
        command = _tell_command(("eval", result["experiment"]), result["arguments"])
        kept = {key: result[key] for key in ("date", "grs-agents", "seeds", "table")}
    else:
        batch = json.loads((file.parent / "batch.json").read_text(encoding="utf-8"))
        command = _tell_command(("batch",), list(dict.fromkeys(row["scene"] for row in result["rows"])))
        day = date.fromtimestamp(file.stat().st_mtime).isoformat()
        rows = result["rows"]
        scenes = len({row["scene"] for row in rows})
        verdicts = [row for row in rows if row["status"] in ("accepted", "rejected")]
        fixed = sum(row["code_fixes"] + row["test_fixes"] + row["task_fixes"] > 0 for row in verdicts)
        kept = {
            "date": day,
            "grs-agents": batch["grs-agents"],
            "seeds": {"seed": batch["seed"]},
            "table": [
                {
                    "scenes": scenes,
                    "runs": len(rows),
                    "verdicts": len(verdicts),
                    "accepted": result["summary"]["accepted"],
                    "needed a fix": fixed,
                    "different tasks": result["summary"]["different_tasks"],
                    "families": len(result["summary"]["families"]),
                    "mean distance": result["summary"]["mean_distance"],
                    "median seconds": round(statistics.median(row["seconds"] for row in verdicts), 1),
                }
            ],
        }
    write_json(RESULTS / f"{name}.json", {"command": command, **kept})


def _tell_command(words: Sequence[str], arguments: Sequence[str]) -> str:
    """A command line without options that change no figure; files by name only, and scenes of a common folder by it."""
    parts: list[str] = []
    skip = 0
    for word in arguments:
        skip = _UNTOLD[word] + 1 if word in _UNTOLD else skip
        if not skip:
            path = Path(word)
            parts.append(word if not path.is_absolute() else path.parent.name if len(arguments) > _FEW else path.name)
        skip = max(0, skip - 1)
    return " ".join(("grs", *words, *dict.fromkeys(parts)))


def render_page(page: str) -> str:
    """The page with each table that there is a result for."""
    return _PART.sub(lambda part: _render(part["name"]) or part[0], page)


def _render(name: str) -> str:
    files = [file for file in sorted(RESULTS.glob(f"{name}*.json")) if file.stem.split(".")[0] == name]
    results = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    if not results:
        return ""
    rows = [row for result in results for row in result["table"]]
    came = "\n".join(f"- {_tell_origin(result)}" for result in results)
    return f"<!-- {name}: begin -->\n\n{markdown_table(list(rows[0]), rows)}\n{came}\n\n<!-- {name}: end -->"


def _tell_origin(result: dict[str, Any]) -> str:
    seeds = ", ".join(f"{name} {value}" for name, value in result["seeds"].items())
    parts = [f"`{result['command']}`", f"version {result['grs-agents']}", result["date"], seeds, result.get("note", "")]
    return ", ".join(filter(None, parts))


def main(arguments: Sequence[str]) -> None:
    """Keep the results that are named, and write the page."""
    for argument in arguments:
        name, _, file = argument.partition("=")
        keep(name, Path(file))
    write_text(PAGE, render_page(PAGE.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main(sys.argv[1:])
