"""``hashes.json``: what every file of an ended run held, and every file of the library that its instances use.

Pages, films and recordings that verbs add later are entered as they are added. It tells that something was changed. It
is no signature: whoever changes a file can write new hashes, and then only the recomputed audit tells.
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
from grs_agents.base.files import write_text
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import TaskInstance

FILE = "hashes.json"
MADE_LATER = frozenset({".rrd", ".html", ".htm", ".zip", ".mp4", ".gif", ".webp"})
"""Kinds of files that verbs make of a run, also anew; nothing is read from them, but people look at them."""
_APART = frozenset({FILE, ".lock"})
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
"""SHA-256 of a file's bytes."""


class RunHashes(Frozen):
    """The hashes of a run."""

    files: dict[str, Hash]  # by path relative to the run folder
    # by asset: of its file, meshes and textures by path relative to the library, and of its entry in the manifest
    library: dict[str, dict[str, Hash]]

    def as_text(self) -> str:
        """The content of the file, the same for equal hashes."""
        return json.dumps(self.model_dump(mode="json"), indent=1, sort_keys=True) + "\n"


def write_hashes(folder: Path) -> RunHashes:
    """Hash an ended run, whose files nobody writes any more. Raises InputError: a file cannot be read or written."""
    library = Library()
    used = {name: _hash_asset(name, library) for name in _collect_asset_names(folder) if name in library}
    hashes = RunHashes(files=_hash_run_files(folder), library=used)
    write_text(folder / FILE, hashes.as_text(), durable=True)
    return hashes


def add_hash(folder: Path, file: Path) -> None:
    """Let the hashes of an ended run tell what ``file`` holds, if a verb has just made it in the run's ``folder``.

    Hashes that are not as they were written stay so, for `list_changed_files` to tell. Raises InputError: a file cannot
    be read or written.
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
    """Let the hashes in ``copy`` say what its files hold now that ``before`` were replaced and ``left_out`` are gone.

    Pages, films and recordings are gone too; `add_hash` tells of those that are made of the copy. A file that did not
    have its hash before gets no new one: a change of somebody else's stays one.
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
    """One line for each file that is not what it was when the run ended; it begins with the file's name.

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
    changed += _describe_hash_differences(hashes.files, _hash_run_files(folder))
    library = Library()
    for asset, before in sorted(hashes.library.items()):
        changed += _describe_hash_differences(before, dict(_hash_asset_parts(asset, before, library)))
    return tuple(changed)


def _read_hashes(folder: Path) -> RunHashes:
    try:
        return RunHashes.model_validate(read_json(folder / FILE, "restore the file"))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"it is damaged at {where}: {first['msg']}", "restore the file") from error


def _describe_hash_differences(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    for name in sorted({*before, *now}):
        if before.get(name) != now.get(name):
            what = "is missing" if name not in now else "was added" if name not in before else "was changed"
            line = name.replace("\n", "\\n")  # or a name could add a line of its own to the report
            yield f"{line}: it {what}"


def _hash_run_files(folder: Path) -> dict[str, str]:
    files = (file for file in folder.rglob("*") if file.is_file())
    named = {file.relative_to(folder).as_posix(): file for file in files}
    return {name: _sha256_of_file(file) for name, file in sorted(named.items()) if name not in _APART}


def _collect_asset_names(folder: Path) -> set[str]:
    """The assets that the instances of a run name; those of its own lie in its folder."""
    names: set[str] = set()
    for file in sorted((folder / "instances").glob("*.json")):
        try:
            instance = TaskInstance.model_validate(read_json(file, "restore the file"))
        except (ValidationError, InputError):  # its own hash tells
            continue
        names |= {item.asset for item in instance.objects}
    return names


def _hash_asset(name: str, library: Library) -> dict[str, str]:
    model = library.load_object_model(name)
    parts = {part for shape in (*model.visuals, *model.colliders) for part in (shape.mesh, shape.texture) if part}
    return dict(_hash_asset_parts(name, (_format_manifest_entry_name(name), name, *sorted(parts)), library))


def _format_manifest_entry_name(name: str) -> str:
    """How the manifest's entry of an asset is called among the hashes of its files."""
    return f"manifest.json, {name}"


def _hash_asset_parts(asset: str, parts: Iterable[str], library: Library) -> Iterator[tuple[str, str]]:
    """The hash of each part of ``asset`` that is there: its file, a mesh, a texture, or what the manifest says of it.
    Nothing is parsed, so that a damaged file is named and not what depends on it."""
    for part in parts:
        with suppress(InputError):
            if part == _format_manifest_entry_name(asset):
                yield part, _sha256_of_bytes(library.asset(asset).model_dump_json().encode())
            else:
                yield part, _sha256_of_bytes(read_bytes(library.mesh_or_texture_path(part)))


def _sha256_of_file(file: Path) -> str:
    """Of a file of any size, piece by piece. Raises InputError: it cannot be read."""
    try:
        with file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}", "restore the file") from error


def _sha256_of_bytes(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
