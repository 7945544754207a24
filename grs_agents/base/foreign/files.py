"""Files from outside: regular files of bounded size, and JSON of bounded depth and count."""

import json
import re
import stat
from collections.abc import Callable
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from grs_agents.base.errors import InputError

MOST_BYTES = 1 << 30
"""No file of a scene is larger, in bytes."""
_PIECE = 1 << 20
MOST_JSON_BYTES = 1 << 26
MOST_TEXT_BYTES = 1 << 20
"""A program or a configuration file has a few kilobytes."""
MOST_DEPTH = 64
"""Levels of nested arrays and objects; files of GRS have about ten. Python's own parser fails at about 1,000."""
MOST_VALUES = 250_000
"""Values of a file in a run folder. The log of the sample run has 2,400; a value takes up to 500 bytes."""
MOST_VALUES_OF_DATA = 2_000_000
"""Values of any other file: data sets list the poses of thousands of pictures in a single file. They take 320 MB."""
_HALF_PAIR = re.compile(rb"\\u[dD][89a-fA-F]")
"""Escape of a surrogate. Without its other half it is no text, and no file could be written with it."""
_TOKEN = re.compile(rb'"(?:[^"\\\n]++|\\.)*+"?|[\[{\]},\n]')


_Content = TypeVar("_Content")


def cache_until_modified(entries: int) -> Callable[[Callable[[Path], _Content]], Callable[[Path], _Content]]:
    """Decorate a function of a file: its last ``entries`` results are kept until their files are modified."""

    def decorate(read: Callable[[Path], _Content]) -> Callable[[Path], _Content]:
        @lru_cache(entries)
        def read_version(path: Path, _inode: int, _modified: int, _size: int) -> _Content:
            return read(path)

        @wraps(read)
        def read_current(path: Path) -> _Content:
            try:
                status = path.stat()
            except OSError:
                return read(path)  # which reports it
            return read_version(path, status.st_ino, status.st_mtime_ns, status.st_size)

        return read_current

    return decorate


def path_exists(path: Path) -> bool:
    """True if the name exists, even as a broken or endless link."""
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True
    return True


def is_folder(path: Path) -> bool:
    """True for a folder; False if it cannot be looked at."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def list_folder_names(folder: Path) -> list[str]:
    """The names in a folder, sorted. Raises InputError: it cannot be read."""
    try:
        return sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}", "name a folder that you may read") from error


def read_bytes(file: Path, remedy: str = "", most: int = MOST_BYTES) -> bytes:
    """The content of a regular file. Raises InputError: it cannot be read, is no regular file, or is too large."""
    try:
        status = file.stat()  # before it is opened: a pipe would wait for its other end
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "no regular file"
            raise InputError(f"cannot read {file}: it is {kind}", remedy or "give a file of that name")
        if status.st_size > most:
            raise InputError(f"{file} has {status.st_size} bytes, more than {most}", "give a smaller file")
        with file.open("rb") as stream:
            data = stream.read(status.st_size + 1)  # not `most`, for which memory would be reserved ahead
            while len(data) > status.st_size and len(data) <= most and (more := stream.read(_PIECE)):
                data += more  # it grows, or lies in /proc, whose files say that they have 0 bytes
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"cannot read {file}: {reason}", remedy or "give a file that you may read") from error
    if len(data) > most:
        raise InputError(f"{file} has more than {most} bytes", "give a smaller file")
    return data


def read_text(file: Path, remedy: str = "", most: int = MOST_TEXT_BYTES) -> str:
    """The text of a regular UTF-8 file. Raises InputError: as `read_bytes`, or it is not UTF-8."""
    try:
        return read_bytes(file, remedy, most).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{file} is not UTF-8 text: {error}", remedy or "give a text file") from error


def check_json_limits(data: bytes, where: object, values: int | None = MOST_VALUES) -> None:
    """See that JSON, or lines of JSON, is not nested too deep and does not hold too many values, before it is parsed.

    Args:
        data: the text in UTF-8; only the parser decides if it is JSON.
        where: its name in errors.
        values: most values that it may hold; None for any number.

    Raises:
        InputError: it is deeper or holds more.
    """
    depth = count = 0
    for token in _TOKEN.finditer(data):
        letter = data[token.start()]
        if letter in b"[{":
            depth, count = depth + 1, count + 1
        elif letter in b"]}":
            depth -= 1
        elif letter == 0x2C:
            count += 1
        elif letter == 0x0A and depth <= 0:  # the line of a log ends
            depth = 0
        if depth > MOST_DEPTH:
            raise InputError(f"{where} is nested deeper than {MOST_DEPTH} levels", "restore the file")
        if values is not None and count > values:
            raise InputError(f"{where} holds more than {values} values", "restore the file")


def parse_json(data: bytes, where: object, remedy: str, values: int | None = MOST_VALUES) -> Any:
    """The value that JSON in UTF-8 holds. Raises InputError: it is none, or nested too deep, or too large."""
    check_json_limits(data, where, values)
    try:
        value = json.loads(data.decode("utf-8-sig"))
        if _HALF_PAIR.search(data):
            json.dumps(value, ensure_ascii=False).encode()
        return value
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is not JSON: {error}", remedy) from error


def read_json(file: Path, remedy: str) -> dict[str, Any]:
    """A JSON object. Raises InputError: it cannot be read, is not JSON in UTF-8, or is no object."""
    value = parse_json(read_bytes(file, remedy, MOST_JSON_BYTES), file, remedy, MOST_VALUES_OF_DATA)
    if not isinstance(value, dict):
        raise InputError(f"{file} is not a JSON object", remedy)
    return cast(dict[str, Any], value)
