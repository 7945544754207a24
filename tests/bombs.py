"""Small files that stand for gigabytes, or for hours: what a stranger may send."""

import gzip
import io
import json
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

from numpy.lib import format as npy


def array_header(shape: tuple[int, ...], kind: str = "|u1") -> bytes:
    """The header of an array, without its values."""
    header = io.BytesIO()
    npy.write_array_header_1_0(header, {"descr": kind, "fortran_order": False, "shape": shape})
    return header.getvalue()


def zeros_npz(file: Path, name: str, method: int, header: bytes, megabytes: int) -> Path:
    """An archive whose array ``name`` has ``header`` and then zeros, packed by ``method`` of zipfile."""
    with zipfile.ZipFile(file, "w") as archive:
        member = zipfile.ZipInfo(f"{name}.npy")
        member.compress_type = method
        with archive.open(member, "w", force_zip64=True) as content:
            content.write(header)
            for _ in range(megabytes):
                content.write(bytes(1 << 20))
    return file


def long_header_npz(file: Path, name: str, megabytes: int) -> Path:
    """An archive whose array promises a header of 4 GB, in version 2.0, of which so much is there, as blanks."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(f"{name}.npy", "w") as content:
        content.write(b"\x93NUMPY\x02\x00" + struct.pack("<I", 0xFFFFFF00))
        for _ in range(megabytes):
            content.write(b" " * (1 << 20))
    return file


def many_members_npz(file: Path, count: int) -> Path:
    """An archive whose table of members alone is long."""
    entry = struct.pack("<4s4B4HL2L5H2L", b"PK\x01\x02", 20, 0, 20, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    table = entry * count
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, count & 0xFFFF, count & 0xFFFF, len(table), 0, 0)
    file.write_bytes(table + end)
    return file


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(file: Path, width: int, height: int, *, rows: int | None = None) -> Path:
    """A black RGB picture; ``rows`` that are there, where they are not as many as it says."""
    packer = zlib.compressobj(9)
    line = bytes(1 + 3 * width)
    data = b"".join([packer.compress(line) for _ in range(height if rows is None else rows)]) + packer.flush()
    head = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    chunks = _png_chunk(b"IHDR", head) + _png_chunk(b"IDAT", data) + _png_chunk(b"IEND", b"")
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)
    return file


def tiff(file: Path, width: int, height: int, unpacked_megabytes: int) -> Path:
    """A grey picture in one strip, deflated, that unpacks to more than its pixels."""
    packer = zlib.compressobj(9)
    head, again = (packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    check = ((unpacked_megabytes << 20) % 65521 << 16) | 1  # Adler-32 of zeros
    strip = head + again * (unpacked_megabytes - 1) + b"\3\0" + struct.pack(">I", check)
    entries = [
        *((256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (259, 3, 1, 8), (262, 3, 1, 1)),
        *((273, 4, 1, 200), (277, 3, 1, 1), (278, 4, 1, height), (279, 4, 1, len(strip))),
    ]
    table = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", *entry) for entry in entries) + bytes(4)
    file.write_bytes((b"II*\x00\x08\x00\x00\x00" + table).ljust(200, b"\0") + strip)
    return file


def _tar_header(name: bytes, size: int, kind: bytes) -> bytes:
    info = tarfile.TarInfo(name.decode())
    info.size, info.type = size, kind
    return info.tobuf(tarfile.GNU_FORMAT)


def _write_gzip(file: Path, pieces: Sequence[bytes]) -> Path:
    """A member of the file for each piece; equal pieces are packed once."""
    packed = {piece: gzip.compress(piece, 9) for piece in dict.fromkeys(pieces)}
    file.write_bytes(b"".join(packed[piece] for piece in pieces))
    return file


def long_names_tar(file: Path, count: int, length: int) -> Path:
    """A tar.gz of ``count`` empty files, each with a name of ``length`` letters in a header of its own."""
    name = b"a" * length + b"\0"
    header = _tar_header(b"././@LongLink", len(name), b"L") + name.ljust(-(-len(name) // 512) * 512, b"\0")
    return _write_gzip(file, [(header + _tar_header(b"a", 0, b"0")) * 16] * (count // 16))


def one_long_name_tar(file: Path, megabytes: int) -> Path:
    """A tar.gz with one name of so many megabytes."""
    pieces = [_tar_header(b"././@LongLink", megabytes << 20, b"L"), *[b"a" * (1 << 20)] * megabytes]
    return _write_gzip(file, [*pieces, _tar_header(b"a", 0, b"0"), bytes(1024)])


def passed_over_tar(file: Path, megabytes: int) -> Path:
    """A tar.gz with one file that nobody wants."""
    pieces = [_tar_header(b"a.iso", megabytes << 20, b"0"), *[bytes(1 << 20)] * megabytes]
    return _write_gzip(file, [*pieces, bytes(1024)])


def zip_of_zeros(file: Path, name: str, method: int, megabytes: int) -> Path:
    """A zip file with one file of zeros, packed by ``method`` of zipfile."""
    with zipfile.ZipFile(file, "w", method) as archive, archive.open(name, "w", force_zip64=True) as content:
        for _ in range(megabytes):
            content.write(bytes(1 << 20))
    return file


def gltf_of_many_points(file: Path, count: int) -> Path:
    """A glTF whose accessor has no bytes, which stands for so many zeros."""
    accessors = [
        {"componentType": 5126, "count": count, "type": "VEC3", "max": [0, 0, 0], "min": [0, 0, 0]},
        {"componentType": 5125, "count": count, "type": "SCALAR"},
    ]
    mesh = {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}
    scene = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [mesh]}
    file.write_text(json.dumps({**scene, "accessors": accessors}), "utf-8")
    return file
