"""Live views of a run: progress in the terminal, the rerun recording, its viewer, OpenTelemetry spans."""

import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from grs_agents.base.trace.events import Event, NodeEnded, RunEnded
from grs_agents.base.trace.log import EventLog
from grs_agents.library.library import Library
from grs_agents.views.rerun.viewer import open_live_viewer
from grs_agents.views.terminal import ProgressView


@contextmanager
def attach_live_views(
    folder: Path, log: EventLog, view: bool = False, otel: bool = False, progress: bool = True
) -> Generator[None]:
    """Subscribe recording and progress to the log, on request also a viewer's window and OpenTelemetry spans.
    All are closed when the context ends, also after an error."""
    from grs_agents.views.rerun.rerun_view import RerunView
    from grs_agents.views.telemetry import SpanView, make_otlp_provider

    live = open_live_viewer()[1] if view else None
    spans = SpanView(make_otlp_provider()) if otel else None
    recording = RerunView(folder, Library(), live)
    with ExitStack() as shown:
        if progress:
            log.subscribe(_suppress_error_events(shown.enter_context(ProgressView())))
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
    """Leave errors out of the progress, since the command reports them at its end; the live table marks the failed
    node."""
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
