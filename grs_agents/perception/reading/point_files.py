"""Points as records of named numbers: what PLY and PCD have in common."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError

Points = npt.NDArray[np.float32]
MOST_POINTS = 20_000_000
MOST_FIELDS = 64
MOST_HEADER_BYTES = 65_536


@dataclass(frozen=True)
class Records:
    """How a file lays its points out.

    Attributes:
        where: what errors call the file.
        names: of the fields; each field is one number.
        kinds: numpy's type of each.
        count: how many points there are.
        shape: (rows, columns) of an organised cloud, else (1, count).
    """

    where: str
    names: Sequence[str]
    kinds: Sequence[str]
    count: int
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        """Refuse what cannot be points, or are too many, before anything is read.

        Raises:
            InputError: x, y or z is missing or twice there, or the counts are out of bounds or do not agree.
        """
        if not 0 < self.count <= MOST_POINTS:
            raise InputError(f"{self.where} promises {self.count} points", f"give 1 to {MOST_POINTS}")
        if len(self.names) > MOST_FIELDS:
            raise InputError(f"{self.where} has {len(self.names)} fields, more than {MOST_FIELDS}", "leave some out")
        if any(list(self.names).count(axis) != 1 for axis in "xyz"):
            fields = ", ".join(name[:20] for name in self.names)
            raise InputError(f"{self.where} has the fields {fields}", "give each of x, y, z once")
        if self.shape[0] * self.shape[1] != self.count:
            raise InputError(
                f"{self.where} promises {self.count} points in {self.shape[0]} rows of {self.shape[1]}",
                "write it again",
            )

    @property
    def record(self) -> "np.dtype[Any]":
        """One point in a binary file."""
        return np.dtype([(f"f{number}", kind) for number, kind in enumerate(self.kinds)])

    @property
    def axes(self) -> list[int]:
        """Which fields are x, y and z."""
        return [list(self.names).index(axis) for axis in "xyz"]

    def of_text(self, text: bytes) -> Points:
        """The (N, 3) points of rows of written numbers.

        Raises:
            InputError: a row is missing or has another number of fields, or something is no number.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # no rows at all: said below
                rows = np.loadtxt(
                    BytesIO(text),
                    dtype=np.float32,
                    comments=None,
                    usecols=self.axes,
                    ndmin=2,
                    encoding="latin-1",
                    max_rows=self.count,
                )
        except (ValueError, OverflowError, IndexError) as error:
            raise InputError(f"{self.where}: {str(error)[:200]}", "write the cloud again") from error
        if len(rows) < self.count:
            raise InputError(f"{self.where} ends after {len(rows)} of {self.count} points", "write the cloud again")
        return rows

    def of_bytes(self, data: bytes) -> Points:
        """The (N, 3) points of binary records.

        Raises:
            InputError: the data end too early.
        """
        self._long_enough(len(data))
        table = np.frombuffer(data, self.record, self.count)
        return self._joined([table[f"f{axis}"] for axis in self.axes])

    def of_columns(self, data: bytes) -> Points:
        """The (N, 3) points of binary data that hold each field of all points in turn.

        Raises:
            InputError: the data end too early.
        """
        self._long_enough(len(data))
        sizes = [np.dtype(kind).itemsize for kind in self.kinds]
        starts = [sum(sizes[:axis]) * self.count for axis in self.axes]
        pairs = zip(self.axes, starts, strict=True)
        return self._joined([np.frombuffer(data, self.kinds[axis], self.count, start) for axis, start in pairs])

    def _long_enough(self, length: int) -> None:
        needed = self.count * self.record.itemsize
        if length < needed:
            raise InputError(f"{self.where} ends after {length} of {needed} bytes of points", "write the cloud again")

    @staticmethod
    def _joined(columns: "Sequence[npt.NDArray[Any]]") -> Points:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([column.astype(np.float32) for column in columns], axis=1)


def header_of(data: bytes, end: bytes, where: str) -> tuple[list[list[str]], bytes]:
    """The words of each header line, and what follows the line that begins with ``end``.

    Raises:
        InputError: there is no such line within `MOST_HEADER_BYTES`, or the header is no text.
    """
    lines: list[list[str]] = []
    start = 0
    while True:
        stop = data.find(b"\n", start, MOST_HEADER_BYTES)
        if stop < 0:
            raise InputError(f"{where} has no header that ends with {end.decode()}", "write the cloud again")
        line = data[start:stop].strip()
        start = stop + 1
        try:
            lines.append(line.decode("ascii").split())
        except UnicodeDecodeError as error:
            raise InputError(f"{where} has a header that is no text", "write the cloud again") from error
        if line.startswith(end):
            return lines, data[start:]


def whole(word: str, where: str) -> int:
    """A count in a header.

    Raises:
        InputError: it is no whole number.
    """
    if not (word.isascii() and word.isdigit() and len(word) < 16):
        raise InputError(f"{where}: {word[:40]!r} is not a number of things", "write the cloud again")
    return int(word)
