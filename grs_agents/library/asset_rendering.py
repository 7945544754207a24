"""Software rendering of assets from given directions: a z-buffer with textures, no GL, no randomness. Matching and
description use these pictures: they are the same on every machine, unlike those of a graphics driver."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import cache_until_modified
from grs_agents.base.geometry.raster import barycentric_coordinates, rasterise_triangles
from grs_agents.library.colors import COLORS
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import TriangleSoup, read_surface, triangulate_primitive
from grs_agents.library.shapes import Shape, matrix_from_quaternion

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
_FINER: Final = 2
"""Supersampling: rows and columns of samples in a pixel."""
_AROUND: Final = 0.55
"""Share of the light that comes from everywhere; the rest comes from the camera."""
_TEXTURE_EDGE: Final = 1024
_MOST_PIXELS: Final = 64_000_000
_HORIZON: Final = (5.0, 65.0)
"""Degrees above the table from which random views look."""
RANDOM_VIEWS: Final = 3
RANDOM_VIEW_SIZE: Final = 384
"""Random views of each asset as in the paper, and their pixels each way."""
_FIELD_OF_VIEW: Final = np.deg2rad(30.0)
_RING_TILT: Final = float(np.deg2rad(25.0))
"""Elevation of a ring of views above the table, rad."""


@dataclass(frozen=True)
class AssetView:
    """Rendered view of an asset."""

    rgba: Image  # (H, W, 4) uint8 red, green, blue and coverage; not premultiplied, 0 in the background
    depth: npt.NDArray[np.float32]  # (H, W) float32 metres along the optical axis, 0 in the background
    direction: Vec3  # from the object's centre to the camera, unit length, object frame
    distance: float  # from the camera to the centre of the object's bounds, m
    focal: float  # focal length, px; the principal point is the centre, a pixel at depth z spans z / focal m


@dataclass(frozen=True)
class PaintedTriangles:
    """Coloured and textured triangles in a common frame."""

    corners: Floats  # (T, 3, 3) m
    uvs: Floats  # (T, 3, 2) texture coordinates, origin at the picture's lower left
    colors: Floats  # (T, 3) red, green, blue in 0..1; multiplied with the texture, if any
    texture: npt.NDArray[np.int64]  # (T,) index into ``textures``, -1 without texture
    textures: tuple[Image, ...]  # (H, W, 3) uint8 RGB


def random_view_directions(count: int, rng: np.random.Generator) -> tuple[Vec3, ...]:
    """Unit vectors from an object on a table towards cameras that look 5 to 65 degrees down at it, from all sides."""
    around = rng.uniform(-np.pi, np.pi, count)
    up = np.deg2rad(rng.uniform(*_HORIZON, count))
    return tuple(_direction_from_angles(float(a), float(b)) for a, b in zip(around, up, strict=True))


def ring_view_directions(count: int) -> tuple[Vec3, ...]:
    """Unit vectors towards ``count`` cameras evenly around, 25 degrees above the table; the first is +x."""
    return tuple(_direction_from_angles(2 * float(np.pi) * number / count, _RING_TILT) for number in range(count))


def render_random_views(library: Library, name: str) -> tuple[AssetView, ...]:
    """The random views of an asset that are kept and described, the same for the same name."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
    directions = random_view_directions(RANDOM_VIEWS, np.random.default_rng(seed))
    return render_asset_views(library, name, directions, size=RANDOM_VIEW_SIZE)


def render_asset_views(
    library: Library, name: str, directions: Sequence[Vec3], *, size: int = 224
) -> tuple[AssetView, ...]:
    """Render a square picture of an asset for each direction; the whole asset is in each.

    Args:
        library: of the asset.
        name: of the asset; a template is drawn with its defaults.
        directions: from the object's centre to the camera, object frame, any length but 0; z is up in the picture
            unless the camera looks along it, then x is.
        size: height and width, px.

    Raises:
        UnknownNameError: nothing has that name.
        InputError: its files are faulty, or the size is out of range.
    """
    if not 8 <= size <= 4096:
        raise InputError(f"views of {size} px", "ask for 8 to 4096 px")
    model = library.load_object_model(name)
    painted = build_textured_triangles(library, model.visuals or model.colliders, COLORS.get(library.asset(name).color))
    low, high = painted.corners.min(axis=(0, 1)), painted.corners.max(axis=(0, 1))
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    distance = 1.02 * radius / float(np.sin(_FIELD_OF_VIEW / 2))
    focal = size / 2 / float(np.tan(_FIELD_OF_VIEW / 2))
    return tuple(
        _render_asset_view(painted, (low + high) / 2, towards, distance, focal, size) for towards in directions
    )


def build_textured_triangles(library: Library, shapes: Sequence[Shape], plain: Vec3 | None = None) -> PaintedTriangles:
    """The triangles of shapes in the object frame; shapes without a colour are ``plain``, gray by default."""
    surfaces: list[TriangleSoup] = []
    colors: list[Floats] = []
    numbers: list[int] = []
    textures: list[Image] = []
    for shape in shapes:
        surfaces.append(triangulate_shape(shape, library))
        numbers.append(len(textures) if shape.texture else -1)
        textures += [read_texture(library.mesh_or_texture_path(shape.texture))] if shape.texture else []
        rgb = shape.color[:3] if shape.color else (1.0, 1.0, 1.0) if shape.texture else plain or COLORS["gray"]
        colors.append(np.asarray(rgb, dtype=np.float64))
    counts = [len(surface.corners) for surface in surfaces]
    return PaintedTriangles(
        corners=np.concatenate([surface.corners for surface in surfaces]),
        uvs=np.concatenate([surface.uvs for surface in surfaces]),
        colors=np.repeat(colors, counts, axis=0),
        texture=np.repeat(numbers, counts),
        textures=tuple(textures),
    )


def triangulate_shape(shape: Shape, library: Library) -> TriangleSoup:
    """The triangles of a shape in the object frame, m."""
    mesh = read_surface(library.mesh_or_texture_path(shape.mesh)) if shape.mesh else triangulate_primitive(shape)
    scale = np.asarray(shape.size) if shape.kind == "mesh" else np.ones(3)
    corners = mesh.corners * scale @ matrix_from_quaternion(shape.quaternion).T + shape.position
    return TriangleSoup(corners, mesh.uvs)


@cache_until_modified(64)
def read_texture(path: Path) -> Image:
    """A texture as (H, W, 3) uint8 RGB, its longer side at most 1024 px; an `InputError` if it is no picture."""
    from PIL import Image as Pictures

    try:
        with Pictures.open(path) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                raise InputError(f"texture {path.name} has {picture.width} x {picture.height} px", "make it smaller")
            plain = picture.convert("RGB")
            plain.thumbnail((_TEXTURE_EDGE, _TEXTURE_EDGE))
            return np.asarray(plain, dtype=np.uint8)
    except (OSError, ValueError, Pictures.DecompressionBombError) as error:
        raise InputError(f"texture {path} is no picture: {error}", "convert it to PNG") from error


def _direction_from_angles(around: float, up: float) -> Vec3:
    return (float(np.cos(up) * np.cos(around)), float(np.cos(up) * np.sin(around)), float(np.sin(up)))


def _render_asset_view(
    painted: PaintedTriangles, center: Floats, towards: Vec3, distance: float, focal: float, size: int
) -> AssetView:
    length = float(np.linalg.norm(towards))
    if not np.isfinite(length) or length < 1e-9:
        raise InputError(f"view direction {towards}", "give a vector that is not zero")
    direction, edge = np.asarray(towards, dtype=np.float64) / length, size * _FINER
    forward = -direction
    up = (0.0, 0.0, 1.0) if abs(float(direction[2])) < 0.999 else (1.0, 0.0, 0.0)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    local = (painted.corners - center) @ np.stack([right, np.cross(forward, right), forward]).T + (0.0, 0.0, distance)
    # Lit from the camera; corners in its frame: x right, y down, z forward and positive.
    fine_focal = focal * _FINER
    middle = (edge - 1) / 2
    places = local[:, :, :2] / local[:, :, 2:] * fine_focal + middle
    buffer = rasterise_triangles(places, 1 / local[:, :, 2], edge, edge)
    seen = buffer.triangle >= 0
    index, seen_depth = buffer.triangle[seen], 1 / buffer.nearness[seen]
    rows, columns = np.nonzero(seen)
    rays = np.ones((len(rows), 3))
    rays[:, :2] = (np.stack([columns, rows], axis=1) - middle) / fine_focal
    normals = np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 0])
    normals = (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))[index]
    facing = np.abs(np.einsum("ij,ij->i", normals, rays)) / np.sqrt(np.einsum("ij,ij->i", rays, rays))
    shade = _AROUND + (1 - _AROUND) * facing
    fine, deep = np.zeros((edge, edge, 4)), np.zeros((edge, edge))
    weights = np.zeros_like(rays)
    if painted.textures:
        weights = np.nan_to_num(barycentric_coordinates(rays * seen_depth[:, None], local[index]))
    fine[seen, :3] = sample_triangle_colors(painted, index, weights) * shade[:, None]
    fine[seen, 3], deep[seen] = 1.0, seen_depth
    x, y, z = direction.tolist()
    total = fine.reshape(size, _FINER, size, _FINER, 4).mean(axis=(1, 3))
    total[:, :, :3] /= np.maximum(total[:, :, 3:], 1e-9)  # the samples are premultiplied
    nearest = np.where(deep > 0, deep, np.inf).reshape(size, _FINER, size, _FINER).min(axis=(1, 3))
    depth = np.where(np.isfinite(nearest), nearest, 0).astype(np.float32)
    return AssetView(np.rint(np.clip(total, 0, 1) * 255).astype(np.uint8), depth, (x, y, z), distance, focal)


@dataclass(frozen=True)
class Lens:
    """A pinhole camera: focal lengths and principal point in px (the centre of pixel 0 is at 0), and its picture."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


def sample_triangle_colors(painted: PaintedTriangles, index: npt.NDArray[np.int64], weights: Floats) -> Floats:
    """(N, 3) colour, 0..1, of points on triangles ``index`` (N,), given by the weights (N, 3) of their corners."""
    colors = painted.colors[index].copy()
    for number, texture in enumerate(painted.textures):
        chosen = np.flatnonzero(painted.texture[index] == number)
        triangle = index[chosen]
        u, v = np.einsum("ij,ijk->ik", weights[chosen], painted.uvs[triangle]).T
        height, width = texture.shape[:2]
        columns = np.minimum((_wrap_texture_coordinates(u) * width).astype(np.int64), width - 1)
        rows = np.minimum(((1 - _wrap_texture_coordinates(v)) * height).astype(np.int64), height - 1)
        colors[chosen] *= texture[rows, columns] / 255
    return colors


def _wrap_texture_coordinates(values: Floats) -> Floats:
    """Texture coordinates repeat beyond 0..1; 1 itself is the far edge."""
    return np.where((values >= 0) & (values <= 1), values, values % 1)
