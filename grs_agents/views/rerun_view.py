"""The rerun recording of a run: a subscriber of the event log that writes ``trace.rrd`` as the run goes on."""

from pathlib import Path

from grs_agents.library import Library
from grs_agents.trace import Event, read_events
from grs_agents.views.event_view import EventView

TRACE = "trace.rrd"


class RerunView:
    """Shows every event in rerun; each is in the file before the next one happens.

    A run that is resumed goes on in ``trace.1.rrd`` and so on, with the same recording id, so that all parts
    open as one recording; :meth:`finish` leaves a single ``trace.rrd``.

    Args:
        run_folder: the run; its ``events.jsonl`` may hold earlier events.
        library: where the meshes of assets lie, the run's own proxies laid over.
    """

    def __init__(self, run_folder: Path, library: Library) -> None:
        self._folder, self._library = run_folder, library
        log = run_folder / "events.jsonl"
        earlier = read_events(log) if log.exists() else []
        self._resumed = bool(earlier) and (run_folder / TRACE).exists()
        self._view = EventView(run_folder, library, _next_part(run_folder) if self._resumed else run_folder / TRACE)
        for event in earlier:
            if self._resumed:
                self._view.skip(event)
            else:
                self._view.write(event)

    def __call__(self, event: Event) -> None:
        """Show one event and put it into the file."""
        self._view.write(event)

    def finish(self) -> None:
        """Close the file; after a resumption write one ``trace.rrd`` of all parts, from the events."""
        self._view.close()
        if self._resumed:
            rebuild(self._folder, self._library)


def _next_part(folder: Path) -> Path:
    """The first free name among trace.1.rrd, trace.2.rrd, ..."""
    number = 1
    while (folder / f"trace.{number}.rrd").exists():
        number += 1
    return folder / f"trace.{number}.rrd"


def rebuild(run_folder: Path, library: Library) -> Path:
    """Make ``trace.rrd`` anew from ``events.jsonl`` and the files it names; parts of resumed runs go away.

    Raises:
        InputError: the folder has no readable event log.
    """
    events = read_events(run_folder / "events.jsonl")
    temporary = run_folder / f".{TRACE}"
    view = EventView(run_folder, library, temporary)
    for event in events:
        view.write(event, flush=False)
    view.close()
    if events:
        temporary.replace(run_folder / TRACE)
        for part in run_folder.glob("trace.[0-9]*.rrd"):
            part.unlink()
    return run_folder / TRACE
