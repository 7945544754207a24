"""``hashes.json``: digests of all files of an ended run, and of the library files that its instances use.

Verbs that add pages, films and recordings later add their digests. The file detects changes but is no signature:
whoever changes a file can rewrite its digest, and then only the recomputed audit shows it.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.files import describe_hash_differences, hash_folder_files, write_text
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import TaskInstance

FILE = "hashes.json"
MADE_LATER = frozenset({".rrd", ".html", ".htm", ".zip", ".mp4", ".gif", ".webp"})
"""Suffixes of files that verbs derive from a run, for people to look at; nothing is read from them."""
_APART = frozenset({FILE, ".lock"})
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
"""SHA-256 of a file's bytes."""


class RunHashes(Frozen):
    """The hashes of a run."""

    files: dict[str, Hash]  # by path relative to the run folder
    # by asset: its file, meshes and textures by path relative to the library, and its manifest entry
    library: dict[str, dict[str, Hash]]

    def as_text(self) -> str:
        """The canonical text of the file."""
        return json.dumps(self.model_dump(mode="json"), indent=1, sort_keys=True) + "\n"


def write_hashes(folder: Path) -> RunHashes:
    """Hash an ended run. Raises InputError: a file cannot be read or written."""
    library = Library()
    names: set[str] = set()
    for file in sorted((folder / "instances").glob("*.json")):
        with suppress(ValidationError, InputError):  # a damaged instance is found by its own hash
            instance = TaskInstance.model_validate(read_json(file, "restore the file"))
            names |= {item.asset for item in instance.objects}
    assets: dict[str, dict[str, str]] = {}
    for name in filter(library.__contains__, names):
        model = library.load_object_model(name)
        parts = {part for shape in (*model.visuals, *model.colliders) for part in (shape.mesh, shape.texture) if part}
        assets[name] = dict(_hash_asset_parts(name, (_manifest_entry_key(name), name, *sorted(parts)), library))
    hashes = RunHashes(files=hash_folder_files(folder, _APART), library=assets)
    write_text(folder / FILE, hashes.as_text(), durable=True)
    return hashes


def add_hash(folder: Path, file: Path) -> None:
    """Add the digest of ``file``, if a verb has just made it in the folder of an ended run.

    Damaged hashes stay unchanged, for `list_changed_files` to report. Raises InputError: a file cannot be read or
    written.
    """
    place, root = file.resolve(), folder.resolve()
    if place.suffix.lower() not in MADE_LATER or not place.is_relative_to(root) or not (root / FILE).is_file():
        return
    try:
        hashes = _read_hashes(root)
    except InputError:
        return
    if read_bytes(root / FILE) == hashes.as_text().encode():
        files = {**hashes.files, place.relative_to(root).as_posix(): _sha256_of_bytes(read_bytes(place))}
        write_text(root / FILE, hashes.model_copy(update={"files": files}).as_text())


def update_hashes_in_copy(copy: Path, before: Mapping[str, bytes], left_out: Iterable[str]) -> None:
    """Update the hashes in ``copy`` after the files ``before`` were replaced and ``left_out`` were removed.

    Pages, films and recordings are removed too; `add_hash` adds those made from the copy. A file whose digest did
    not match before gets no new digest, so that foreign changes stay visible.
    """
    if not (copy / FILE).is_file():
        return
    hashes = _read_hashes(copy)
    gone = set(left_out)
    files = {
        name: value
        for name, value in hashes.files.items()
        if name not in gone and Path(name).suffix.lower() not in MADE_LATER
    }
    for name, data in before.items():
        if files.get(name) == _sha256_of_bytes(data):
            files[name] = _sha256_of_bytes(read_bytes(copy / name))
    write_text(copy / FILE, hashes.model_copy(update={"files": files}).as_text())


def list_changed_files(folder: Path) -> tuple[str, ...]:
    """A line for each file changed since the run ended, beginning with the file's name.

    Raises:
        InputError: the run has no hashes, or a file cannot be read.
    """
    if not (folder / FILE).exists():
        raise InputError(f"{folder} has no {FILE}", "name a run that ended, or make it anew with `grs run`")
    try:
        hashes = _read_hashes(folder)
    except InputError as error:
        return (f"{FILE}: {error.message}",)
    changed = [] if read_bytes(folder / FILE) == hashes.as_text().encode() else [f"{FILE}: it was written anew"]
    changed += describe_hash_differences(hashes.files, hash_folder_files(folder, _APART))
    library = Library()
    for asset, before in sorted(hashes.library.items()):
        changed += describe_hash_differences(before, dict(_hash_asset_parts(asset, before, library)))
    return tuple(changed)


def _read_hashes(folder: Path) -> RunHashes:
    try:
        return RunHashes.model_validate(read_json(folder / FILE, "restore the file"))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        raise InputError(f"it is damaged at {field}: {first['msg']}", "restore the file") from error


def _manifest_entry_key(name: str) -> str:
    """Key of an asset's manifest entry among the hashes of its files."""
    return f"manifest.json, {name}"


def _hash_asset_parts(asset: str, parts: Iterable[str], library: Library) -> Iterator[tuple[str, str]]:
    """Digest of each existing part of ``asset``: its file, meshes, textures, manifest entry.
    Parts are not parsed, so that a damaged file itself is reported and not its dependents."""
    for part in parts:
        with suppress(InputError):
            if part == _manifest_entry_key(asset):
                yield part, _sha256_of_bytes(library.asset(asset).model_dump_json().encode())
            else:
                yield part, _sha256_of_bytes(read_bytes(library.mesh_or_texture_path(part)))


def _sha256_of_bytes(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
