"""Files from outside: read whole, of bounded size, never a device, a pipe or a folder."""

import json
import stat
from pathlib import Path
from typing import Any, cast

from grs_agents.errors import InputError

MOST_BYTES = 1 << 30
"""No file of a scene is larger, in bytes."""
MOST_JSON_BYTES = 1 << 26


def exists(path: Path) -> bool:
    """Whether there is anything under this name, a broken link or an endless one included."""
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True
    return True


def is_folder(path: Path) -> bool:
    """Whether this is a folder; what cannot be looked at is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def names_in(folder: Path) -> list[str]:
    """The names in a folder, sorted.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}", "name a folder that you may read") from error


def read_bytes(file: Path, remedy: str = "", most: int = MOST_BYTES) -> bytes:
    """The whole content of a regular file.

    Args:
        file: its path.
        remedy: what to do if it is not there.
        most: how many bytes it may have.

    Raises:
        InputError: it cannot be read, is no regular file, or is too large.
    """
    try:
        status = file.stat()  # before it is opened: a pipe would wait for its other end for ever
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "no regular file"
            raise InputError(f"cannot read {file}: it is {kind}", remedy or "give a file of that name")
        if status.st_size > most:
            raise InputError(f"{file} has {status.st_size} bytes, more than {most}", "give a smaller file")
        return file.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"cannot read {file}: {reason}", remedy or "give a file that you may read") from error


def read_json(file: Path, remedy: str) -> dict[str, Any]:
    """A JSON object.

    Raises:
        InputError: it cannot be read, is not JSON in UTF-8, or is no object.
    """
    data = read_bytes(file, remedy, MOST_JSON_BYTES)
    try:
        value: Any = json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is not JSON: {error}", remedy) from error
    if not isinstance(value, dict):
        raise InputError(f"{file} is not a JSON object", remedy)
    return cast(dict[str, Any], value)
