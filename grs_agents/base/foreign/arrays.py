"""Read ``.npy`` and ``.npz``: no pickles, and never more than the header promises and the bounds allow."""

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.bounded_streams import BoundedReader, check_zip_compression, open_zip
from grs_agents.base.foreign.elsewhere import current_decoder
from grs_agents.base.foreign.files import read_bytes

Numbers = npt.NDArray[Any]
MOST_BYTES = 1 << 29
"""No array needs more, unpacked: enough for 255 masks at 1920x1080, or 64 million pixels of eight bytes."""
MOST_MEMBERS = 64
_MOST_DIRECTORY = 1 << 20
"""Bytes of the table of an archive's members; a member with a usual name has about 60."""
_MOST_HEADER = 1 << 16
"""Bytes of an array's header; version 2.0 may promise 4 GB, of which numpy would read all before it looks."""
NUMBERS, MOST_WORD, MOST_TEXT = "buif", 400, 1 << 20
"""The kinds of numbers; bytes of the longest word (100 letters) and of all words of an array."""
MALFORMED = (
    *(ValueError, SyntaxError, TypeError, OverflowError, EOFError, OSError, MemoryError, LookupError, RuntimeError),
    *(NotImplementedError, zlib.error, zipfile.BadZipFile, tokenize.TokenError, struct.error),
)
"""Errors of numpy and zipfile on torn or forged files."""


def read_npy(file: Path) -> Numbers:
    """Read an array of numbers. Raises InputError: it cannot be read, holds Python objects or text, or is too large."""
    return read_npy_stream(BytesIO(read_bytes(file)), str(file))


def read_npz(
    file: Path,
    wanted: Mapping[str, str],
    optional: Mapping[str, str],
    together: int | None = None,
    text: Collection[str] = (),
) -> dict[str, Numbers]:
    """The arrays of an archive by name; others in it are not looked at.

    Args:
        file: its path.
        wanted: required names, each with a description.
        optional: names that may be there, likewise.
        together: most unpacked bytes of all arrays together; None bounds each alone.
        text: names of the arrays that hold words instead of numbers.

    Raises:
        InputError: it is no such archive, a wanted array is missing, or an array does not hold numbers.
    """
    decoder = current_decoder()
    if decoder is not None and (decoded := decoder.read_npz(file, wanted, optional, together, text)) is not None:
        return decoded
    with _open_npz(read_bytes(file, "give a .npz with rgb, depth and K"), str(file)) as archive:
        members = {name.removesuffix(".npy"): name for name in archive.namelist()}
        missing = ", ".join(f"{name} ({what})" for name, what in wanted.items() if name not in members)
        if missing:
            held = ", ".join(name[:40] for name in members) or "nothing"
            raise InputError(f"{file} holds {held}, but no {missing}", f"add {missing}")
        arrays: dict[str, Numbers] = {}
        left = MOST_BYTES if together is None else together
        for name in [name for name in (*wanted, *optional) if name in members]:
            with archive.open(members[name]) as content:
                arrays[name] = read_npy_stream(content, f"{name} in {file}", left, "U" if name in text else NUMBERS)
            left -= 0 if together is None else arrays[name].nbytes
        return arrays


def list_npz_names(file: Path) -> list[str]:
    """Names of the arrays of an archive. Raises InputError: it is no such archive."""
    with _open_npz(read_bytes(file), str(file)) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist()]


def read_npz_strings(data: bytes, where: str) -> list[str]:
    """All words that the arrays of an archive hold; arrays of numbers are not unpacked.
    Raises InputError: it is no such archive, is too large, or a member is no array of numbers or words."""
    words: list[str] = []
    with _open_npz(data, where) as archive:
        for name in archive.namelist():
            words.append(name)
            with archive.open(name) as content:
                kind = _read_array_header(content, where)[2]
            if kind.kind not in NUMBERS:
                with archive.open(name) as content:
                    words += map(str, read_npy_stream(content, f"{name} in {where}", MOST_TEXT, "U").ravel())
    return words


@contextmanager
def _convert_read_errors_to_input_error(where: str, what: str, writer: str) -> Generator[None]:
    """Convert all errors of numpy and zipfile to an InputError."""
    try:
        yield
    except InputError:
        raise
    except MALFORMED as error:
        reason = str(error)[:200] or type(error).__name__
        raise InputError(f"{where} is not a readable {what}: {reason}", f"write it with {writer}") from error


@contextmanager
def _open_npz(data: bytes, where: str) -> Generator[zipfile.ZipFile]:
    """An archive of a bounded number of arrays."""
    with (
        _convert_read_errors_to_input_error(where, ".npz", "numpy.savez"),
        open_zip(BytesIO(data), where, _MOST_DIRECTORY) as archive,
    ):
        count = len(archive.namelist())
        if count > MOST_MEMBERS:
            raise InputError(f"{where} holds {count} arrays, more than {MOST_MEMBERS}", "leave the others out")
        for member in archive.infolist():
            check_zip_compression(member, where)
        yield archive


def _read_array_header(content: IO[bytes], where: str) -> "tuple[tuple[int, ...], bool, np.dtype[Any]]":
    """Shape, column-major flag and kind from the header."""
    version = npy.read_magic(content)
    read_header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
    if read_header is None:
        raise InputError(f"{where} is of .npy version {version[0]}.{version[1]}", "write it with numpy.save")
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # of a header that Python 2 wrote
        return read_header(BoundedReader(content, where, _MOST_HEADER))


def read_npy_stream(content: IO[bytes], where: str, most: int = MOST_BYTES, allowed: str = NUMBERS) -> Numbers:
    """Read an array of at most ``most`` bytes, of the kinds ``allowed``. Raises InputError: as `read_npy`."""
    with _convert_read_errors_to_input_error(where, "array", "numpy.save"):
        shape, column_major, kind = _read_array_header(content, where)
        if kind.kind not in allowed or kind.itemsize > (8 if allowed == NUMBERS else MOST_WORD):
            remedy = "write it as integers or floats" if allowed == NUMBERS else "write it as words"
            raise InputError(f"{where} holds values of type {kind}", remedy)
        if min(shape, default=1) < 0:
            raise InputError(f"{where} has the shape {shape}", "write it with numpy.save")
        size = math.prod(shape) * kind.itemsize
        if size > most:
            raise InputError(
                f"{where} has the shape {shape} and type {kind}: more than {most} bytes", "give a smaller one"
            )
        if size == 0:
            raise InputError(f"{where} has the shape {shape}: it is empty", "write it with its values")
        data = content.read(size)
        if len(data) != size:
            raise InputError(f"{where} ends after {len(data)} of {size} bytes", "write it again with numpy.save")
        array = np.frombuffer(data, kind).reshape(shape, order="F" if column_major else "C")
        return cast(Numbers, array.astype(kind.newbyteorder("="), copy=False))
