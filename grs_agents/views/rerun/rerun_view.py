"""The rerun recording of a run: a subscriber of the event log that writes ``trace.rrd`` as the run goes on."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from grs_agents.base.trace.events import Event
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.views.rerun.event_view import EventView
from grs_agents.views.rerun.recording import Recording
from grs_agents.views.rerun.state_machine_view import MachineView
from grs_agents.views.rerun.viewer_layout import build_comparison_blueprint

TRACE = "trace.rrd"


class RerunView:
    """Shows every event in rerun; each is in the file a moment later, so that a killed run leaves its film.

    A run that is resumed goes on in ``trace.1.rrd`` and so on, with the same recording id, so that all parts
    open as one recording; :meth:`finish` leaves a single ``trace.rrd``.
    """

    def __init__(self, run_folder: Path, library: Library, live: str | None = None) -> None:
        self._folder, self._library = run_folder, library
        log = run_folder / "events.jsonl"
        earlier = read_events(log) if log.exists() else []
        self._resumed = bool(earlier) and (run_folder / TRACE).exists()
        self._live = live is not None
        file = _next_rrd_file_path(run_folder) if self._resumed else run_folder / TRACE
        self._view = EventView(run_folder, library, file, live)
        show = self._view.track_event_without_logging if self._resumed else self._view.write_event
        with ExitStack() as opened:
            opened.callback(self._view.close)
            for event in earlier:
                show(event)
            opened.pop_all()

    def __call__(self, event: Event) -> None:
        """Show one event and put it into the file."""
        self._view.write_event(event)

    def finish(self) -> None:
        """Close the file. After a resumption ``trace.rrd`` is written anew from the events, of all parts; so it is if a
        viewer was shown the run, since one that is closed half-way takes the file down with it."""
        self._view.close()
        if self._resumed or self._live:
            rebuild_rrd_file(self._folder, self._library)


def _next_rrd_file_path(folder: Path) -> Path:
    """The first free name among trace.1.rrd, trace.2.rrd, ..."""
    number = 1
    while (folder / f"trace.{number}.rrd").exists():
        number += 1
    return folder / f"trace.{number}.rrd"


def record_comparison(runs: Sequence[tuple[Path, Library]], path: Path) -> Path:
    """Write runs into one recording, below ``/run_1``, ``/run_2``, ..., on timelines that begin together."""
    logs = [read_events(folder / "events.jsonl") for folder, _ in runs]
    names = _number_duplicate_names([folder.resolve().name for folder, _ in runs])
    columns: list[tuple[str, str, tuple[str, ...]]] = []
    for number, (name, events) in enumerate(zip(names, logs, strict=True), start=1):
        machine = MachineView()
        for event in events:
            machine.track_event(event)
        columns.append((name, f"/run_{number}", machine.nodes))
    recording = Recording(path, " and ".join(names), build_comparison_blueprint(columns))
    with closing(recording):
        for (folder, library), (_, prefix, _), events in zip(runs, columns, logs, strict=True):
            view = EventView(folder, library, recording.with_path_prefix(prefix))
            for event in events:
                view.write_event(event)
    return path


def _number_duplicate_names(names: list[str]) -> list[str]:
    """``names``, numbered where two are the same."""
    same = len(set(names)) < len(names)
    return [f"{number} {name}" if same else name for number, name in enumerate(names, start=1)]


def record_run(run_folder: Path, library: Library, path: Path) -> bool:
    """Write the recording of a run, as far as it has come, into the file ``path``; False if it has no event yet."""
    events = read_events(run_folder / "events.jsonl")
    with closing(EventView(run_folder, library, path)) as view:
        for event in events:
            view.write_event(event)
    return bool(events)


def rebuild_rrd_file(run_folder: Path, library: Library) -> Path:
    """Make ``trace.rrd`` anew from ``events.jsonl`` and the files it names; parts of resumed runs go away."""
    temporary = run_folder / f".{TRACE}"
    if record_run(run_folder, library, temporary):
        temporary.replace(run_folder / TRACE)
        for part in run_folder.glob("trace.[0-9]*.rrd"):
            part.unlink()
    return run_folder / TRACE
