"""Readers of PLY files (ASCII or binary) and PCD files (version 0.7: ASCII, binary or binary_compressed, which is LZF).

Both formats are records of named numbers. The readers of other libraries trust a header that promises gigabytes.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import read_bytes

Points = npt.NDArray[np.float32]
MOST_POINTS = 20_000_000
MOST_FIELDS = 64
MOST_HEADER_BYTES = 65_536
MOST_UNPACKED = 1 << 28  # bytes of an unpacked cloud: enough for 16 million points with a colour
LONGEST_LITERAL = 32


def _corrupt_file_error(message: str) -> InputError:
    return InputError(message, "write the cloud again")


@dataclass(frozen=True)
class Records:
    """Layout of the points in a file."""

    where: str  # name of the file in errors
    names: Sequence[str]  # of the fields; each field is a single number
    kinds: Sequence[str]  # numpy's type of each
    count: int  # of points
    shape: tuple[int, int]  # (rows, columns) of an organised cloud, else (1, count)

    def __post_init__(self) -> None:
        """Refuse records without x, y and z, or with too many points, before reading."""
        if not 0 < self.count <= MOST_POINTS:
            raise InputError(f"{self.where} promises {self.count} points", f"give 1 to {MOST_POINTS}")
        if len(self.names) > MOST_FIELDS:
            raise InputError(f"{self.where} has {len(self.names)} fields, more than {MOST_FIELDS}", "leave some out")
        if any(list(self.names).count(axis) != 1 for axis in "xyz"):
            fields = ", ".join(name[:20] for name in self.names)
            raise InputError(f"{self.where} has the fields {fields}", "give each of x, y, z once")
        rows, columns = self.shape
        if rows * columns != self.count:
            raise _corrupt_file_error(f"{self.where} promises {self.count} points in {rows} rows of {columns}")

    @property
    def point_dtype(self) -> "np.dtype[Any]":
        """Type of a point in a binary file."""
        return np.dtype([(f"f{number}", kind) for number, kind in enumerate(self.kinds)])

    @property
    def xyz_field_indices(self) -> list[int]:
        """Indices of the fields x, y and z."""
        return [list(self.names).index(axis) for axis in "xyz"]

    def parse_text_points(self, text: bytes) -> Points:
        """The (N, 3) points of lines of numbers."""
        try:
            with warnings.catch_warnings(action="ignore", category=UserWarning):  # no rows at all: refused below
                lines, axes, most = BytesIO(text), self.xyz_field_indices, self.count
                rows = np.loadtxt(lines, np.float32, None, usecols=axes, ndmin=2, encoding="latin-1", max_rows=most)
        except (ValueError, OverflowError, IndexError) as error:
            raise _corrupt_file_error(f"{self.where}: {str(error)[:200]}") from error
        if len(rows) < self.count:
            raise _corrupt_file_error(f"{self.where} ends after {len(rows)} of {self.count} points")
        return rows

    def parse_binary_points(self, data: bytes, by_field: bool = False) -> Points:
        """The (N, 3) points of binary records, or of field-by-field (structure of arrays) data."""
        needed = self.count * self.point_dtype.itemsize
        if len(data) < needed:
            raise _corrupt_file_error(f"{self.where} ends after {len(data)} of {needed} bytes of points")
        if by_field:
            starts = np.cumsum([0, *(self.count * np.dtype(kind).itemsize for kind in self.kinds)])
            columns = [
                np.frombuffer(data, self.kinds[axis], self.count, int(starts[axis])) for axis in self.xyz_field_indices
            ]
        else:
            table = np.frombuffer(data, self.point_dtype, self.count)
            columns = [table[f"f{axis}"] for axis in self.xyz_field_indices]
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([column.astype(np.float32) for column in columns], axis=1)


def split_header(data: bytes, end: bytes, where: str) -> tuple[list[list[str]], bytes]:
    """The words of each header line, and the data after the line that begins with ``end``."""
    lines: list[list[str]] = []
    start = 0
    while (stop := data.find(b"\n", start, MOST_HEADER_BYTES)) >= 0:
        line = data[start:stop].strip()
        start = stop + 1
        try:
            lines.append(line.decode("ascii").split())
        except UnicodeDecodeError as error:
            raise _corrupt_file_error(f"{where} has a header that is no text") from error
        if line.startswith(end):
            return lines, data[start:]
    raise _corrupt_file_error(f"{where} has no header that ends with {end.decode()}")


def _parse_header_count(word: str, where: str) -> int:
    """A count in a header."""
    if not (word.isascii() and word.isdigit() and len(word) < 16):
        raise _corrupt_file_error(f"{where}: {word[:40]!r} is not a number of things")
    return int(word)


PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_PLY_TYPE_NAMES = {
    "i1": ("char", "int8"),
    "u1": ("uchar", "uint8"),
    "i2": ("short", "int16"),
    "u2": ("ushort", "uint16"),
    "i4": ("int", "int32"),
    "u4": ("uint", "uint32"),
    "f4": ("float", "float32"),
    "f8": ("double", "float64"),
}
PLY_TYPES = {name: kind for kind, names in _PLY_TYPE_NAMES.items() for name in names}


def read_ply(file: Path) -> tuple[Points, tuple[int, int]]:
    """The (N, 3) points of a PLY file, and (1, N), as PLY clouds are unorganised."""
    data, where = read_bytes(file), str(file)
    if not data.startswith(b"ply"):
        raise InputError(f"{where} does not begin with 'ply'", "give a PLY file")
    lines, body = split_header(data, b"end_header", where)
    order, elements = _parse_ply_header(lines, where)
    if "vertex" not in elements:
        raise InputError(f"{where} has no element vertex", "give a PLY file with points")
    first = next(iter(elements))
    if first != "vertex":
        raise InputError(f"{where} has {first[:40]!r} before its vertices", "write the vertices first")
    count, fields = elements["vertex"]
    records = Records(where, [name for name, _ in fields], [order + kind for _, kind in fields], count, (1, count))
    return (records.parse_binary_points(body) if order else records.parse_text_points(body)), records.shape


def _parse_ply_header(lines: list[list[str]], where: str) -> tuple[str, dict[str, tuple[int, list[tuple[str, str]]]]]:
    """The byte order (empty for text), and the count and fields (name, type) of each element."""
    order: str | None = None
    elements: dict[str, tuple[int, list[tuple[str, str]]]] = {}
    last = ""
    for words in lines:
        match words:
            case ["format", name, *_] if name in PLY_FORMATS:
                order = PLY_FORMATS[name]
            case ["element", last, count] if last not in elements:
                elements[last] = (_parse_header_count(count, where), [])
            case ["property", kind, name] if elements and kind in PLY_TYPES:
                elements[last][1].append((name, PLY_TYPES[kind]))
            case ["property", "list", *_] if elements and last != "vertex":
                pass
            case ["ply" | "comment" | "obj_info" | "end_header", *_] | []:
                pass
            case _:
                raise _corrupt_file_error(f"{where} has the header line {' '.join(words)[:80]!r}")
    if order is None:
        raise InputError(f"{where} does not say its format", f"write it as {' or '.join(PLY_FORMATS)}")
    return order, elements


def decompress_lzf(data: bytes, size: int, where: str) -> bytes:
    """Decompress LZF data to ``size`` bytes; ``where`` names the file in errors.

    A control byte below 32 precedes a literal of that length + 1. Any other holds a length in its upper three bits (7:
    the next byte is added) and, with the byte after it, the distance of a back reference."""
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
        raise _corrupt_file_error(f"{where} cannot be unpacked: {len(out)} of {size} bytes came out")
    return bytes(out)


PCD_TYPES = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}


def read_pcd(file: Path) -> tuple[Points, tuple[int, int]]:
    """The (N, 3) points of a PCD file, and the cloud's rows and columns: (1, N) if unorganised."""
    data, where = read_bytes(file), str(file)
    lines, body = split_header(data, b"DATA", where)
    header = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    records = _parse_pcd_header(header, where)
    match header["DATA"]:
        case ["ascii"]:
            return records.parse_text_points(body), records.shape
        case ["binary"]:
            return records.parse_binary_points(body), records.shape
        case ["binary_compressed"]:
            packed, size = (int.from_bytes(body[start : start + 4], "little") for start in (0, 4))
            needed = records.count * records.point_dtype.itemsize
            if size != needed or len(body) < 8 + packed:
                promise = f"{where} promises {size} bytes of points from {packed}"
                raise _corrupt_file_error(f"{promise}, has {len(body)} and needs {needed}")
            if size > MOST_UNPACKED:
                message = f"{where} promises {size} bytes of points, more than {MOST_UNPACKED}"
                raise InputError(message, "write it as binary")
            return records.parse_binary_points(
                decompress_lzf(body[8 : 8 + packed], size, where), by_field=True
            ), records.shape
        case other:
            message = f"{where} has DATA {' '.join(other)[:40]}"
            raise InputError(message, "write it as ascii, binary or binary_compressed")


def _parse_pcd_header(header: dict[str, list[str]], where: str) -> Records:
    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "DATA"):
        if not header.get(key):
            raise InputError(f"{where} has no {key} in its header", "write it as PCD version 0.7")
    fields, sizes, types = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = [_parse_header_count(word, where) for word in header.get("COUNT", ["1"] * len(fields))]
    if len({len(fields), len(sizes), len(types), len(counts)}) != 1 or sum(counts) > MOST_FIELDS:
        raise InputError(
            f"{where}: FIELDS, SIZE, TYPE and COUNT name {len(fields)}, {len(sizes)}, {len(types)} and {len(counts)} "
            f"fields of {sum(counts)} numbers",
            f"give one of each for every field, at most {MOST_FIELDS} numbers",
        )
    names: list[str] = []
    kinds: list[str] = []
    for name, size, kind, count in zip(fields, sizes, types, counts, strict=True):
        if size not in PCD_TYPES.get(kind, ()):
            raise InputError(f"{where}: field {name[:40]} has TYPE {kind[:8]} of SIZE {size[:8]}", "write F 4 or F 8")
        names += [name] if count == 1 else [f"{name}[{number}]" for number in range(count)]
        kinds += [f"<{kind.lower()}{size}"] * count
    columns, rows = _parse_header_count(header["WIDTH"][0], where), _parse_header_count(header["HEIGHT"][0], where)
    points = _parse_header_count(header["POINTS"][0], where) if header.get("POINTS") else rows * columns
    return Records(where, names, kinds, points, (rows, columns))
