"""Rendering of objects in a room: colours, exact depth, labels and materials, without a graphics library.

The same scene gives the same picture on every machine, which graphics drivers do not guarantee.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from evals.synthesis.scenery import Light, Scenery, bilinear, dot_products
from grs_agents.base.geometry.raster import Buffer, barycentric_coordinates, rasterise_triangles
from grs_agents.library.posed_meshes import Triangles
from grs_agents.perception.types import Camera

Floats = npt.NDArray[np.float64]
Labels = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]
_FINER = 2
_LARGE = 1_000_000
"""Pictures of more pixels are fine enough as they are."""
FARTHEST = 50.0
"""Depth (m) where the room is open."""
_GLOSS = 40.0


@dataclass(frozen=True)
class PerfectImage:
    """The noise-free picture.

    Attributes:
        rgb: (H, W, 3) red, green, blue in 0..1, antialiased unless the picture is large.
        depth: (H, W) m along the optical axis at the pixels' centres.
        labels: (H, W) 1 for the first object, and so on; 0 for the room.
        cosine: (H, W) of the angle of incidence, 1 = frontal.
        albedo: (H, W) of the surface, 0..1.
        shiny: (H, W) mask of specular surfaces.
    """

    rgb: Floats
    depth: Floats
    labels: Labels
    cosine: Floats
    albedo: Floats
    shiny: Bools


def draw_scene(triangles: Triangles, scenery: Scenery, camera: Camera, shiny: Sequence[int] = ()) -> PerfectImage:
    """Render objects in a room.

    Args:
        triangles: the objects.
        scenery: the room and its light.
        camera: with ``T_robot_cam``.
        shiny: labels of specular objects.
    """
    exact = _draw(triangles, scenery, camera, shiny)
    if camera.width * camera.height > _LARGE:
        return exact
    fine = _draw(triangles, scenery, upscaled(camera, _FINER), shiny)
    rgb = cv2.resize(fine.rgb, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return replace(exact, rgb=np.asarray(rgb, np.float64))


def upscaled(camera: Camera, times: int) -> Camera:
    """The same view with ``times`` as many pixels each way."""
    return camera.model_copy(
        update={
            "fx": camera.fx * times,
            "fy": camera.fy * times,
            "cx": (camera.cx + 0.5) * times - 0.5,
            "cy": (camera.cy + 0.5) * times - 0.5,
            "width": camera.width * times,
            "height": camera.height * times,
        }
    )


def unoccluded_mask(triangles: Triangles, camera: Camera) -> Bools:
    """Returns: mask (H, W) of the objects without occlusion."""
    return _rasterised(triangles, camera).triangle >= 0


def rays_of(camera: Camera) -> tuple[Floats, Floats]:
    """(H * W, 3) directions of unit length along the optical axis, and the camera's place (3,), robot frame."""
    pose = np.asarray(camera.T_robot_cam, np.float64)
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    local = [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(columns.shape)]
    x, y, z = (part.ravel() for part in local)
    turned = [x * row[0] + y * row[1] + z * row[2] for row in pose[:3, :3]]
    return np.stack(turned, axis=1), pose[:3, 3]


def triangles_of(triangles: Triangles, owner: int) -> Triangles:
    """The triangles of an object."""
    mine = triangles.owner == owner
    parts = {name: getattr(triangles, name)[mine] for name in ("corners", "normals", "uvs", "colors", "texture")}
    return replace(triangles, owner=triangles.owner[mine], **parts)


def join_triangles(first: Triangles, second: Triangles) -> Triangles:
    """Both, if the second triangles have no textures."""
    names = ("corners", "normals", "uvs", "colors", "texture", "owner")
    return replace(first, **{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in names})


def _rasterised(triangles: Triangles, camera: Camera) -> Buffer:
    pose = np.asarray(camera.T_robot_cam, np.float64)
    local = (triangles.corners - pose[:3, 3]) @ pose[:3, :3]
    nearness = 1 / local[:, :, 2]
    corners = local[:, :, :2] * nearness[:, :, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return rasterise_triangles(corners, nearness, camera.width, camera.height)


def _draw(triangles: Triangles, scenery: Scenery, camera: Camera, shiny: Sequence[int]) -> PerfectImage:
    rays, eye = rays_of(camera)
    depth, owner = np.full(len(rays), FARTHEST), np.full(len(rays), -1)
    for number, surface in enumerate(scenery.surfaces):
        owner[surface.hit(rays, eye, depth)] = number
    albedo, normals = np.zeros((len(rays), 3)), np.tile([0.0, 0.0, 1.0], (len(rays), 1))
    for number, surface in enumerate(scenery.surfaces):
        mine = np.flatnonzero(owner == number)
        if len(mine):
            albedo[mine] = surface.color(eye + rays[mine] * depth[mine, None])
            normals[mine] = surface.normal
    buffer = _rasterised(triangles, camera)
    triangle = buffer.triangle.ravel()
    seen = np.flatnonzero((triangle >= 0) & (buffer.nearness.ravel() * depth > 1))
    depth[seen] = 1 / buffer.nearness.ravel()[seen]
    points = eye + rays * depth[:, None]
    albedo[seen], normals[seen] = _surface(triangles, triangle[seen], points[seen])
    labels = np.zeros(len(rays), np.int32)
    labels[seen] = triangles.owner[triangle[seen]]
    units = rays / np.sqrt(_products(rays, rays))[:, None]
    mirror = np.isin(labels, list(shiny)) & (labels > 0)
    lit = _lit(triangles, points, normals, scenery.light)
    facing = np.where((_products(units, normals) > 0)[:, None], -normals, normals)
    around = (0.75 + 0.25 * facing[:, 2])[:, None] * scenery.light.sky
    lamp = np.clip(dot_products(facing, scenery.light.direction), 0, 1) * lit
    colors = albedo * (around + lamp[:, None] * scenery.light.lamp)
    half = scenery.light.direction - units
    middle = _products(facing, half) / np.maximum(np.sqrt(_products(half, half)), 1e-9)
    highlight = np.clip(middle, 0, 1) ** _GLOSS * lit * np.where(mirror, 0.7, 0.06)
    rgb = np.clip(colors + highlight[:, None] * scenery.light.lamp, 0, 1)
    shape = (camera.height, camera.width)
    return PerfectImage(
        rgb=rgb.reshape(*shape, 3),
        depth=depth.reshape(shape),
        labels=labels.reshape(shape),
        cosine=np.abs(_products(units, normals)).reshape(shape),
        albedo=albedo.mean(axis=1).reshape(shape),
        shiny=mirror.reshape(shape),
    )


def _surface(triangles: Triangles, index: npt.NDArray[np.int64], points: Floats) -> tuple[Floats, Floats]:
    """Colour and normal of points on triangles."""
    weights = barycentric_coordinates(points, triangles.corners[index])
    normals = np.einsum("ij,ijk->ik", weights, triangles.normals[index])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    uvs = np.clip(np.einsum("ij,ijk->ik", weights, triangles.uvs[index]), 0, 1)
    albedo = triangles.colors[index]
    for number, image in enumerate(triangles.textures):
        mine = triangles.texture[index] == number
        last = np.array([image.shape[1] - 1, image.shape[0] - 1])
        texels = (uvs[mine] * (1, -1) + (0, 1)) * last
        albedo[mine] = bilinear(image.astype(np.float64) / 255, texels)
    return albedo, normals


def _lit(triangles: Triangles, points: Floats, normals: Floats, light: Light) -> Floats:
    """(N,) share of the lamp's light at each point, from a shadow map with soft edges: 0 in full shadow."""
    side = np.cross((0.0, 1.0, 0.0), light.direction)
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(light.direction, side), light.direction], axis=1)
    turned = triangles.corners @ axes
    low, high = turned.min(axis=(0, 1)), turned.max(axis=(0, 1))
    resolution = 900
    scale = (resolution - 20) / float(np.max(high - low))
    buffer = rasterise_triangles((turned[:, :, :2] - low[:2]) * scale + 10, turned[:, :, 2], resolution, resolution)
    above = np.where(np.isfinite(buffer.nearness), buffer.nearness, -9.0).astype(np.float32)
    raised = points + normals * 0.003
    across, along, depth = (dot_products(raised, axes[:, axis]) for axis in range(3))
    columns, rows = (across - low[0]) * scale + 10, (along - low[1]) * scale + 10
    lit = np.ones(len(points))
    near = np.flatnonzero((np.abs(columns / resolution - 0.5) < 0.5) & (np.abs(rows / resolution - 0.5) < 0.5))
    column, row = (np.rint(values[near]).astype(np.int64) for values in (columns, rows))
    total, level = np.zeros(len(near)), (depth[near] + 0.002).astype(np.float32)
    for right, down in ((0, 0), (2, 0), (-2, 0), (0, 2), (0, -2), (3, 3), (-3, 3), (3, -3), (-3, -3)):
        place = np.clip(row + down, 0, resolution - 1) * resolution + np.clip(column + right, 0, resolution - 1)
        total += above.ravel()[place] < level
    lit[near] = total / 9
    return lit


def _products(some: Floats, others: Floats) -> Floats:
    """(N,) scalar products of two rows (N, 3) of vectors."""
    return np.einsum("ij,ij->i", some, others)
