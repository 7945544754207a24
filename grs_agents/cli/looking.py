"""``grs show`` and ``grs replay``."""

import json
from pathlib import Path

from rich.console import Console

from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.run import read_record
from grs_agents.trace import read_events


def show_run(folder: Path, as_json: bool) -> None:
    """Print the steps of a run.

    Raises:
        InputError: the folder holds no run.
    """
    from grs_agents.views import steps_table, summary_table

    record = read_record(folder)
    events = read_events(folder / "events.jsonl")
    if as_json:
        print(json.dumps([event.model_dump(mode="json") for event in events], indent=2))
        return
    console = Console()
    console.print(steps_table(events))
    console.print(summary_table(record.model_dump(mode="json")))


def replay_run(folder: Path, web: bool) -> int:
    """Open the viewer on a run's recording, made again from the events if it is missing.

    Returns:
        The viewer's exit status.

    Raises:
        InputError: the folder holds no run.
    """
    from grs_agents.views import open_viewer
    from grs_agents.views.rerun_view import rebuild

    read_record(folder)
    recording = folder / "trace.rrd"
    if not recording.is_file():
        proxies = folder / "assets"
        rebuild(folder, Library().overlay(proxies) if proxies.is_dir() else Library())
    if not recording.is_file():
        raise InputError(f"{recording} cannot be made: the run logged no event", "run the scene again")
    return open_viewer(recording, web=web).wait()
