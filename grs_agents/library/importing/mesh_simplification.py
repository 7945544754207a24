"""Level of detail: fewer triangles, with a texture of their own.
Two faces of the simplified mesh share a square of texels, painted as the original mesh is there."""

import importlib
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.raster import barycentric_coordinates
from grs_agents.library.importing.types import AtlasMesh, Floats, Ints, sample_texture_colors

_NEAREST: Final = 4
_CHUNK: Final = 200_000
_MARGIN: Final = 1
"""Texels between the faces of a square, and around it."""


@dataclass(frozen=True)
class FaceSquares:
    """A texture in which two faces share a square of texels."""

    side: int  # of the texture, px
    uvs: Floats  # (F, 3, 2) texture coordinates of the corners, origin at the lower left
    face: Ints  # (T,) face of each texel that belongs to a face
    weights: Floats  # (T, 3) of the face's corners at the texel
    texel: Ints  # (T,) number of the texel, row by row


def lay_out_face_squares(count: int, edge: int) -> FaceSquares:
    """The places of ``count`` faces in a texture of about ``edge`` px."""
    columns = int(np.ceil(np.sqrt(-(-count // 2))))
    cell = max(2 * _MARGIN + 4, edge // columns)
    side = columns * cell
    index = np.arange(count)
    left, top = (index // 2 % columns) * cell, (index // 2 // columns) * cell
    inner = cell - 2 * _MARGIN - 2
    lower = np.array([[0, 0], [inner - 1, 0], [0, inner - 1]]) + _MARGIN
    upper = cell - 1 - lower
    texels = np.where((index % 2 == 0)[:, None, None], lower, upper) + np.stack([left, top], axis=1)[:, None]
    uvs = np.stack([(texels[:, :, 0] + 0.5) / side, 1 - (texels[:, :, 1] + 0.5) / side], axis=2)
    texel = np.arange(cell * cell, dtype=np.int64)
    x, y = texel % cell, texel // cell
    u, v = (x - _MARGIN) / (inner - 1), (y - _MARGIN) / (inner - 1)
    first = u + v <= (cell - 1 - 2 * _MARGIN) / (inner - 1)
    u, v = (np.where(first, w, (cell - 1 - xy - _MARGIN) / (inner - 1)) for w, xy in ((u, x), (v, y)))
    weights: Floats = np.clip(np.stack([1 - u - v, u, v], axis=1), 0, None)
    weights /= weights.sum(axis=1, keepdims=True)
    squares = np.arange(-(-count // 2))
    owner = (2 * squares[:, None] + np.where(first, 0, 1)).ravel()
    base = (squares // columns) * cell * columns * cell + (squares % columns) * cell
    where = (base[:, None] + y * columns * cell + x).ravel()
    real = owner < count
    return FaceSquares(side, uvs, owner[real], np.tile(weights, (len(squares), 1))[real], where[real])


def transfer_texture_to_mesh(old: AtlasMesh, vertices: Floats, faces: Ints, edge: int) -> AtlasMesh:
    """Bake the texture of the old mesh into a new texture of ``edge`` px, by nearest surface points."""
    squares = lay_out_face_squares(len(faces), edge)
    image = np.zeros((squares.side**2, 3), np.uint8)
    tree: Any = importlib.import_module("small_gicp").KdTree(old.vertices[old.faces].mean(axis=1))
    for start in range(0, len(squares.face), _CHUNK):
        part = slice(start, start + _CHUNK)
        points = np.einsum("ij,ijk->ik", squares.weights[part], vertices[faces[squares.face[part]]])
        # Colours at the places nearest to the points, among the faces whose middles are nearest.
        near = np.asarray(tree.batch_knn_search(points, _NEAREST)[0], np.int64).reshape(len(points), -1)
        best, chosen, at = np.full(len(points), np.inf), np.zeros(len(points), np.int64), np.zeros((len(points), 3))
        for rank in range(near.shape[1]):
            corners = old.vertices[old.faces[near[:, rank]]]
            with np.errstate(divide="ignore", invalid="ignore"):  # slivers give no weights, and are not chosen
                weights = np.clip(np.nan_to_num(barycentric_coordinates(points, corners)), 0, 1)
            weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
            away = np.linalg.norm(np.einsum("ij,ijk->ik", weights, corners) - points, axis=1)
            nearer = away < best
            best[nearer], chosen[nearer], at[nearer] = away[nearer], near[nearer, rank], weights[nearer]
        image[squares.texel[part]] = sample_texture_colors(old.image, np.einsum("ij,ijk->ik", at, old.uvs[chosen]))
    return AtlasMesh(vertices, faces, squares.uvs, image.reshape(squares.side, squares.side, 3))


_WORTH = 1.25
"""Times as many faces as there should be, from which on simplifying is worth a new texture."""


def simplify_mesh(vertices: Floats, faces: Ints, most: int) -> tuple[Floats, Ints]:
    """The mesh with about ``most`` faces; unchanged if it has no more or ``fast-simplification`` is not installed."""
    if len(faces) <= most:
        return vertices, faces
    try:
        tool: Any = importlib.import_module("fast_simplification")
    except ImportError:
        return vertices, faces
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    unit = ((vertices - low) / extent).astype(np.float32)
    points, triangles = tool.simplify(unit, faces.astype(np.int32), target_count=most)
    if len(triangles) < 4:
        return vertices, faces
    return np.asarray(points, np.float64) * extent + low, np.asarray(triangles, np.int64)


def simplify_textured_mesh(solid: AtlasMesh, most: int, edge: int) -> tuple[AtlasMesh, list[str]]:
    """The solid with about ``most`` faces and a texture of at most about ``edge`` px of its own, and notes."""
    count = len(solid.faces)
    if count <= _WORTH * most:
        return solid, []
    vertices, faces = simplify_mesh(solid.vertices, solid.faces, most)
    if len(faces) >= count:
        return solid, [f'{count} faces: fewer need pip install "grs-agents[assets]"']
    return transfer_texture_to_mesh(solid, vertices, faces, edge), [f"{count} faces became {len(faces)}"]
