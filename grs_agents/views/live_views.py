"""What people watch while a run goes on: progress in the terminal, the recording, a viewer, OpenTelemetry spans."""

import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from grs_agents.base.trace.events import Event, NodeEnded, RunEnded
from grs_agents.base.trace.log import EventLog
from grs_agents.library.library import Library
from grs_agents.views.rerun.viewer import open_live_viewer
from grs_agents.views.terminal import Progress


@contextmanager
def attach_live_views(
    folder: Path, log: EventLog, view: bool = False, otel: bool = False, progress: bool = True
) -> Generator[None]:
    """Let recording and progress follow the log, with a viewer's window and OpenTelemetry spans if asked for.
    All are closed whatever happens."""
    from grs_agents.views.rerun.rerun_view import RerunView
    from grs_agents.views.telemetry import SpanView, make_otlp_provider

    live = open_live_viewer()[1] if view else None
    spans = SpanView(make_otlp_provider()) if otel else None
    recording = RerunView(folder, Library(), live)
    with ExitStack() as shown:
        if progress:
            log.subscribe(_suppress_error_events(shown.enter_context(Progress())))
        log.subscribe(recording)
        if spans:
            log.subscribe(spans)
        try:
            yield
        finally:
            recording.finish()
            if spans:
                spans.finish()


def _suppress_error_events(progress: Callable[[Event], None]) -> Callable[[Event], None]:
    """An error is said once, at the end: a live table marks the node that failed, lines leave it out."""
    live = sys.stderr.isatty()

    def show_unless_error(event: Event) -> None:
        if isinstance(event, RunEnded) and event.status == "failed":
            return
        if isinstance(event, NodeEnded) and event.error:
            if not live:
                return
            event = event.model_copy(update={"error": "see below"})
        progress(event)

    return show_unless_error
