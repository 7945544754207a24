"""Shapes of the library as MuJoCo geoms, for every model that is built of them."""

from pathlib import Path
from typing import Any

from grs_agents.library.shapes import Shape

_modified: dict[str, int] = {}


def name_current_file(path: Path) -> str:
    """The name of a mesh or texture as MuJoCo takes it.

    MuJoCo keeps the files that it read and takes one for unchanged that was written again within the same second. What
    it keeps is dropped where the file is another than when it was named last.
    """
    from grs_agents.mujoco_import import mujoco  # takes long to import

    name, modified = str(path), path.stat().st_mtime_ns if path.is_file() else 0
    if _modified.setdefault(name, modified) != modified:
        mujoco.mj_clearCache(mujoco.mj_getCache())
        _modified[name] = modified
    return name


def add_shape_geom(spec: Any, body: Any, shape: Shape, name: str, mesh: Path | None = None) -> Any:
    """Add a shape to a body of a ``mujoco.MjSpec``; ``mesh`` is its file. Returns the geom, otherwise with defaults."""
    from grs_agents.mujoco_import import mujoco  # takes long to import

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
