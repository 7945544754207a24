"""The vertices of a PLY file, ASCII or binary."""

from dataclasses import dataclass, field
from pathlib import Path

from grs_agents.errors import InputError
from grs_agents.foreign import read_bytes
from grs_agents.perception.reading.point_files import Points, Records, header_of, whole

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
