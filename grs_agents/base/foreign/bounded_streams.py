"""Untrusted packed files: the output of a decoder is counted as it comes, whatever a header declares.

Only stored and deflated data is unpacked. zlib returns at most the requested bytes; zipfile's decoders of bzip2 and
LZMA return the whole output of a chunk of input, possibly gigabytes for a few kilobytes.
"""

import gzip
import tarfile
import zipfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import IO, Any, Final, cast

from grs_agents.base.errors import InputError

_GZIP: Final = b"\x1f\x8b"
_MOST_TAR_HEADER: Final = 1 << 20
"""Bytes of all headers of a member of a tar file: long names and extended headers are chained before it."""
_MOST_TAR_RECORD: Final = 1 << 16
"""Bytes of each of these headers; a path has at most 4,096."""
_SKIPPED: Final = 1 << 16
_METHODS: Final = {zipfile.ZIP_STORED: "stored", zipfile.ZIP_DEFLATED: "deflate", 12: "bzip2", 14: "LZMA", 93: "zstd"}


class BoundedReader:
    """A stream of which at most ``most`` bytes are read; beyond them it raises InputError.

    It only reads: zipfile, which seeks, has its own stream.
    """

    def __init__(self, stream: IO[bytes], where: str, most: int) -> None:
        self._stream, self._where, self._left = stream, where, most
        self._most = most

    def read(self, size: int = -1) -> bytes:
        """At most ``size`` bytes, all that is left if it is negative."""
        if size > self._left:
            raise self._make_too_long_error()
        data = self._stream.read(self._left + 1 if size < 0 else size)
        self._left -= len(data)
        if self._left < 0:
            raise self._make_too_long_error()
        return data

    def _make_too_long_error(self) -> InputError:
        return InputError(f"{self._where} has a header of more than {self._most} bytes", "write it again")


class _ZipFileStream:
    """A zip file whose table of members has at most ``most`` bytes.

    zipfile reads that table in a single piece, makes an object of each entry, and counts them only afterwards.
    """

    def __init__(self, file: IO[bytes], where: str, most: int) -> None:
        self._file, self._where, self.most = file, where, most

    def read(self, size: int = -1) -> bytes:
        """As that of the file."""
        if self.most and size > self.most:
            message = f"{self._where} has a table of members of {size} bytes, more than {self.most}"
            raise InputError(message, "pack fewer files")
        return self._file.read(size)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@contextmanager
def open_zip(file: IO[bytes], where: str, most_directory: int) -> Generator[zipfile.ZipFile]:
    """The members of a zip file whose table has at most ``most_directory`` bytes; see each by `check_zip_compression`.

    Raises:
        InputError: the table is longer.
        zipfile.BadZipFile: it is no zip file.
    """
    stream = _ZipFileStream(file, where, most_directory)
    with zipfile.ZipFile(cast(IO[bytes], stream)) as archive:
        stream.most = 0
        yield archive


def check_zip_compression(member: zipfile.ZipInfo, where: str) -> None:
    """Refuse, by InputError, a member that is neither stored nor deflated."""
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        method = _METHODS.get(member.compress_type, f"method {member.compress_type}")
        message = f"{where} holds {member.filename[:120]!r}, packed by {method}"
        raise InputError(message, "pack it by deflate, as numpy.savez_compressed and zip do")


class _TarStream:
    """The content of a tar file, unpacked, from its beginning to its end: at most ``most`` bytes.

    tarfile reads a long name or an extended header in a single piece, whatever its size: while ``header_left`` counts,
    pieces and their sum are bounded.
    """

    def __init__(self, stream: IO[bytes], where: str, most: int) -> None:
        self._stream, self._where, self._most, self._position = stream, where, most, 0
        self.header_left: int | None = None

    def read(self, size: int = -1) -> bytes:
        """At most ``size`` bytes; ``size`` is never negative here."""
        if self.header_left is not None:
            self.header_left -= size
            if size > _MOST_TAR_RECORD or self.header_left < 0:
                most = _MOST_TAR_RECORD if size > _MOST_TAR_RECORD else _MOST_TAR_HEADER
                raise InputError(f"{self._where} has a header of more than {most} bytes", "pack it again")
        data = self._stream.read(size)
        self._position += len(data)
        if self._position > self._most:
            remedy = "unpack it yourself and name the folder"
            raise InputError(f"{self._where} unpacks to more than {self._most} bytes", remedy)
        return data

    def tell(self) -> int:
        """The bytes that were read or passed over."""
        return self._position

    def seek(self, position: int, whence: int = 0) -> int:
        """Skip to ``position``. Raises tarfile.ReadError: it lies behind, by a forged size."""
        if position < self._position or whence:
            raise tarfile.ReadError("a member has a negative size")
        header, self.header_left = self.header_left, None
        while self._position < position and self.read(min(_SKIPPED, position - self._position)):
            pass
        self.header_left = header
        return self._position


def iterate_tar_members(file: IO[bytes], where: str, most: int) -> Iterator[tuple[tarfile.TarInfo, IO[bytes] | None]]:
    """The members of a tar file, plain or packed by gzip, each with its content (None: no file).

    The content must be read before the next member is requested.

    Args:
        file: the file, at its beginning.
        where: its name in errors.
        most: bytes that it may unpack to, including headers and skipped members.

    Raises:
        InputError: it unpacks to more, or a header is too long.
            tarfile.TarError: it is no tar file. EOFError, OSError, ValueError and zlib.error likewise.
    """
    packed = file.read(len(_GZIP)) == _GZIP
    file.seek(0)
    unpacked = cast(IO[bytes], gzip.GzipFile(fileobj=file)) if packed else file
    stream = _TarStream(unpacked, where, most)
    stream.header_left = _MOST_TAR_HEADER
    archive: Any
    with tarfile.TarFile(fileobj=cast(IO[bytes], stream)) as archive:
        while (entry := archive.next()) is not None:
            stream.header_left = None
            yield entry, archive.extractfile(entry) if entry.isfile() else None
            archive.members.clear()  # tarfile keeps every member, with its name, for later look-ups
            archive.pax_headers.clear()  # headers of all members, which it copies for each
            stream.header_left = _MOST_TAR_HEADER
