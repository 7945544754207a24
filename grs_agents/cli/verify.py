"""``grs verify``."""

from pathlib import Path

from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.config.schema import Config
from grs_agents.base.terminal import print_json
from grs_agents.runs.verification import verify_run
from grs_agents.views.terminal import show_activity_status


def verify_run_folder(folder: Path, local: Config, as_json: bool) -> int:
    """Verify a run and print its differences. Returns: exit status, 0 without differences, else 1."""
    with show_activity_status("verifying the run") as show:
        result = verify_run(folder, local, show)
    if as_json:
        value = {
            "status": "holds" if result.holds else "differs",
            "verdict": result.verdict,
            "recomputed": result.recomputed,
            "differences": result.differences,
            "note": result.note,
        }
        print_json(value)
        return 0 if result.holds else 1
    console = terminal.make_console()
    for line in (*result.differences, result.note):
        if line:
            console.print(Text(line))
    if result.holds:
        audit = "its audit comes out the same" if result.recomputed else "it came to no audit"
        summary = f"holds ({result.verdict}): every file is as the run left it, and {audit}"
    else:
        count = len(result.differences)
        cause = "the audit comes out otherwise" if result.recomputed else "it is not the run that ended here"
        summary = f"does not hold, {count} difference{'s' * (count > 1)}: {cause}"
    console.print(Text(f"{result.folder}: {summary}", style="bold"))
    return 0 if result.holds else 1
