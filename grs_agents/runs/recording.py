"""Record a run as a cassette; repeat it with its settings, and compare the two."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from grs_agents.agents.recorded import Cassette, collect_exchanges, read_cassette
from grs_agents.base.config.load import flatten_tree
from grs_agents.base.config.recorded import select_portable_settings
from grs_agents.base.config.schema import Config
from grs_agents.base.files import resolve_output_file, write_bytes
from grs_agents.base.trace.log import read_events
from grs_agents.base.version import __version__
from grs_agents.perception.reading.scene_source import short_scene_name
from grs_agents.runs.record import RunRecord
from grs_agents.runs.sharing import make_scrubber

_MADE = ("task.json", "simulation.py", "test_simulation.py", "instances/*.json")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def write_cassette(file: Path, config: Config, record: RunRecord, folder: Path) -> None:
    """Write the run in ``folder`` to ``file``, without keys and home folders, whichever way it ended.

    Raises:
        InputError: the file cannot be written, or the log cannot be read.
    """
    default, present = (flatten_tree(one.model_dump(mode="json")) for one in (Config(), config))
    cassette = Cassette(
        version=__version__,
        scene=short_scene_name(Path(record.source)),
        settings=select_cassette_settings({key: value for key, value in present.items() if value != default.get(key)}),
        status=record.status,
        reason=record.reason,
        files=_digest_run_files(folder),
        exchanges=collect_exchanges(read_events(folder / "events.jsonl")),
    )
    keys = [spec.key_variable for spec in config.models.values() if spec.key_variable]
    text = json.dumps(cassette.model_dump(mode="json"), indent=1, ensure_ascii=False) + "\n"
    write_bytes(resolve_output_file(file), make_scrubber(folder, keys).remove_secrets(text).encode())


def add_recording_comparison(name: str, record: RunRecord, folder: Path) -> RunRecord:
    """The record, whose reason tells whether the run ended as its recording: verdict, programs and task instances."""
    cassette, made = read_cassette(name), _digest_run_files(folder)
    differ = sorted({file for file, _ in made.items() ^ cassette.files.items()})
    if record.status != cassette.status:
        differ.insert(0, f"the verdict (recorded: {cassette.status})")
    how = f"differs from the recording in {', '.join(differ)}" if differ else "equal to the recording"
    return record.model_copy(update={"reason": f"{record.reason}; {how}"})


def select_cassette_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings that a cassette brings along, which may come from anybody: portable ones, and the names of models,
    which are not asked."""
    names = {key: value for key, value in settings.items() if re.fullmatch(r"models\.[a-z_]+\.model", key)}
    return {key: value for key, value in {**select_portable_settings(settings), **names}.items() if value is not None}


def _digest_run_files(folder: Path) -> dict[str, str]:
    """The files that a run is about, each with a digest that does not depend on the last digits of its numbers."""
    files = sorted(file for pattern in _MADE for file in folder.glob(pattern))
    texts = {file: _NUMBER.sub(_round_matched_number, file.read_text("utf-8")) for file in files}
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(text.encode()).hexdigest()[:16]
        for file, text in texts.items()
    }


def _round_matched_number(number: re.Match[str]) -> str:
    return f"{round(float(number[0]), 4) + 0.0:.4f}"  # + 0.0 makes zero of minus zero
