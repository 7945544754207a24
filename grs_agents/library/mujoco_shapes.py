"""Shapes of the library as MuJoCo geoms, for every model that is built of them."""

from pathlib import Path
from typing import Any

from grs_agents.library.shapes import Shape


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
        spec.add_mesh(name=name, file=str(mesh), scale=shape.size)
        geom.meshname = name
    return geom
