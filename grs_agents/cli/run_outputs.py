"""What a finished run offers: ``grs trace``, ``grs share``, ``grs play`` and ``grs report``."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

from grs_agents.cli.show import rebuild_recording
from grs_agents.files import STANDARD_OUTPUT, check_output_path, write_file_or_stdout
from grs_agents.library import Library
from grs_agents.models import PROVIDERS
from grs_agents.runs import read_record
from grs_agents.terminal import print_escaped
from grs_agents.trace import read_events


def rebuild_trace(folder: Path) -> None:
    """Make the recording of a run anew and say so."""
    from grs_agents.views import show_activity_status

    with show_activity_status("making the recording"):
        recording = rebuild_recording(folder)
    count = len(read_events(folder / "events.jsonl"))
    print_escaped(f"{recording}: {count} events, {recording.stat().st_size / 2**20:.1f} MiB")


def send_otel_spans(folder: Path) -> None:
    """Send a run as OpenTelemetry spans to where the ``OTEL_*`` variables say."""
    from grs_agents.views import SpanView, make_otlp_provider

    read_record(folder)
    events = read_events(folder / "events.jsonl")
    view = SpanView(make_otlp_provider())
    for event in events:
        view(event)
    view.finish()
    print_escaped(f"{folder}: {len(events)} events sent as spans")


def play_rollout(folder: Path, out: Path | None, seed: int | None) -> int:
    """Play a rollout of a run in MuJoCo's window, or into the file ``out``."""
    from grs_agents.views import show_activity_status
    from grs_agents.views.common import library_with_run_assets
    from grs_agents.views.film import Shot, find_recorded_rollout, play_in_mujoco_window, write_film

    read_record(folder)
    rollout = find_recorded_rollout(read_events(folder / "events.jsonl"), folder, seed)
    shot = Shot(folder.resolve(), rollout, library_with_run_assets(folder, Library()))
    if out is None:
        return play_in_mujoco_window(shot)
    with show_activity_status("drawing the film") as show:
        frames = write_film(shot, out, show=show)
    print_escaped(f"{out}: seed {shot.event.seed}, {frames} frames, {out.stat().st_size / 2**20:.1f} MiB")
    return 0


def write_report(folder: Path, out: Path | None, show: Callable[[str], None]) -> Path:
    """Write a run as one HTML page, ``report.html`` in its folder if nothing else is named."""
    from grs_agents.views import Sources, render_html_report
    from grs_agents.views.common import library_with_run_assets

    record, out = read_record(folder), out or folder / "report.html"
    check_output_path(out)
    sources = Sources(folder, library_with_run_assets(folder, Library()), show)
    page = render_html_report(record.model_dump(mode="json"), read_events(folder / "events.jsonl"), sources)
    return write_file_or_stdout(out, page.encode("utf-8", "replace"))


def report_run(folder: Path, out: Path | None) -> None:
    """Write the page and say where it is; standard output is the page's alone."""
    from grs_agents.views import show_activity_status

    with show_activity_status("writing the report") as show:
        path = write_report(folder, out, show)
    if path != STANDARD_OUTPUT:
        print_escaped(f"{path}: {path.stat().st_size / 2**20:.1f} MiB")


def share_run_as_zip(folder: Path, out: Path | None) -> None:
    """Pack a run into a zip file without keys and home folders, and say what was removed and left out."""
    from grs_agents.runs import make_scrubber, pack_run_as_zip
    from grs_agents.views import show_activity_status

    record = read_record(folder)
    path = out or folder.resolve().with_suffix(".zip")
    check_output_path(path)
    with show_activity_status("removing keys and home folders") as show:
        shared = pack_run_as_zip(
            folder,
            path,
            make_scrubber(folder, _api_key_variables(record.config)),
            partial(_write_recording_and_report, show=show),
        )
    tell = partial(print_escaped, error=path == STANDARD_OUTPUT)
    tell(f"{shared.path}: {shared.files} files, {shared.size / 2**20:.1f} MiB")
    if shared.changed:
        tell(f"paths, keys or picture comments were removed from: {', '.join(shared.changed)}")
    if shared.left_out:
        tell(f"left out: {', '.join(shared.left_out)}")


def _write_recording_and_report(copy: Path, show: Callable[[str], None]) -> list[Path]:
    show("making the recording")
    made = [rebuild_recording(copy), write_report(copy, None, show)]
    show("packing")
    return made


def _api_key_variables(config: dict[str, Any]) -> list[str]:
    """The environment variables from which the run's models take their keys."""
    models = cast("dict[str, dict[str, Any]]", config.get("models") or {})
    choices = [choice for model in models.values() for choice in (model, *(model.get("fallbacks") or ()))]
    named = [str(choice.get("key_variable") or "") for choice in choices]
    return [name for name in (*named, *(provider.key_variable for provider in PROVIDERS.values())) if name]
