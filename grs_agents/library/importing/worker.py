"""The worker's part of an import: unpacking archives and preparing items, without keys or any other file."""

from functools import partial
from pathlib import Path
from typing import Any

from grs_agents.library.importing.archives import unpack_archive
from grs_agents.library.importing.asset_preparation import prepare_asset
from grs_agents.library.importing.asset_writing import write_asset_files
from grs_agents.library.importing.types import ImportJob, ImportLimits
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Unpack the ``archive`` into ``target``, or do the ``job``, whose files are sent as blobs."""
    if "archive" in request:
        limits = ImportLimits.model_validate(request["limits"])
        return answer_or_refuse(partial(_unpack, Path(request["archive"]), Path(request["target"]), limits))
    return answer_or_refuse(partial(_prepare, ImportJob.model_validate(request["job"])))


def _unpack(archive: Path, target: Path, limits: ImportLimits) -> dict[str, Any]:
    unpack_archive(archive, target, limits)
    return {}


def _prepare(job: ImportJob) -> dict[str, Any]:
    root = Path.cwd()  # the scratch folder
    asset = write_asset_files(root, *prepare_asset(job))
    for file in sorted(root.rglob("*")):
        if file.is_file():
            send_blob(file.relative_to(root).as_posix(), file.read_bytes())
    return {"asset": asset.model_dump(mode="json")}
