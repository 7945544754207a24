"""Cache of the test reports and audits of a run, by simulation and tests.

A fixer may bring back an earlier program. The judgements lie in a hidden folder of the run until it is concluded. A
resumed run judges anew: the folder may come from somebody else.
"""

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from grs_agents.audit.types import AuditReport
from grs_agents.base.errors import InputError
from grs_agents.base.files import unwritable_error, write_json
from grs_agents.base.foreign.files import read_json
from grs_agents.base.trace.events import Note, to_plain_json
from grs_agents.base.version import __version__
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import log_rollouts
from grs_agents.sandbox.protocol.report import TestReport

FOLDER: Final = ".judged"
_INSTANCES: Final = "seed_*"
_REMEDY: Final = "remove it: what it holds is found out anew"


def recall_test_report(state: RunState, services: Services) -> TestReport | None:
    """The report of the same tests of the same program; None where they have not run."""
    kept = _read_kept(_tests_folder(state, services) / "report.json")
    try:
        report = TestReport.model_validate(kept["report"]) if kept else None
    except ValidationError:  # of another version, or torn
        return None
    if report is not None:
        _note_reuse("test report", kept, services)
    return report


def keep_test_report(state: RunState, report: TestReport, services: Services) -> None:
    """Keep a report of a pair of programs, in case a fixer brings them back."""
    _write_kept(_tests_folder(state, services), state, report)


def recall_audit(state: RunState, services: Services) -> AuditReport | None:
    """The audit of the same programs for the same task; None if there is none.

    Restores the task instances of that audit in the run folder, and logs their rollouts.
    """
    folder = _audit_folder(state, services)
    kept = _read_kept(folder / "report.json")
    try:
        report = AuditReport.model_validate(kept["report"]) if kept else None
    except ValidationError:
        return None
    if report is not None:
        _replace_files(folder, services.folder / "instances")
        _note_reuse("audit", kept, services)
        log_rollouts(report.rollouts, services)
    return report


def keep_audit(state: RunState, report: AuditReport, services: Services) -> None:
    """Keep an audit with its task instances, in case a fixer brings the programs back."""
    folder = _audit_folder(state, services)
    _replace_files(services.folder / "instances", folder)
    _write_kept(folder, state, report)  # last, as a mark that the folder is complete


def forget_judgements(services: Services) -> None:
    """Remove the kept judgements.

    Raises:
        InputError: something of that name cannot be removed.
    """
    folder = services.folder / FOLDER
    try:
        if folder.is_symlink() or folder.is_file():
            folder.unlink()
        elif folder.is_dir():
            shutil.rmtree(folder)
    except OSError as error:
        raise unwritable_error(folder, error) from error


def _tests_folder(state: RunState, services: Services) -> Path:
    return services.folder / FOLDER / f"tests-{_digest(state, services, 'simulation', 'tests', 'scene')}"


def _audit_folder(state: RunState, services: Services) -> Path:
    digest = _digest(state, services, "simulation", "tests", "task", "revised", "scene")
    return services.folder / FOLDER / f"audit-{digest}"


def _digest(state: RunState, services: Services, *names: str) -> str:
    """Hash of all that a judgement depends on: the version, the configuration, and fields of the state."""
    judged = to_plain_json([__version__, services.config, *(state.get(name) or None for name in names)])
    return hashlib.sha256(json.dumps(judged, sort_keys=True).encode()).hexdigest()[:32]


def _write_kept(folder: Path, state: RunState, report: TestReport | AuditReport) -> None:
    versions = {f"{name}_version": state.get(f"{name}_version", 0) for name in ("simulation", "tests")}
    with suppress(ValueError):  # NaN or a lone surrogate of an episode, which JSON cannot hold: it is judged again
        write_json(folder / "report.json", {**versions, "report": report})


def _read_kept(file: Path) -> dict[str, Any]:
    if not file.is_file():
        return {}
    try:
        kept = read_json(file, _REMEDY)
    except InputError:
        return {}
    return kept if "report" in kept else {}


def _note_reuse(kind: str, kept: dict[str, Any], services: Services) -> None:
    versions = f"simulation version {kept.get('simulation_version')}, tests version {kept.get('tests_version')}"
    services.log.append(Note(text=f"the same programs were judged before ({versions}): their {kind} is used again"))


def _replace_files(source: Path, target: Path) -> None:
    """Replace the files of task instances in ``target`` by those in ``source``."""
    for stale in target.glob(_INSTANCES):
        stale.unlink()
    target.mkdir(parents=True, exist_ok=True)
    for file in source.glob(_INSTANCES):
        if file.is_file() and not file.is_symlink():
            shutil.copyfile(file, target / file.name)
