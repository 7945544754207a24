"""``grs report`` and ``grs share``."""

import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from grs_agents.base.errors import InputError
from grs_agents.base.files import STANDARD_OUTPUT, check_output_path, refuse_link, write_file_or_stdout
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.base.trace.log import read_events
from grs_agents.cli.show import make_recording
from grs_agents.library.library import Library
from grs_agents.models.factory import PROVIDERS
from grs_agents.runs.hashes import add_hash
from grs_agents.runs.record import read_record


def send_otel_spans(folder: Path, as_json: bool) -> None:
    """Send a run as OpenTelemetry spans to the endpoint of the ``OTEL_*`` variables."""
    from grs_agents.views.telemetry import SpanView, make_otlp_provider

    read_record(folder)
    events = read_events(folder / "events.jsonl")
    view = SpanView(make_otlp_provider())
    for event in events:
        view(event)
    view.finish()
    if as_json:
        print_json({"run": str(folder), "events": len(events)})
    else:
        print_escaped(f"{folder}: {len(events)} events sent as spans")


def write_report(folder: Path, out: Path | None, show: Callable[[str], None]) -> Path:
    """Write a run as an HTML page, by default ``report.html`` in its folder."""
    from grs_agents.views.common.foreign_decoding import decode_in_worker
    from grs_agents.views.common.scene_objects import library_with_run_assets
    from grs_agents.views.report.page import render_html_report
    from grs_agents.views.report.pictures import Sources

    record, out = read_record(folder), out or folder / "report.html"
    check_output_path(out)
    sources = Sources(folder, library_with_run_assets(folder, Library()), show)
    with decode_in_worker(folder):
        page = render_html_report(record.model_dump(mode="json"), read_events(folder / "events.jsonl"), sources)
    path = write_file_or_stdout(out, page.encode("utf-8", "replace"))
    add_hash(folder, path)
    return path


def write_run_as_file(folder: Path, out: Path | None, seed: int | None, large: bool, as_json: bool) -> None:
    """Write a run in the format of ``out``'s suffix, and print the path unless it is standard output."""
    from grs_agents.views.film.rollout_film import HIGH_DEFINITION, SUFFIXES, make_rollout_shot, write_film
    from grs_agents.views.terminal import show_activity_status

    kind = "" if out is None else out.suffix.lower()
    with show_activity_status("writing the report") as show:
        if out is not None and kind == ".rrd":
            with tempfile.TemporaryDirectory() as temporary:
                recording = make_recording(folder, Path(temporary) / "trace.rrd")
                path = write_file_or_stdout(out, recording.read_bytes())
            add_hash(folder, path)
        elif out is not None and kind in SUFFIXES:
            read_record(folder)
            path = out
            write_film(make_rollout_shot(folder, seed, HIGH_DEFINITION if large else None), path, show=show)
            add_hash(folder, path)
        elif out in (None, STANDARD_OUTPUT) or kind in (".html", ".htm"):
            path = write_report(folder, out, show)
        else:
            endings = ", ".join((".html", *SUFFIXES, ".rrd"))
            raise InputError(f"cannot write a run as {out}", f"name a file that ends in one of {endings}")
    if path == STANDARD_OUTPUT:
        return
    if as_json:
        print_json({"file": str(path), "bytes": path.stat().st_size})
    else:
        print_escaped(f"{path}: {path.stat().st_size / 2**20:.1f} MiB")


def share_run_as_zip(folder: Path, out: Path | None, as_json: bool) -> None:
    """Pack a run into a zip file without keys and home folders, and print the removed and omitted files."""
    from grs_agents.runs.sharing import make_scrubber, pack_run_as_zip
    from grs_agents.views.terminal import show_activity_status

    record = read_record(folder)
    path = out or refuse_link(folder.resolve().with_suffix(".zip"))
    check_output_path(path)
    models = cast("dict[str, dict[str, Any]]", record.config.as_json().get("models") or {})
    choices = [choice for model in models.values() for choice in (model, *(model.get("fallbacks") or ()))]
    key_variables = [str(choice.get("key_variable") or "") for choice in choices]
    key_variables += [provider.key_variable for provider in PROVIDERS.values()]
    with show_activity_status("removing keys and home folders") as show:

        def write_recording_and_report(copy: Path) -> list[Path]:
            show("making the recording")
            recording = make_recording(copy, copy / "trace.rrd")
            add_hash(copy, recording)
            files = [recording, write_report(copy, None, show)]
            show("packing")
            return files

        scrubber = make_scrubber(folder, list(filter(None, key_variables)))
        shared = pack_run_as_zip(folder, path, scrubber, write_recording_and_report)
        add_hash(folder, path)
    if as_json and path != STANDARD_OUTPUT:
        print_json({**asdict(shared), "path": str(shared.path)})
        return
    lines = [f"{shared.path}: {shared.files} files, {shared.size / 2**20:.1f} MiB"]
    if shared.changed:
        lines.append(f"paths, keys or picture comments were removed from: {', '.join(shared.changed)}")
    if shared.left_out:
        lines.append(f"left out: {', '.join(shared.left_out)}")
    for line in lines:
        print_escaped(line, error=path == STANDARD_OUTPUT)
