"""Points of PLY files (ASCII or binary) and PCD files (version 0.7: ASCII, binary or binary_compressed, which is LZF).

Both are read as records of named numbers.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError
from grs_agents.foreign import read_bytes

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


FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
KINDS = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}


@dataclass
class _Element:
    name: str
    count: int
    names: list[str] = field(default_factory=list[str])
    kinds: list[str] = field(default_factory=list[str])


def read_ply(file: Path) -> tuple[Points, tuple[int, int]]:
    """The points of a PLY file.

    Returns:
        (N, 3) points, and (1, N), since PLY knows no rows.

    Raises:
        InputError: it cannot be read, or its header and body are not those of a cloud.
    """
    data = read_bytes(file)
    where = str(file)
    if not data.startswith(b"ply"):
        raise InputError(f"{where} does not begin with 'ply'", "give a PLY file")
    lines, body = header_of(data, b"end_header", where)
    order, elements = _declared(lines, where)
    vertex = next((element for element in elements if element.name == "vertex"), None)
    if vertex is None:
        raise InputError(f"{where} has no element vertex", "give a PLY file with points")
    if vertex is not elements[0]:
        raise InputError(f"{where} has {elements[0].name[:40]!r} before its vertices", "write the vertices first")
    kinds = [f"{order}{kind}" for kind in vertex.kinds]
    records = Records(where, vertex.names, kinds, vertex.count, (1, vertex.count))
    return (records.of_bytes(body) if order else records.of_text(body)), records.shape


def _declared(lines: list[list[str]], where: str) -> tuple[str, list[_Element]]:
    order: str | None = None
    elements: list[_Element] = []
    for words in lines:
        match words:
            case ["format", name, *_] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, count]:
                elements.append(_Element(name, whole(count, where)))
            case ["property", kind, name] if elements and kind in KINDS:
                elements[-1].names.append(name)
                elements[-1].kinds.append(KINDS[kind])
            case ["property", "list", *_] if elements and elements[-1].name != "vertex":
                pass
            case ["ply" | "comment" | "obj_info" | "end_header", *_] | []:
                pass
            case _:
                raise InputError(f"{where} has the header line {' '.join(words)[:80]!r}", "write the cloud again")
    if order is None:
        raise InputError(f"{where} does not say its format", f"write it as {' or '.join(FORMATS)}")
    return order, elements


LONGEST_LITERAL = 32


def unpacked(data: bytes, size: int, where: str) -> bytes:
    """``data`` unpacked.

    A control byte below 32 is followed by so many bytes, and one more, as they are. Any other holds a length in its
    upper three bits (7: the next byte is added) and, with the byte after it, how far back to copy from.

    Args:
        data: the packed bytes.
        size: how many come out.
        where: what errors call the file.

    Raises:
        InputError: other than ``size`` bytes come out, or it refers to what is not there.
    """
    out = bytearray()
    at, end = 0, len(data)
    while at < end and len(out) <= size:
        control = data[at]
        at += 1
        if control < LONGEST_LITERAL:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        if at + 1 + (control >> 5 == 7) > end:
            break
        length = (control >> 5) + 2
        if length == 9:
            length += data[at]
            at += 1
        start = len(out) - ((control & 31) << 8) - data[at] - 1
        at += 1
        if start < 0:
            break
        chunk = out[start : start + length]
        # What is copied may overlap what is being written: then it repeats itself.
        out += chunk if len(chunk) == length else (chunk * (length // len(chunk) + 1))[:length]
    if at != end or len(out) != size:
        raise InputError(f"{where} cannot be unpacked: {len(out)} of {size} bytes came out", "write the cloud again")
    return bytes(out)


MOST_UNPACKED = 1 << 28
"""No compressed cloud is larger unpacked, in bytes: enough for 16 million points with a colour."""
SIZES = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}


def read_pcd(file: Path) -> tuple[Points, tuple[int, int]]:
    """The points of a PCD file.

    Returns:
        (N, 3) points, and the cloud's rows and columns: (1, N) where it is not organised.

    Raises:
        InputError: it cannot be read, or its header and body are not those of a cloud.
    """
    data = read_bytes(file)
    where = str(file)
    lines, body = header_of(data, b"DATA", where)
    header = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    records = _declared_pcd(header, where)
    match header["DATA"]:
        case ["ascii"]:
            return records.of_text(body), records.shape
        case ["binary"]:
            return records.of_bytes(body), records.shape
        case ["binary_compressed"]:
            packed, size = (int.from_bytes(body[start : start + 4], "little") for start in (0, 4))
            if size != records.count * records.record.itemsize or len(body) < 8 + packed:
                raise InputError(
                    f"{where} promises {size} bytes of points from {packed}, has {len(body)} and needs "
                    f"{records.count * records.record.itemsize}",
                    "write the cloud again",
                )
            if size > MOST_UNPACKED:
                raise InputError(
                    f"{where} promises {size} bytes of points, more than {MOST_UNPACKED}", "write it as binary"
                )
            return records.of_columns(unpacked(body[8 : 8 + packed], size, where)), records.shape
        case other:
            raise InputError(
                f"{where} has DATA {' '.join(other)[:40]}", "write it as ascii, binary or binary_compressed"
            )


def _declared_pcd(header: dict[str, list[str]], where: str) -> Records:
    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "DATA"):
        if not header.get(key):
            raise InputError(f"{where} has no {key} in its header", "write it as PCD version 0.7")
    fields, sizes, types = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = [whole(word, where) for word in header.get("COUNT", ["1"] * len(fields))]
    if len({len(fields), len(sizes), len(types), len(counts)}) != 1 or sum(counts) > MOST_FIELDS:
        raise InputError(
            f"{where}: FIELDS, SIZE, TYPE and COUNT name {len(fields)}, {len(sizes)}, {len(types)} and {len(counts)} "
            f"fields of {sum(counts)} numbers",
            f"give one of each for every field, at most {MOST_FIELDS} numbers",
        )
    names: list[str] = []
    kinds: list[str] = []
    for name, size, kind, count in zip(fields, sizes, types, counts, strict=True):
        if size not in SIZES.get(kind, ()):
            raise InputError(f"{where}: field {name[:40]} has TYPE {kind[:8]} of SIZE {size[:8]}", "write F 4 or F 8")
        names += [name] if count == 1 else [f"{name}[{number}]" for number in range(count)]
        kinds += [f"<{kind.lower()}{size}"] * count
    columns, rows = whole(header["WIDTH"][0], where), whole(header["HEIGHT"][0], where)
    points = whole(header["POINTS"][0], where) if header.get("POINTS") else rows * columns
    return Records(where, names, kinds, points, (rows, columns))
