"""Untrusted run folders: nothing in them leads out, blocks, or is too large to read."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from grs_agents.base.errors import InputError

MOST_ENTRIES, MOST_LEVELS = 20_000, 16
"""A run of 60 objects and ten fixes has some hundred files on three levels."""
_MIB = 1 << 20
_TEXTS = {1: ".urdf .xml .mtl .py .toml", 2: ".diff", 8: ".json .md .txt"}
_DATA = {32: ".jsonl .obj", 64: ".npz .png .jpg", 256: ".sqlite"}
MOST_BYTES = {suffix: mib * _MIB for mib, names in (_TEXTS | _DATA).items() for suffix in names.split()}
"""The largest file of each kind that GRS reads from a run folder; about 100 times the sample run's."""
MOST_TOGETHER = 512 * _MIB
"""Of all files of these kinds: `grs share` packs them in memory."""
REMEDY = "remove it, or ask whoever made the folder for a plain copy"


def check_run_folder(folder: Path) -> None:
    """Check every entry of a run folder before any file in it is opened; entries that vanish meanwhile are no fault.
    Raises InputError: an entry is neither a folder nor a regular file, is a link that leads out or to a folder, or is
    too large; or there are too many."""
    root, total = folder.resolve(), 0
    for number, entry in enumerate(_walk_entries(root), start=1):
        if number > MOST_ENTRIES:
            raise InputError(f"{folder} holds more than {MOST_ENTRIES} files", "name a folder that `grs run` wrote")
        try:
            status = _stat_inside_root(entry, root)
        except FileNotFoundError:
            continue
        if not stat.S_ISREG(status.st_mode):
            continue
        most = MOST_BYTES.get(entry.suffix.lower())
        if most is not None and status.st_size > most:
            raise InputError(f"{entry} has {status.st_size} bytes, more than {most} for {entry.suffix} files", REMEDY)
        total += 0 if most is None else status.st_size
        if total > MOST_TOGETHER:
            raise InputError(f"the files in {folder} have more than {MOST_TOGETHER} bytes", REMEDY)


def resolve_member_file(folder: Path, name: str) -> Path:
    """The file of a run folder that a record calls ``name``. Raises InputError: it leads out, or is no regular file."""
    if not is_relative_subpath(name):
        raise InputError(f"{folder} names the file {name[:200]!r}, which is no path inside it", REMEDY)
    path = folder / name
    try:
        if not path.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"{path} leads out of {folder}", REMEDY)
        status = path.stat()
    except (OSError, RuntimeError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"cannot read {path}: {reason}", "restore the file or run again") from error
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"cannot read {path}: it is no regular file", REMEDY)
    return path


def is_relative_subpath(name: str) -> bool:
    """True for a relative path to something below its start."""
    pure = PurePosixPath(name)
    unusual = any(letter in "\\:" or letter < " " for letter in name)
    return bool(pure.parts) and not pure.is_absolute() and ".." not in pure.parts and not unusual


def find_member_file(folder: Path, name: str) -> Path | None:
    """The file of a run folder as `resolve_member_file` finds it; None if nothing has that name."""
    return (
        resolve_member_file(folder, name) if not is_relative_subpath(name) or os.path.lexists(folder / name) else None
    )


def _walk_entries(root: Path) -> Iterator[Path]:
    """Everything below ``root``; links are not followed."""
    waiting = [(root, 1)]
    while waiting:
        folder, level = waiting.pop()
        if level > MOST_LEVELS:
            raise InputError(f"{folder} lies deeper than {MOST_LEVELS} folders", REMEDY)
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    yield Path(entry.path)
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append((Path(entry.path), level + 1))
        except (FileNotFoundError, NotADirectoryError):  # `folder` is for its reader to name; others vanished
            continue
        except OSError as error:
            raise InputError(f"cannot read {folder}: {error.strerror}", "name a folder that you may read") from error


def _stat_inside_root(entry: Path, root: Path) -> os.stat_result:
    status = entry.lstat()
    if stat.S_ISLNK(status.st_mode):
        try:
            inside = entry.resolve(strict=True).is_relative_to(root)
        except (OSError, RuntimeError):
            inside = False
        if not inside:
            raise InputError(f"{entry} is a link that leads out of the run folder or nowhere", REMEDY)
        status = entry.stat()
        if stat.S_ISDIR(status.st_mode):  # copies of it would contain each other
            raise InputError(f"{entry} is a link to a folder", REMEDY)
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise InputError(f"{entry} is neither a regular file nor a folder", REMEDY)
    return status
