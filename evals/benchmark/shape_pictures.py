"""Pictures of reconstructed shapes: the photo, the mesh from the photo's camera, and the mesh from aside."""

from collections.abc import Sequence

import cv2
import numpy as np

from evals.benchmark.contact_sheet import write_words
from grs_agents.base.geometry.raster import barycentric_coordinates, rasterise_triangles
from grs_agents.base.geometry.transforms import rotation_about_z
from grs_agents.perception.shapes.types import ObjectMesh, ObjectView
from grs_agents.perception.types import Array, Image

_TILE = 200
_BACK = (56, 56, 60)
ASIDE = np.deg2rad(40)


def draw_mesh(
    mesh: ObjectMesh, focal: float, center: tuple[float, float], pose: Array, size: tuple[int, int]
) -> tuple[Image, Array]:
    """Colours (h, w, 3) and depth (h, w), m, 0 where there is nothing, of a mesh before a camera.

    Args:
        focal, center: of the camera, pixels.
        pose: (4, 4) from the camera frame to the object frame.
        size: height and width of the picture.
    """
    local = (mesh.vertices - pose[:3, 3]) @ pose[:3, :3]
    depth = np.maximum(local[:, 2], 1e-3)
    flat = local[:, :2] / depth[:, None] * focal + center
    buffer = rasterise_triangles(flat[mesh.faces], (1 / depth)[mesh.faces], size[1], size[0])
    shown = buffer.triangle >= 0
    away = np.where(shown, 1 / np.where(shown, buffer.nearness, 1), 0.0)
    rows, columns = np.nonzero(shown)
    rays = np.stack([(columns - center[0]) / focal, (rows - center[1]) / focal, np.ones(len(rows))], axis=1)
    triangle = mesh.faces[buffer.triangle[shown]]
    points = np.asarray(rays * away[shown, None], np.float64)
    weights = barycentric_coordinates(points, local[triangle])
    uvs = np.einsum("ij,ijk->ik", weights, mesh.uvs[triangle])
    height, width = mesh.texture.shape[:2]
    x, y = uvs[:, 0] * width - 0.5, (1 - uvs[:, 1]) * height - 0.5
    texture = np.pad(mesh.texture, ((1, 1), (1, 1), (0, 0)), mode="edge")
    picture = np.empty((*size, 3), np.uint8)
    picture[:] = _BACK
    picture[shown] = _bilinear(texture, x + 1, y + 1)
    return picture, away


def _bilinear(texture: Image, x: Array, y: Array) -> Image:
    x, y = np.clip(x, 0, texture.shape[1] - 1.001), np.clip(y, 0, texture.shape[0] - 1.001)
    column, row = x.astype(int), y.astype(int)
    right, down = (x - column)[:, None], (y - row)[:, None]
    top = texture[row, column] * (1 - right) + texture[row, column + 1] * right
    bottom = texture[row + 1, column] * (1 - right) + texture[row + 1, column + 1] * right
    return (top * (1 - down) + bottom * down).astype(np.uint8)


def shape_row(view: ObjectView, mesh: ObjectMesh | None, words: str) -> Image:
    """An object: the photo with the mask's outline, the mesh, and the mesh rotated by 40 and by 140 degrees."""
    rows, columns = np.nonzero(view.mask)
    middle = np.array([(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2])
    side = 1.25 * max(np.ptp(columns), np.ptp(rows), 20)
    scale = _TILE / side
    shift = np.array([[scale, 0, _TILE / 2 - scale * middle[0]], [0, scale, _TILE / 2 - scale * middle[1]]])
    photo = np.asarray(cv2.warpAffine(view.rgb, shift, (_TILE, _TILE), flags=cv2.INTER_LINEAR), np.uint8)
    mask = np.asarray(cv2.warpAffine(view.mask.astype(np.uint8), shift, (_TILE, _TILE)), np.uint8)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outlined = np.asarray(cv2.drawContours(photo.copy(), outlines, -1, (255, 0, 255), 1), np.uint8)
    tiles = [outlined]
    if mesh is not None:
        camera = view.intrinsics
        center = (camera.cx * scale + shift[0, 2], camera.cy * scale + shift[1, 2])
        for angle in (0.0, ASIDE, 3.5 * ASIDE):
            turned = view.T_object_cam.copy()
            about = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
            turn = rotation_about_z(float(angle))
            turned[:3, :3] = turn @ turned[:3, :3]
            turned[:3, 3] = turn @ (turned[:3, 3] - about) + about
            tiles.append(draw_mesh(mesh, camera.fx * scale, center, turned, (_TILE, _TILE))[0])
    while len(tiles) < 4:
        tiles.append(np.full((_TILE, _TILE, 3), _BACK, np.uint8))
    bar = np.full((18, 4 * _TILE, 3), 255, np.uint8)
    return np.concatenate([write_words(bar, words, (4, 13), 0.4), np.concatenate(tiles, axis=1)])


def join_rows(rows: Sequence[Image], across: int) -> Image:
    """Rows of equal size, ``across`` side by side."""
    blank = np.full_like(rows[0], 255)
    padded = [*rows, *[blank] * (-len(rows) % across)]
    return np.concatenate(
        [np.concatenate(padded[start : start + across], axis=1) for start in range(0, len(padded), across)]
    )
