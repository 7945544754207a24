"""Files written whole: a reader sees the old content or the new, never half of it."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from grs_agents.errors import InputError


def write_bytes(path: Path, data: bytes) -> Path:
    """Write ``data`` to ``path`` through a temporary file in the same folder.

    Raises:
        InputError: the folder cannot be written or the disk is full.
    """
    temporary = path.with_name(f".{path.name}.{uuid4().hex[:8]}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):  # what stands in the way of the file may stand in the way of its removal
            temporary.unlink()
        raise unwritable(path, error) from error
    return path


def unwritable(path: Path, error: OSError) -> InputError:
    """The one-line error for a file that the system refused to write."""
    reason = error.strerror or str(error)
    return InputError(f"cannot write {path}: {reason}", "free space or name a writable folder with --out")


def write_text(path: Path, text: str) -> Path:
    """Write ``text`` as UTF-8, whole."""
    return write_bytes(path, text.encode("utf-8"))


def write_json(path: Path, value: Any) -> Path:
    """Write ``value`` as indented JSON, whole; NaN and infinity are refused by ``json``."""
    return write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
