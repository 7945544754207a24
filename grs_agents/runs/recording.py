"""Cassettes: record a run, repeat it with its settings, and compare the two."""

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
_MOST_LISTED = 100
"""Most files that a reason lists; a run has at most 103 of these."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def write_cassette(file: Path, config: Config, record: RunRecord, folder: Path) -> None:
    """Write the run in ``folder`` as a cassette, without keys and home folders, whatever its outcome.

    Raises:
        InputError: the file cannot be written, or the log cannot be read.
    """
    default, present = (flatten_tree(item.model_dump(mode="json")) for item in (Config(), config))
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
    """The record, with the comparison of verdict, programs and task instances with the cassette in its reason."""
    cassette, digests = read_cassette(name), _digest_run_files(folder)
    differences = sorted({file for file, _ in digests.items() ^ cassette.files.items()})
    if len(differences) > _MOST_LISTED:
        differences[_MOST_LISTED:] = [f"{len(differences) - _MOST_LISTED} more files"]
    if record.status != cassette.status:
        differences.insert(0, f"the verdict (recorded: {cassette.status})")
    result = f"differs from the recording in {', '.join(differences)}" if differences else "equal to the recording"
    return record.model_copy(update={"reason": f"{record.reason}; {result}"})


def select_cassette_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings stored in a cassette, which may be foreign: portable settings and model names, which are not
    called."""
    names = {key: value for key, value in settings.items() if re.fullmatch(r"models\.[a-z_]+\.model", key)}
    return {key: value for key, value in {**select_portable_settings(settings), **names}.items() if value is not None}


def _digest_run_files(folder: Path) -> dict[str, str]:
    """Digests of task, programs and instances, with numbers rounded to 4 decimals."""

    def round_number(number: re.Match[str]) -> str:
        return f"{round(float(number[0]), 4) + 0.0:.4f}"  # + 0.0 turns minus zero into zero

    files = sorted(file for pattern in _MADE for file in folder.glob(pattern))
    texts = {file: _NUMBER.sub(round_number, file.read_text("utf-8")) for file in files}
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(text.encode()).hexdigest()[:16]
        for file, text in texts.items()
    }
