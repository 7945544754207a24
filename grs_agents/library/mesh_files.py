"""Meshes without a mesh library: OBJ files read and written, primitives as triangles, volume, area and inertia."""

import io
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import cache_until_modified
from grs_agents.library.shapes import Shape

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
_MAX_BYTES = 64_000_000
_NO_UV = -1
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_DIGITS: Final = re.compile("[0-9]+")


@cache_until_modified(512)
def read_vertices(path: Path) -> Floats:
    """The (N, 3) vertices of an OBJ file, in the file's own units; an `InputError` if it is no OBJ file."""
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(f"cannot read mesh {path}: {error.strerror}", "put the file there") from error
    if path.suffix.lower() != ".obj" or status.st_size > _MAX_BYTES:
        raise InputError(f"mesh {path.name} is not an .obj file below {_MAX_BYTES} bytes", "convert it to OBJ")
    try:
        rows = _find_rows(path.read_text(encoding="utf-8"), "v ")
        vertices = np.fromstring(" ".join(rows), sep=" ")
        if vertices.size != 3 * len(rows):  # there are colours beside the positions, or it is broken
            vertices = np.array([[float(word) for word in row.split()[:3]] for row in rows], dtype=np.float64)
        vertices = vertices.reshape(-1, 3)
    except (OSError, ValueError) as error:
        raise InputError(f"mesh {path} is not a valid OBJ: {error}", "export it again") from error
    if len(vertices) < 4 or not np.isfinite(vertices).all():
        raise InputError(f"mesh {path} has {len(vertices)} vertices or numbers not finite", "export it again")
    vertices.setflags(write=False)
    return vertices


def _find_rows(text: str, keyword: str) -> list[str]:
    """The lines that begin with a keyword, without the keyword."""
    return [line[len(keyword) :] for line in text.split("\n") if line.startswith(keyword)]


@dataclass(frozen=True)
class TriangleSoup:
    """The triangles of a mesh, in the file's own units."""

    corners: Floats  # (T, 3, 3) positions
    uvs: Floats  # (T, 3, 2) texture coordinates, origin at the picture's lower left; zeros if the file has none


@cache_until_modified(128)
def read_surface(path: Path) -> TriangleSoup:
    """The triangles of an OBJ file, polygons as fans; an `InputError` if it is no OBJ file or has no faces."""
    vertices = read_vertices(path)
    try:
        text = path.read_text(encoding="utf-8")
        uvs = _parse_uvs(text)
        faces = _parse_uniform_triangles(text, (len(vertices), len(uvs)))
        faces = _parse_faces_by_line(text, len(vertices)) if faces is None else faces
    except (OSError, ValueError, IndexError) as error:
        raise InputError(f"mesh {path} is not a valid OBJ: {error}", "export it again") from error
    # No coordinate is -1, the last: zeros.
    corners, coordinates = vertices[faces[:, :, 0]], np.concatenate([uvs, np.zeros((1, 2))])[faces[:, :, 1]]
    corners.setflags(write=False)
    coordinates.setflags(write=False)
    return TriangleSoup(corners, coordinates)


@cache_until_modified(4096)
def convex_mesh_volume(path: Path) -> float:
    """The volume in an OBJ file's convex mesh, in its own units cubed, for either orientation of its faces."""
    corners = read_surface(path).corners
    corners = corners - (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    return float(np.abs(np.linalg.det(corners)).sum()) / 6


def _parse_uvs(text: str) -> Floats:
    """(U, 2) texture coordinates in the order of the file; a third number of each is left out."""
    rows = _find_rows(text, "vt ")
    if not rows:
        return np.zeros((0, 2))
    numbers = np.fromstring(" ".join(rows), sep=" ")
    if numbers.size == 2 * len(rows):
        return numbers.reshape(-1, 2)
    return np.array([[float(word) for word in row.split()[:2]] for row in rows], dtype=np.float64).reshape(-1, 2)


def _parse_uniform_triangles(text: str, counts: tuple[int, int]) -> Ints | None:
    """(T, 3, 2) vertex and texture coordinate of each corner, if all faces are triangles with the same kinds of items
    and no negative indices, as in most files; None otherwise, or if an index is beyond ``counts``."""
    rows = _find_rows(text, "f ")
    words = " ".join(rows)
    kinds = words.partition(" ")[0].count("/") + 1
    corner = "/" * (kinds - 1)
    # Without digits only the slashes may be left: a sign, a dot or another kind of face shows.
    if (
        kinds > 3
        or _DIGITS.sub("", words) != " ".join([corner] * 3 * len(rows))
        or any(row.count(" ") != 2 for row in rows)
    ):
        return None
    numbers = np.fromstring(words.replace("/", " "), dtype=np.int64, sep=" ")
    if numbers.size != 3 * kinds * len(rows):
        return None
    named = numbers.reshape(-1, 3, kinds)[:, :, :2] - 1
    if named.min() < 0 or (named.max(axis=(0, 1)) >= counts[: named.shape[2]]).any():
        return None
    faces = np.full((len(rows), 3, 2), _NO_UV)
    faces[:, :, : named.shape[2]] = named
    return faces


def _parse_faces_by_line(text: str, count: int) -> Ints:
    """(T, 3, 2) as above for any OBJ; polygons as fans."""
    faces: list[list[tuple[int, int]]] = []
    uvs = 0
    for line in text.splitlines():
        if line.startswith("vt "):
            uvs += 1
        elif line.startswith("f "):
            polygon: list[tuple[int, int]] = []
            for word in line.split()[1:]:  # ``a``, ``a/b`` or ``a/b/c``
                first, second = [*word.split("/"), ""][:2]
                vertex = _resolve_obj_index(first, count)
                polygon.append((vertex, _resolve_obj_index(second, uvs) if second else _NO_UV))
            faces += [[polygon[0], *polygon[number : number + 2]] for number in range(1, len(polygon) - 1)]
    if not faces:
        raise ValueError("it has no faces")
    return np.array(faces, dtype=np.int64)


def _resolve_obj_index(word: str, count: int) -> int:
    """The index, from 0, of a number of an OBJ file; negative numbers count from the end."""
    number = int(word)
    index = number - 1 if number > 0 else count + number
    if not 0 <= index < count:
        raise ValueError(f"a face names item {number} of {count}")
    return index


_SECTIONS, _RINGS = 48, 24
_BOX = (
    *((1, 3, 0), (4, 1, 0), (0, 3, 2), (2, 4, 0), (1, 7, 3), (5, 1, 4)),
    *((5, 7, 1), (3, 7, 2), (6, 4, 2), (2, 7, 6), (6, 5, 4), (7, 5, 6)),
)
"""Corners of each triangle, counter-clockwise from outside; corner number 4x + 2y + z of the unit cube."""


def triangulate_primitive(shape: Shape) -> TriangleSoup:
    """The triangles of a primitive in its own frame (m), without texture coordinates."""
    if shape.kind == "box":
        cube = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        corners = (cube * np.asarray(shape.size))[np.array(_BOX)]
    elif shape.kind == "cylinder":
        radius, length = shape.size
        corners = _revolve_profile([(0.0, -length / 2), (radius, -length / 2), (radius, length / 2), (0.0, length / 2)])
    else:
        angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
        radius = shape.size[0]
        corners = _revolve_profile([(radius * float(np.cos(angle)), radius * float(np.sin(angle))) for angle in angles])
    return TriangleSoup(corners, np.zeros((len(corners), 3, 2)))


def _revolve_profile(profile: Sequence[tuple[float, float]]) -> Floats:
    """The solid (T, 3, 3) that a profile of (radius, z), from the lowest point to the highest, makes around z."""
    angles = np.arange(_SECTIONS) * 2 * np.pi / _SECTIONS
    x, y = np.cos(angles), np.sin(angles)
    rings = [np.stack([radius * x, radius * y, np.full(_SECTIONS, z)], axis=1) for radius, z in profile]
    lower = np.arange(_SECTIONS)
    ring = np.stack([lower, np.roll(lower, -1), np.roll(lower, -1) + _SECTIONS, lower + _SECTIONS], axis=1)
    quads = [ring + row * _SECTIONS for row in range(len(profile) - 1)]
    corners = np.concatenate(rings)[np.concatenate(quads)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return corners[areas > 1e-15]


def mesh_volume(vertices: Floats, faces: Ints) -> float:
    """m^3 of a closed mesh, of an open mesh as seen from its middle; negative for faces that look inwards."""
    return float(np.linalg.det((vertices - vertices.mean(axis=0))[faces]).sum()) / 6


def mesh_area(vertices: Floats, faces: Ints) -> float:
    """The area of a mesh's faces, m^2."""
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(crosses, axis=1).sum()) / 2


def box_inertia(size: Vec3, mass: float) -> Vec3:
    """The principal moments (kg m^2) of a solid box of extents ``size`` (m) about its centre."""
    x, y, z = size
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)


def format_obj_text(vertices: Floats, faces: Ints, uvs: Floats | None = None, uv_faces: Ints | None = None) -> str:
    """A mesh as Wavefront OBJ: ``vertices`` (V, 3), ``faces`` (F, 3); ``uv_faces`` (F, 3) count ``uvs`` (U, 2)."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in (vertices + 0.0).tolist()]
    if uvs is None or uv_faces is None:
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    else:
        lines += [f"vt {u:.5f} {v:.5f}" for u, v in (uvs + 0.0).tolist()]
        pairs = zip((faces + 1).tolist(), (uv_faces + 1).tolist(), strict=True)
        lines += [f"f {a}/{p} {b}/{q} {c}/{r}" for (a, b, c), (p, q, r) in pairs]
    return "\n".join([*lines, ""])


def encode_png(image: npt.NDArray[np.uint8]) -> bytes:
    """A picture (H, W, 3 or 4), RGB or RGBA, as the content of a PNG file."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", optimize=False)
    return buffer.getvalue()


def read_png_size(path: Path) -> tuple[int, int] | None:
    """Width and height that the header of a PNG file states, pixels, without decoding it; None of any other file."""
    try:
        with path.open("rb") as stream:
            head = stream.read(24)
    except OSError as error:
        raise InputError(f"cannot read texture {path}: {error.strerror}", "put the file there") from error
    if len(head) < 24 or not head.startswith(_PNG):
        return None
    width, height = struct.unpack(">II", head[16:])
    return width, height
