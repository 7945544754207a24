"""The vertices of a mesh file, without a mesh library: what bounds need and no more."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError

_MAX_BYTES = 64_000_000


def read_vertices(path: Path) -> npt.NDArray[np.float64]:
    """The (N, 3) vertices of an OBJ file, in the file's own units.

    Raises:
        InputError: the file is not a readable OBJ with at least four finite vertices.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(f"cannot read mesh {path}: {error.strerror}", "put the file there") from error
    if path.suffix.lower() != ".obj" or status.st_size > _MAX_BYTES:
        raise InputError(f"mesh {path.name} is not an .obj file below {_MAX_BYTES} bytes", "convert it to OBJ")
    return _read(path, status.st_mtime_ns)


@lru_cache(maxsize=512)
def _read(path: Path, _modified: int) -> npt.NDArray[np.float64]:
    rows: list[list[float]] = []
    try:
        with path.open(encoding="utf-8") as lines:
            rows = [[float(word) for word in line.split()[1:4]] for line in lines if line.startswith("v ")]
        vertices = np.array(rows, dtype=np.float64).reshape(-1, 3)
    except (OSError, ValueError) as error:
        raise InputError(f"mesh {path} is not a valid OBJ: {error}", "export it again") from error
    if len(vertices) < 4 or not np.isfinite(vertices).all():
        raise InputError(f"mesh {path} has {len(vertices)} vertices or numbers not finite", "export it again")
    vertices.setflags(write=False)
    return vertices
