"""Unpacking archives that strangers made: zip (wheels too) and tar, bounded, nothing outside the folder, no links."""

import tarfile
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import IO, Final

from grs_agents.library.importing.types import ImportLimits, RefusedError

SUFFIXES: Final = (".zip", ".whl", ".tgz", ".tar.gz", ".tar")
_WANTED: Final = (
    ".obj", ".mtl", ".glb", ".gltf", ".bin", ".stl", ".ply", ".dae", ".msh", ".urdf", ".xml", ".mjcf", ".png", ".jpg",
    ".jpeg", ".tga", ".bmp", ".pbtxt", ".sdf", ".txt", ".md",
)  # fmt: skip
_FILES: Final = 100_000
_CHUNK: Final = 1 << 20


def is_archive(path: Path) -> bool:
    """Whether a file's name says that it is an archive."""
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


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
