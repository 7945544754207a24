"""Files written whole: a reader sees the old content or the new, never half of it."""

import errno
import json
import stat
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from grs_agents.errors import InputError, OutputError

STANDARD_OUTPUT = Path("-")
"""What a verb that writes one document takes for standard output."""


def resolve_output_file(path: Path) -> Path:
    """The file that writing to ``path`` makes or replaces, links resolved. Raises InputError: it is no regular file."""
    try:
        if path.is_symlink():
            path = path.resolve()
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return path
    except (OSError, RuntimeError) as error:
        remedy = error if isinstance(error, OSError) else OSError(errno.ELOOP, str(error))
        raise unwritable_error(path, remedy) from error
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "no regular file"
        raise InputError(f"cannot write {path}: it is {kind}", "name a new file with --out")
    return path


def check_output_path(path: Path) -> None:
    """Refuse ``path`` before the document is made. Raises InputError: `write_file_or_stdout` could not write it."""
    if path != STANDARD_OUTPUT:
        resolve_output_file(path)


def write_file_or_stdout(path: Path, data: bytes) -> Path:
    """Write ``data`` as `write_bytes` does, or to standard output where ``path`` is ``-``."""
    if path != STANDARD_OUTPUT:
        return write_bytes(resolve_output_file(path), data)
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()
    return path


def write_bytes(path: Path, data: bytes) -> Path:
    """Write ``data`` to ``path`` through a temporary file in the same folder. A link is replaced, never followed.
    Raises InputError: the folder cannot be written, the disk is full, or ``path`` is there and no regular file."""
    if not path.is_symlink():
        path = resolve_output_file(path)
    temporary = path.with_name(f".{path.name}.{uuid4().hex[:8]}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):  # what stands in the way of the file may stand in the way of its removal
            temporary.unlink()
        raise unwritable_error(path, error) from error
    return path


def unwritable_error(path: Path, error: OSError) -> OutputError:
    """The one-line error for a file that the system refused to write."""
    reason = error.strerror or str(error)
    return OutputError(f"cannot write {path}: {reason}", "free space or name a writable folder with --out")


def write_text(path: Path, text: str) -> Path:
    """Write ``text`` as UTF-8, whole."""
    return write_bytes(path, text.encode("utf-8"))


def write_json(path: Path, value: Any) -> Path:
    """Write ``value`` as indented JSON, whole; NaN and infinity are refused by ``json``."""
    return write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
