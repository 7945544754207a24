"""``grs trace``."""

from pathlib import Path

from grs_agents.cli.show import rebuilt
from grs_agents.run import read_record
from grs_agents.terminal import say, say_json
from grs_agents.trace import event_schema, read_events


def print_schema() -> None:
    """Print the JSON schema of one line of ``events.jsonl``."""
    say_json(event_schema())


def rebuild_trace(folder: Path) -> None:
    """Make the recording of a run anew and say so.

    Raises:
        InputError: the folder holds no run, or the run logged nothing.
    """
    from grs_agents.views import working

    with working("making the recording"):
        recording = rebuilt(folder)
    count = len(read_events(folder / "events.jsonl"))
    say(f"{recording}: {count} events, {recording.stat().st_size / 2**20:.1f} MiB")


def send_spans(folder: Path) -> None:
    """Send a run as OpenTelemetry spans to where the ``OTEL_*`` variables say.

    Raises:
        InputError: the folder holds no run.
        ConfigError: OpenTelemetry is not installed.
    """
    from grs_agents.views.telemetry import SpanView, otlp_provider

    read_record(folder)
    events = read_events(folder / "events.jsonl")
    view = SpanView(otlp_provider())
    for event in events:
        view(event)
    view.finish()
    say(f"{folder}: {len(events)} events sent as spans")
