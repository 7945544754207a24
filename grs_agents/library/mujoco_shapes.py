"""Shapes of the library as MuJoCo geoms, for every model that is built of them."""

from collections import Counter
from pathlib import Path
from typing import Any, Final

from grs_agents.base.errors import InputError
from grs_agents.library.mesh_files import read_png_size
from grs_agents.library.shapes import Shape

MOST_TEXTURE_PIXELS: Final = 4096 * 4096
"""Largest texture of a file; scanned objects have textures of up to 4096 x 4096."""
MOST_PIXELS_OF_WORLD: Final = 4 * MOST_TEXTURE_PIXELS
"""Largest sum over the textures of a world, each counted as often as it is used: MuJoCo keeps every copy."""
_modified: dict[str, int] = {}


def name_current_file(path: Path) -> str:
    """The name of a mesh or texture as MuJoCo takes it.

    MuJoCo caches the files that it read, and misses a change within the same second. The cache is cleared for a file
    that has changed since it was last named.
    """
    from grs_agents.base.mujoco_import import mujoco  # takes long to import

    name, modified = str(path), path.stat().st_mtime_ns if path.is_file() else 0
    if _modified.setdefault(name, modified) != modified:
        mujoco.mj_clearCache(mujoco.mj_getCache())
        _modified[name] = modified
    return name


def add_shape_geom(spec: Any, body: Any, shape: Shape, name: str, mesh: Path | None = None) -> Any:
    """Add a shape to a body of a ``mujoco.MjSpec``; ``mesh`` is its file. Returns the geom, otherwise with defaults."""
    from grs_agents.base.mujoco_import import mujoco  # takes long to import

    x, y, z, w = shape.quaternion
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape.kind.upper()}")
    geom = body.add_geom(name=name, type=kind, pos=shape.position, quat=(w, x, y, z))
    if shape.kind == "box":
        geom.size = tuple(extent / 2 for extent in shape.size)
    elif shape.kind == "cylinder":
        geom.size = (shape.size[0], shape.size[1] / 2, 0.0)
    elif shape.kind == "sphere":
        geom.size = (shape.size[0], 0.0, 0.0)
    else:
        spec.add_mesh(name=name, file="" if mesh is None else name_current_file(mesh), scale=shape.size)
        geom.meshname = name
    return geom


def add_texture_file(spec: Any, name: str, path: Path) -> None:
    """Add a PNG file as a 2D texture to a ``mujoco.MjSpec``.

    Raises:
        InputError: the file, or all that were added to the spec, have more pixels than MuJoCo may decode.
    """
    from grs_agents.base.mujoco_import import mujoco  # takes long to import

    width, height = read_png_size(path) or (0, 0)
    if width * height > MOST_TEXTURE_PIXELS:
        message = f"texture {path} has {width}x{height} pixels, at most {MOST_TEXTURE_PIXELS}"
        raise InputError(message, "make it smaller")
    spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=name_current_file(path))
    # Files of an arm are relative to it, and counted with the arm's.
    files = Counter(file for texture in spec.textures if (file := Path(str(texture.file))).is_absolute())
    sizes = ((read_png_size(file) or (0, 0), count) for file, count in files.items())
    pixels = sum(width * height * count for (width, height), count in sizes)
    if pixels > MOST_PIXELS_OF_WORLD:
        message = f"with texture {path} those of the world have {pixels} pixels, at most {MOST_PIXELS_OF_WORLD}"
        raise InputError(message, "make them smaller, or take fewer")
