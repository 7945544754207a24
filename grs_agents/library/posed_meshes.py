"""The triangles of placed library objects, ready to be drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.library.asset_rendering import build_textured_triangles, triangulate_shape
from grs_agents.library.library import Library
from grs_agents.library.shapes import Placement, matrix_from_quaternion

Floats = npt.NDArray[np.float64]
_PLAIN: Vec3 = (0.6, 0.6, 0.6)
_SMOOTH = 0.7
"""Cosine of the smoothing angle: faces that turn by less look like a bent surface."""


@dataclass(frozen=True)
class Triangles:
    """A soup of textured triangles."""

    corners: Floats  # (T, 3, 3) m, robot frame
    normals: Floats  # (T, 3, 3) unit normals at the corners
    uvs: Floats  # (T, 3, 2) texture coordinates
    colors: Floats  # (T, 3) red, green, blue in 0..1, used if ``texture`` is -1
    texture: npt.NDArray[np.int64]  # (T,) index into ``textures``
    owner: npt.NDArray[np.int64]  # (T,) 1 for the first placed object, and so on
    textures: tuple[npt.NDArray[np.uint8], ...]  # (H, W, 3) RGB images


def build_posed_triangles(posed: Sequence[tuple[str, Placement]], library: Library) -> Triangles:
    """All visible triangles of assets, each with its pose in the robot frame; the ``owner`` of the first asset is 1."""
    parts: list[tuple[Floats, Floats, Floats, Floats, npt.NDArray[np.int64], int]] = []
    textures: list[npt.NDArray[np.uint8]] = []
    for owner, (asset, (centre, quaternion)) in enumerate(posed, start=1):
        turn = matrix_from_quaternion(quaternion)
        for shape in library.load_object_model(asset).visuals:
            painted = build_textured_triangles(library, [shape], _PLAIN)
            corners = painted.corners @ turn.T + centre
            index = np.where(painted.texture < 0, -1, painted.texture + len(textures))
            textures += painted.textures
            parts.append((corners, compute_smooth_normals(corners), painted.uvs, painted.colors, index, owner))
    return Triangles(
        corners=np.concatenate([part[0] for part in parts]),
        normals=np.concatenate([part[1] for part in parts]),
        uvs=np.concatenate([part[2] for part in parts]),
        colors=np.concatenate([part[3] for part in parts]),
        texture=np.concatenate([part[4] for part in parts]),
        owner=np.repeat([part[5] for part in parts], [len(part[0]) for part in parts]),
        textures=tuple(textures),
    )


def visual_triangle_corners(asset: str, library: Library) -> Floats:
    """(T, 3, 3) corners (m, its own frame) of the triangles that are seen of an asset."""
    visuals = library.load_object_model(asset).visuals
    return np.concatenate([triangulate_shape(shape, library).corners for shape in visuals])


def compute_smooth_normals(corners: Floats) -> Floats:
    """(T, 3, 3) normals at corners: the mean over the faces there that do not turn by much."""
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units = faces / np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), 1e-15)
    _, point = np.unique(np.round(corners.reshape(-1, 3) * 1e5).astype(np.int64), axis=0, return_inverse=True)
    sharing: dict[int, list[int]] = {}
    for corner, key in enumerate(point.ravel().tolist()):
        sharing.setdefault(key, []).append(corner // 3)
    normals = np.empty((len(corners) * 3, 3))
    for corner, key in enumerate(point.ravel().tolist()):
        around = np.array(sharing[key])
        near = around[units[around] @ units[corner // 3] > _SMOOTH]
        total = faces[near].sum(axis=0) if len(near) else units[corner // 3]
        normals[corner] = total / max(float(np.linalg.norm(total)), 1e-15)
    return normals.reshape(-1, 3, 3)
