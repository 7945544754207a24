"""``grs report``."""

from collections.abc import Callable
from pathlib import Path

from grs_agents.cli.show import library_of
from grs_agents.files import STANDARD_OUTPUT, write_document
from grs_agents.run import read_record
from grs_agents.terminal import say
from grs_agents.trace import read_events


def write_report(folder: Path, out: Path | None, show: Callable[[str], None]) -> Path:
    """Write a run as one HTML page, ``report.html`` in its folder if nothing else is named.

    Args:
        folder: the run.
        out: the page.
        show: is told what comes next.

    Raises:
        InputError: the folder holds no run, or the page cannot be written.
    """
    from grs_agents.views.report import report
    from grs_agents.views.report_pictures import Sources

    record = read_record(folder)
    sources = Sources(folder, library_of(folder), str(record.config.get("robot", "ur5e")), show)
    page = report(record.model_dump(mode="json"), read_events(folder / "events.jsonl"), sources)
    return write_document(out or folder / "report.html", page.encode("utf-8", "replace"))


def report_run(folder: Path, out: Path | None) -> None:
    """Write the page and say where it is; standard output is the page's alone."""
    from grs_agents.views import working

    with working("writing the report") as show:
        path = write_report(folder, out, show)
    if path != STANDARD_OUTPUT:
        say(f"{path}: {path.stat().st_size / 2**20:.1f} MiB")
