"""The points of a PCD file (Point Cloud Library, version 0.7): ASCII, binary or binary_compressed."""

from pathlib import Path

from grs_agents.errors import InputError
from grs_agents.foreign import read_bytes
from grs_agents.perception.reading.lzf import unpacked
from grs_agents.perception.reading.point_files import MOST_FIELDS, Points, Records, header_of, whole

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
    records = _declared(header, where)
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


def _declared(header: dict[str, list[str]], where: str) -> Records:
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
