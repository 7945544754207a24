"""The triangles of placed library objects, ready to be drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_surface, triangulate_primitive
from grs_agents.library.shapes import Placement, Shape, matrix_from_quaternion

Floats = npt.NDArray[np.float64]
_PLAIN = (0.6, 0.6, 0.6, 1.0)


@dataclass(frozen=True)
class Triangles:
    """A soup of textured triangles."""

    corners: Floats  # (T, 3, 3) m, robot frame
    normals: Floats  # (T, 3, 3) unit normals at the corners
    uvs: Floats  # (T, 3, 2) texture coordinates
    colors: Floats  # (T, 3) red, green, blue in 0..1, used where ``texture`` is -1
    texture: npt.NDArray[np.int64]  # (T,) index into ``textures``
    owner: npt.NDArray[np.int64]  # (T,) 1 for the first placed object, and so on
    textures: tuple[npt.NDArray[np.uint8], ...]  # (H, W, 3) RGB images


def build_posed_triangles(posed: Sequence[tuple[str, Placement]], library: Library) -> Triangles:
    """All the visible triangles of assets, each with its pose in the robot frame; the first one's ``owner`` is 1."""
    parts: list[tuple[Floats, Floats, Floats, Floats, int, int]] = []
    textures: list[npt.NDArray[np.uint8]] = []
    for owner, (asset, (centre, quaternion)) in enumerate(posed, start=1):
        turn = matrix_from_quaternion(quaternion)
        for shape in library.load_object_model(asset).visuals:
            corners, uvs = _triangulate_shape(shape, library)
            corners = (corners @ matrix_from_quaternion(shape.quaternion).T + shape.position) @ turn.T + centre
            index = -1
            if shape.texture is not None:
                index = len(textures)
                textures.append(_read_texture_image(library, shape.texture))
            color = np.array(shape.color or _PLAIN)[:3]
            parts.append((corners, compute_smooth_normals(corners), uvs, color, index, owner))
    counts = [len(part[0]) for part in parts]
    return Triangles(
        corners=np.concatenate([part[0] for part in parts]),
        normals=np.concatenate([part[1] for part in parts]),
        uvs=np.concatenate([part[2] for part in parts]),
        colors=np.repeat([part[3] for part in parts], counts, axis=0),
        texture=np.repeat([part[4] for part in parts], counts),
        owner=np.repeat([part[5] for part in parts], counts),
        textures=tuple(textures),
    )


def visual_triangle_corners(asset: str, library: Library) -> Floats:
    """(T, 3, 3) corners (m, its own frame) of the triangles that are seen of an asset."""
    triangles = ((one, _triangulate_shape(one, library)[0]) for one in library.load_object_model(asset).visuals)
    placed = [corners @ matrix_from_quaternion(one.quaternion).T + one.position for one, corners in triangles]
    return np.concatenate(placed)


def compute_smooth_normals(corners: Floats, limit: float = 0.7) -> Floats:
    """(T, 3, 3) normals at corners: the mean over the faces there that turn by less than acos(``limit``)."""
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units = faces / np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), 1e-15)
    _, point = np.unique(np.round(corners.reshape(-1, 3) * 1e5).astype(np.int64), axis=0, return_inverse=True)
    sharing: dict[int, list[int]] = {}
    for corner, key in enumerate(point.ravel().tolist()):
        sharing.setdefault(key, []).append(corner // 3)
    normals = np.empty((len(corners) * 3, 3))
    for corner, key in enumerate(point.ravel().tolist()):
        around = np.array(sharing[key])
        near = around[units[around] @ units[corner // 3] > limit]
        total = faces[near].sum(axis=0) if len(near) else units[corner // 3]
        normals[corner] = total / max(float(np.linalg.norm(total)), 1e-15)
    return normals.reshape(-1, 3, 3)


def _read_texture_image(library: Library, name: str) -> npt.NDArray[np.uint8]:
    """An RGB image of the library."""
    image = cv2.imread(str(library.mesh_or_texture_path(name)))
    if image is None:
        raise InputError(f"texture {name} is not an image OpenCV can read", "write the library again")
    return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def _triangulate_shape(shape: Shape, library: Library) -> tuple[Floats, Floats]:
    """(T, 3, 3) corners in the shape's frame and (T, 3, 2) texture coordinates."""
    if shape.kind == "mesh":
        surface = read_surface(library.mesh_or_texture_path(shape.mesh or ""))
        return surface.corners * np.asarray(shape.size), surface.uvs
    surface = triangulate_primitive(shape)
    return surface.corners, surface.uvs
