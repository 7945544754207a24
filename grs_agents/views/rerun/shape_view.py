"""Shapes of assets as rerun geometry."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr
import trimesh

from grs_agents.base import Pose
from grs_agents.errors import InputError
from grs_agents.foreign.pictures import read_picture
from grs_agents.library import Library, Shape
from grs_agents.library.mesh_files import read_surface
from grs_agents.library.shapes import rotation_matrix
from grs_agents.views.rerun.recording import Recording

TEXTURE_EDGE = 256
"""Pixels; larger textures are shown smaller to keep recordings small."""
_GREY = (0.7, 0.7, 0.72, 1.0)
Rgba = tuple[float, float, float, float]


def show_asset(recording: Recording, path: str, name: str, library: Library) -> None:
    """The library's asset ``name`` in its own frame, below ``path``."""
    model = library.model(name)
    for number, shape in enumerate(model.visuals or model.colliders):
        recording.log(f"{path}/{number}", geometry(shape, library, None))


def geometry(shape: Shape, library: Library, color: Rgba | None) -> rr.AsComponents:
    """``shape`` in the frame of its object.

    Args:
        shape: a box, cylinder, sphere or mesh.
        library: where its mesh and texture lie.
        color: rgba 0..1 laid over the shape's own, or None.
    """
    rgba = [round(255 * channel) for channel in color or shape.color or _GREY]
    where: dict[str, Any] = {"centers": [shape.position], "quaternions": [shape.quaternion], "colors": [rgba]}
    if shape.kind == "box":
        return rr.Boxes3D(sizes=[shape.size], fill_mode="solid", **where)
    if shape.kind == "sphere":
        return rr.Ellipsoids3D(half_sizes=[shape.size * 3], fill_mode="solid", **where)
    if shape.kind == "cylinder":
        radius, length = shape.size
        return rr.Cylinders3D(radii=[radius], lengths=[length], fill_mode="solid", **where)
    texture = library.mesh_path(shape.texture) if shape.texture and color is None else None
    pose = (shape.position, shape.quaternion)
    return _mesh(library.mesh_path(shape.mesh or ""), texture, shape.size, pose, color or shape.color)


@lru_cache(maxsize=64)
def _mesh(path: Path, texture_path: Path | None, scale: tuple[float, ...], pose: Pose, color: Rgba | None) -> rr.Mesh3D:
    """Kept, since an object's mesh is shown in the twin and in the rollouts; ``color`` is for what has no texture."""
    mesh = _load_mesh(path)
    turn = rotation_matrix(pose[1])
    vertices = np.asarray(mesh.vertices) * scale @ turn.T + pose[0]
    uv: npt.NDArray[np.float64] | None = getattr(mesh.visual, "uv", None)
    texture = texcoords = None
    if texture_path and uv is not None:
        texture = _load_texture(texture_path)
        texcoords = np.column_stack([uv[:, 0], 1 - uv[:, 1]])  # rerun's origin is the top left corner
    rgba = [round(255 * channel) for channel in (color if texture is None else None) or (1,) * 4]
    return rr.Mesh3D(
        vertex_positions=vertices,
        triangle_indices=np.asarray(mesh.faces),
        vertex_normals=_vertex_normals(mesh) @ turn.T,
        vertex_texcoords=texcoords if texture is not None else None,
        albedo_texture=texture,
        albedo_factor=rgba,
    )


@lru_cache(maxsize=128)
def _load_mesh(path: Path) -> Any:
    """The mesh of an OBJ file, one vertex for each of its texture coordinates.

    Raises:
        InputError: it is no mesh.
    """
    read_surface(path)  # its errors are named, trimesh's are of many kinds
    return trimesh.load_mesh(path, process=False, skip_materials=True)


def _vertex_normals(mesh: Any) -> npt.NDArray[np.float64]:
    """(N, 3) unit normals, weighted by area; trimesh's own want scipy."""
    faces = np.asarray(mesh.faces)
    corners = np.asarray(mesh.vertices, dtype=np.float64)[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(mesh.vertices), 3))
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


@lru_cache(maxsize=128)
def _load_texture(path: Path) -> Any:
    """HxWx3 uint8 red, green, blue; None where the file cannot be read, the mesh is then plain."""
    try:
        image = read_picture(path, cv2.IMREAD_COLOR)
    except InputError:
        return None
    scale = TEXTURE_EDGE / max(image.shape[:2])
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
