"""The host's side of an import: a worker reads archives and items; its output is checked and written here."""

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.library.asset import Asset
from grs_agents.library.formats.model_file import MAX_PARTS
from grs_agents.library.importing.asset_discovery import find_item_files
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import ImportJob, ImportLimits, RefusedError
from grs_agents.sandbox.host.foreign_reader import ForeignReader

_WORKER: Final = "grs_agents.library.importing.asset_preparation"
_UNPACKER: Final = "grs_agents.library.importing.archives"
"""Of an archive: it need not import what repairs meshes."""
_WALL_SECONDS: Final = 3.0
"""For each second of processor time."""
_BASE_SECONDS, _BASE_BYTES = 20.0, 480 << 20
"""Base allowance of any item. A bomb is a small file with a high cost; a fine mesh of 2 million faces is a large
file."""
_SECONDS_A_MEGABYTE, _TIMES_ITS_SIZE = 10.0, 30.0
"""Allowance by the size of an item: a byte of OBJ or GLB becomes up to 20 in memory."""
_SCRATCH_MIB: Final = 256
_OUTPUT_MIB: Final = 256
_VIEW: Final = re.compile(r"-\d\.png")


class ItemWorkers:
    """Workers that prepare the items of a source; close it."""

    def __init__(self, folder: SourceFolder, limits: ImportLimits, jobs: int) -> None:
        self._limits, self._folder = limits, folder
        self._reader = ForeignReader(
            _WORKER, [folder.root], Limits(scratch_mib=_SCRATCH_MIB, output_mib=_OUTPUT_MIB), workers=jobs
        )

    def import_item(self, job: ImportJob) -> Asset:
        """Prepare an item in a worker and write its files into the library; its entry.
        Raises RefusedError: it cannot be read, or costs too much. InputError: the library cannot be written."""
        files = find_item_files(self._folder, job.item)
        size = sum(file.stat().st_size for name in files if (file := self._folder.root / name).is_file())
        seconds = min(float(self._limits.seconds), _BASE_SECONDS + _SECONDS_A_MEGABYTE * size / 1e6)
        memory = min(self._limits.memory, int(_BASE_BYTES + _TIMES_ITS_SIZE * size))
        limits = Limits(
            cpu_seconds=seconds,
            wall_seconds=min(_WALL_SECONDS * seconds + 5, 3600),
            memory_mib=min(max(memory >> 20, 64), 65536),
            scratch_mib=_SCRATCH_MIB,
            output_mib=_OUTPUT_MIB,
        )
        try:
            reading = self._reader.read({"job": job.model_dump(mode="json")}, job.item.file, limits)
        except InputError as error:
            raise RefusedError(error.message, error.remedy) from error
        try:
            asset = Asset.model_validate(reading.answer["asset"])
        except (KeyError, ValidationError) as error:
            raise RefusedError(f"{job.item.file}: the worker's answer is no asset", "try again") from error
        home, slug = job.collection, job.item.name
        parts = [f"{home}/meshes/{slug}.part{number}.obj" for number in range(MAX_PARTS)]
        allowed = {f"{home}/{slug}.urdf", f"{home}/meshes/{slug}.obj", f"{home}/textures/{slug}.png", *parts}
        views = {
            name
            for name in reading.blobs
            if name.startswith(f"{home}/views/{slug}-") and _VIEW.search(name, len(name) - 6)
        }
        views = {name for name in views if len(name) == len(f"{home}/views/{slug}-0.png")}
        if (
            asset.name != f"{home}/{slug}.urdf"
            or asset.name not in reading.blobs
            or asset.origin is None
            or reading.blobs.keys() - allowed - views
        ):
            raise RefusedError(f"{job.item.file}: the worker's answer is no asset", "try again")
        for part in parts:
            if part not in reading.blobs:
                (job.root / part).unlink(missing_ok=True)  # of an earlier import
        for name, data in reading.blobs.items():
            write_bytes(job.root / name, data)
        digests = {
            name: hashlib.sha256(reading.blobs[name]).hexdigest() for name in asset.origin.files if name in allowed
        }
        return asset.model_copy(update={"origin": asset.origin.model_copy(update={"files": digests})})

    def close(self) -> None:
        """End the workers."""
        self._reader.close()


def unpack_in_worker(
    archives: Sequence[tuple[Path, Path]], home: Path, limits: ImportLimits
) -> dict[Path, RefusedError]:
    """Unpack each archive into its folder below ``home``. Returns: the errors of refused archives."""
    refused: dict[Path, RefusedError] = {}
    most = Limits(
        cpu_seconds=min(limits.seconds, 60),
        wall_seconds=180,
        memory_mib=512,
        scratch_mib=min(max(limits.unpacked >> 20, 1), 4096),
        output_mib=1,
    )
    with ForeignReader(_UNPACKER, [archive for archive, _ in archives], most, [home]) as reader:
        for archive, target in archives:
            request = {
                "archive": str(archive.resolve()),
                "target": str(target.resolve()),
                "limits": limits.model_dump(mode="json"),
            }
            try:
                reader.read(request, archive.name)
            except InputError as error:
                refused[archive] = RefusedError(error.message, error.remedy)
    return refused
