"""``grs report``."""

from pathlib import Path

from grs_agents.cli.looking import library_of
from grs_agents.files import write_text
from grs_agents.run import read_record
from grs_agents.trace import read_events


def write_report(folder: Path, out: Path | None) -> Path:
    """Write a run as one HTML page, ``report.html`` in its folder if nothing else is named.

    Raises:
        InputError: the folder holds no run, or the page cannot be written.
    """
    from grs_agents.views.report import report
    from grs_agents.views.report_pictures import Sources

    record = read_record(folder)
    sources = Sources(folder, library_of(folder), str(record.config.get("robot", "ur5e")))
    page = report(record.model_dump(mode="json"), read_events(folder / "events.jsonl"), sources)
    return write_text(out or folder / "report.html", page)


def report_run(folder: Path, out: Path | None) -> None:
    """Write the page and say where it is."""
    path = write_report(folder, out)
    print(f"{path}: {path.stat().st_size / 2**20:.1f} MiB")
