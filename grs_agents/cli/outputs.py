"""What a finished run offers: ``grs trace``, ``grs share``, ``grs play`` and ``grs report``."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

from grs_agents.cli.show import rebuild_recording
from grs_agents.files import STANDARD_OUTPUT, check_output, write_document
from grs_agents.library import Library
from grs_agents.models import PROVIDERS
from grs_agents.run import read_record
from grs_agents.terminal import say
from grs_agents.trace import read_events


def rebuild_trace(folder: Path) -> None:
    """Make the recording of a run anew and say so."""
    from grs_agents.views import working

    with working("making the recording"):
        recording = rebuild_recording(folder)
    count = len(read_events(folder / "events.jsonl"))
    say(f"{recording}: {count} events, {recording.stat().st_size / 2**20:.1f} MiB")


def send_spans(folder: Path) -> None:
    """Send a run as OpenTelemetry spans to where the ``OTEL_*`` variables say."""
    from grs_agents.views import SpanView, otlp_provider

    read_record(folder)
    events = read_events(folder / "events.jsonl")
    view = SpanView(otlp_provider())
    for event in events:
        view(event)
    view.finish()
    say(f"{folder}: {len(events)} events sent as spans")


def play_run(folder: Path, out: Path | None, seed: int | None) -> int:
    """Play a rollout of a run in MuJoCo's window, or into the file ``out``."""
    from grs_agents.views import working
    from grs_agents.views.common import run_library
    from grs_agents.views.film import Shot, rollout_of, watch, write_film

    robot = str(read_record(folder).config.get("robot", "ur5e"))
    rollout = rollout_of(read_events(folder / "events.jsonl"), folder, seed)
    shot = Shot(folder.resolve(), rollout, run_library(folder, Library()), robot)
    if out is None:
        return watch(shot)
    with working("drawing the film") as show:
        frames = write_film(shot, out, show=show)
    say(f"{out}: seed {shot.event.seed}, {frames} frames, {out.stat().st_size / 2**20:.1f} MiB")
    return 0


def write_report(folder: Path, out: Path | None, show: Callable[[str], None]) -> Path:
    """Write a run as one HTML page, ``report.html`` in its folder if nothing else is named."""
    from grs_agents.views import Sources, report
    from grs_agents.views.common import run_library

    record, out = read_record(folder), out or folder / "report.html"
    check_output(out)
    sources = Sources(folder, run_library(folder, Library()), str(record.config.get("robot", "ur5e")), show)
    page = report(record.model_dump(mode="json"), read_events(folder / "events.jsonl"), sources)
    return write_document(out, page.encode("utf-8", "replace"))


def report_run(folder: Path, out: Path | None) -> None:
    """Write the page and say where it is; standard output is the page's alone."""
    from grs_agents.views import working

    with working("writing the report") as show:
        path = write_report(folder, out, show)
    if path != STANDARD_OUTPUT:
        say(f"{path}: {path.stat().st_size / 2**20:.1f} MiB")


def share_run(folder: Path, out: Path | None) -> None:
    """Pack a run into a zip file without keys and home folders, and say what was removed and left out."""
    from grs_agents.run import scrubber, share
    from grs_agents.views import working

    record = read_record(folder)
    path = out or folder.resolve().with_suffix(".zip")
    check_output(path)
    with working("removing keys and home folders") as show:
        shared = share(folder, path, scrubber(folder, _key_variables(record.config)), partial(_make, show=show))
    tell = partial(say, error=path == STANDARD_OUTPUT)
    tell(f"{shared.path}: {shared.files} files, {shared.size / 2**20:.1f} MiB")
    if shared.changed:
        tell(f"paths, keys or picture comments were removed from: {', '.join(shared.changed)}")
    if shared.left_out:
        tell(f"left out: {', '.join(shared.left_out)}")


def _make(copy: Path, show: Callable[[str], None]) -> list[Path]:
    show("making the recording")
    made = [rebuild_recording(copy), write_report(copy, None, show)]
    show("packing")
    return made


def _key_variables(config: dict[str, Any]) -> list[str]:
    """The environment variables from which the run's models take their keys."""
    models = cast("dict[str, dict[str, Any]]", config.get("models") or {})
    named = [str(model.get("key_variable") or "") for model in models.values()]
    return [name for name in (*named, *(provider.key_variable for provider in PROVIDERS.values())) if name]
