"""``grs verify``."""

from pathlib import Path

from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.config.schema import Config
from grs_agents.base.terminal import print_json
from grs_agents.runs.verification import Verification, verify_run
from grs_agents.views.terminal import show_activity_status


def verify_run_folder(folder: Path, local: Config, as_json: bool) -> int:
    """Verify a run and print what differs; 0 if nothing does, 1 if something does."""
    with show_activity_status("verifying the run") as show:
        found = verify_run(folder, local, show)
    if as_json:
        value = {
            "status": "holds" if found.holds else "differs",
            "verdict": found.verdict,
            "recomputed": found.recomputed,
            "differences": found.differences,
            "note": found.note,
        }
        print_json(value)
    else:
        _print_verification(found)
    return 0 if found.holds else 1


def _print_verification(found: Verification) -> None:
    console = terminal.make_console()
    for difference in found.differences:
        console.print(Text(difference))
    if found.note:
        console.print(Text(found.note))
    console.print(Text(f"{found.folder}: {_summarise_verification(found)}", style="bold"))


def _summarise_verification(found: Verification) -> str:
    if not found.holds:
        count = len(found.differences)
        what = "the audit comes out otherwise" if found.recomputed else "it is not the run that ended here"
        return f"does not hold, {count} difference{'s' * (count > 1)}: {what}"
    how = "its audit comes out the same" if found.recomputed else "it came to no audit"
    return f"holds ({found.verdict}): every file is as the run left it, and {how}"
