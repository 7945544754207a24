"""The triangles of a mesh file with their texture coordinates, without a mesh library."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError
from grs_agents.library.mesh_files import read_vertices

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
_NO_UV = -1


@dataclass(frozen=True)
class Surface:
    """The triangles of one mesh, in the file's own units.

    Attributes:
        corners: (T, 3, 3) positions.
        uvs: (T, 3, 2) texture coordinates, origin at the picture's lower left; zeros where the file has none.
    """

    corners: Floats
    uvs: Floats


def read_surface(path: Path) -> Surface:
    """The triangles of an OBJ file; polygons become fans.

    Raises:
        InputError: the file is not a readable OBJ, has no faces, or a face names a vertex that is not there.
    """
    vertices = read_vertices(path)
    return _read(path, path.stat().st_mtime_ns, len(vertices))


def solid_volume(path: Path) -> float:
    """The volume that an OBJ file's convex mesh encloses, in its own units cubed, whichever way its faces are turned.

    Of a mesh that is not convex it is about that of what can be seen from its middle.

    Raises:
        InputError: as `read_surface`.
    """
    return _volume(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=4096)
def _volume(path: Path, _modified: int) -> float:
    corners = read_surface(path).corners
    corners = corners - (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    return float(np.abs(np.linalg.det(corners)).sum()) / 6


@lru_cache(maxsize=128)
def _read(path: Path, _modified: int, count: int) -> Surface:
    vertices, uvs = read_vertices(path), list[tuple[float, float]]()
    faces: list[tuple[int, int, int]] = []
    face_uvs: list[tuple[int, int, int]] = []
    try:
        with path.open(encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("vt "):
                    u, v = line.split()[1:3]
                    uvs.append((float(u), float(v)))
                elif line.startswith("f "):
                    words = [_corner(word, count, len(uvs)) for word in line.split()[1:]]
                    for a, b, c in _fan(words):
                        faces.append((a[0], b[0], c[0]))
                        face_uvs.append((a[1], b[1], c[1]))
        coordinates = np.array([*uvs, (0.0, 0.0)], dtype=np.float64)
        index, index_uv = np.array(faces, dtype=np.int64).reshape(-1, 3), np.array(face_uvs, dtype=np.int64)
        if not len(index):
            raise ValueError("it has no faces")
        surface = Surface(vertices[index], coordinates[index_uv])
    except (OSError, ValueError, IndexError) as error:
        raise InputError(f"mesh {path} is not a valid OBJ: {error}", "export it again") from error
    surface.corners.setflags(write=False)
    surface.uvs.setflags(write=False)
    return surface


def _corner(word: str, vertices: int, uvs: int) -> tuple[int, int]:
    """Vertex and texture coordinate that ``a``, ``a/b`` or ``a/b/c`` names; negative numbers count from the end."""
    first, _, rest = word.partition("/")
    second = rest.partition("/")[0]
    return _index(first, vertices), _index(second, uvs) if second else _NO_UV


def _index(word: str, count: int) -> int:
    number = int(word)
    index = number - 1 if number > 0 else count + number
    if not 0 <= index < count:
        raise ValueError(f"a face names item {number} of {count}")
    return index


def _fan(words: list[tuple[int, int]]) -> Iterator[tuple[tuple[int, int], ...]]:
    return ((words[0], words[number], words[number + 1]) for number in range(1, len(words) - 1))
