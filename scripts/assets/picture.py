"""A picture with depth of triangles on a table: a pinhole camera, one lamp with shadows, a wooden top."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.geometry.raster import barycentric, rasterise
from grs_agents.library.posed_meshes import Triangles

Floats = npt.NDArray[np.float64]
TABLE_LOW, TABLE_HIGH = (-0.45, -0.85), (1.05, 0.85)
FLOOR = -0.74
_LAMP = np.array([0.25, 0.42, 0.87]) / np.linalg.norm([0.25, 0.42, 0.87])


@dataclass(frozen=True)
class View:
    """A pinhole camera with square pixels and its principal point in the middle.

    Attributes:
        width, height: px.
        focal: px.
        eye: where it is, m, robot frame.
        target: what it looks at, m.
    """

    width: int
    height: int
    focal: float
    eye: Vec3
    target: Vec3

    def camera_to_robot(self) -> Floats:
        """The 4x4 transform from OpenCV's camera axes (x right, y down, z forward) to the robot frame."""
        forward = np.subtract(self.target, self.eye)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        matrix[:3, 3] = self.eye
        return matrix

    def centre(self) -> tuple[float, float]:
        """The principal point in px."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    def finer(self, times: int) -> "View":
        """The same view with ``times`` as many pixels each way."""
        return View(self.width * times, self.height * times, self.focal * times, self.eye, self.target)


@dataclass(frozen=True)
class Picture:
    """What the camera sees: (H, W, 3) RGB in 0..1, (H, W) depth in m, (H, W) object ids (0: background)."""

    rgb: Floats
    depth: Floats
    labels: npt.NDArray[np.uint8]


def picture(triangles: Triangles, view: View, rng: np.random.Generator) -> Picture:
    """Draw the triangles on the table: colours antialiased, depth and labels at pixel centres."""
    wood = _wood(rng)
    exact = _draw(triangles, view, wood)
    fine = _draw(triangles, view.finer(2), wood)
    rgb = cv2.resize(fine.rgb, (view.width, view.height), interpolation=cv2.INTER_AREA)
    return Picture(np.asarray(rgb, dtype=np.float64), exact.depth, exact.labels)


def _draw(triangles: Triangles, view: View, wood: Floats) -> Picture:
    matrix = view.camera_to_robot()
    local = (triangles.corners - matrix[:3, 3]) @ matrix[:3, :3]
    (cx, cy), nearness = view.centre(), 1 / local[:, :, 2]
    corners = local[:, :, :2] * nearness[:, :, None] * view.focal + (cx, cy)
    buffer = rasterise(corners, nearness, view.width, view.height)
    columns, rows = np.meshgrid(np.arange(view.width), np.arange(view.height))
    rays = np.stack([(columns - cx) / view.focal, (rows - cy) / view.focal, np.ones(columns.shape)], -1)
    rays = rays.reshape(-1, 3) @ matrix[:3, :3].T
    seen, triangle = buffer.triangle.ravel() >= 0, buffer.triangle.ravel()
    depth = _background(rays, matrix[:3, 3])
    depth[seen] = 1 / buffer.nearness.ravel()[seen]
    points = rays * depth[:, None] + matrix[:3, 3]
    albedo, normals = _ground(points, wood), np.tile([0.0, 0.0, 1.0], (len(points), 1))
    albedo[seen], normals[seen] = _surface(triangles, triangle[seen], points[seen])
    light = _light(points, normals, _lit(triangles, points, normals))
    shape = (view.height, view.width)
    labels = np.where(seen, triangles.owner[triangle], 0).astype(np.uint8)
    return Picture(np.clip(albedo * light, 0, 1).reshape(*shape, 3), depth.reshape(shape), labels.reshape(shape))


def _background(rays: Floats, eye: Floats) -> Floats:
    """(N,) depth of the table top, or of the floor beside it."""
    table = -eye[2] / np.minimum(rays[:, 2], -1e-6)
    floor = (FLOOR - eye[2]) / np.minimum(rays[:, 2], -1e-6)
    on_table = _on_table(rays * table[:, None] + eye)
    return np.asarray(np.where(on_table, table, floor), dtype=np.float64)


def _on_table(points: Floats) -> npt.NDArray[np.bool_]:
    inside = (points[:, :2] >= TABLE_LOW) & (points[:, :2] <= TABLE_HIGH)
    return inside[:, 0] & inside[:, 1]


def _surface(triangles: Triangles, index: npt.NDArray[np.int64], points: Floats) -> tuple[Floats, Floats]:
    """Colour and normal of points on triangles."""
    weights = barycentric(points, triangles.corners[index])
    normals = np.einsum("ij,ijk->ik", weights, triangles.normals[index])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    uvs = np.einsum("ij,ijk->ik", weights, triangles.uvs[index])
    albedo = triangles.colors[index]
    for number, image in enumerate(triangles.textures):
        mine = triangles.texture[index] == number
        albedo[mine] = _sample(image.astype(np.float64) / 255, uvs[mine] * (1, -1) + (0, 1))
    return albedo, normals


def _sample(image: Floats, positions: Floats) -> Floats:
    """Bilinear samples at (N, 2) positions in 0..1, origin at the upper left."""
    height, width = image.shape[:2]
    x, y = (np.clip(positions[:, axis], 0, 1) * (size - 1) for axis, size in ((0, width), (1, height)))
    left, top = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    u, v = (x - left)[:, None], (y - top)[:, None]
    upper = image[top, left] * (1 - u) + image[top, left + 1] * u
    lower = image[top + 1, left] * (1 - u) + image[top + 1, left + 1] * u
    return upper * (1 - v) + lower * v


def _lit(triangles: Triangles, points: Floats, normals: Floats) -> Floats:
    """(N,) how much of the lamp reaches each point: 0 in full shadow, soft at the edge."""
    side = np.cross((0.0, 0.0, 1.0), _LAMP)
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(_LAMP, side), _LAMP], axis=1)
    size, resolution = 1.8, 900
    seen = (triangles.corners @ axes)[:, :, :2] / size * resolution + resolution / 2
    buffer = rasterise(seen, (triangles.corners @ axes)[:, :, 2], resolution, resolution)
    local = (points + normals * 0.003) @ axes
    total = np.zeros(len(points))
    spread = (-3.0, -1.5, 0.0, 1.5, 3.0)
    for dx in spread:
        for dy in spread:
            pixel = np.round(local[:, :2] / size * resolution + resolution / 2 + (dx, dy)).astype(int)
            pixel = np.clip(pixel, 0, resolution - 1)
            total += buffer.nearness[pixel[:, 1], pixel[:, 0]] < local[:, 2] + 0.002
    return total / len(spread) ** 2


def _light(points: Floats, normals: Floats, lit: Floats) -> Floats:
    """(N, 3) light on each point: a bluish sky from above, a warm lamp."""
    sky = 0.48 + 0.14 * normals[:, 2]
    lamp = 0.52 * np.clip(normals @ _LAMP, 0, 1) * lit
    contact = np.clip(0.80 + np.where(np.abs(normals[:, 2]) < 0.5, points[:, 2], 1.0) * 10, 0.80, 1.0)
    return (sky[:, None] * (0.97, 0.99, 1.04) + lamp[:, None] * (1.03, 1.0, 0.94)) * contact[:, None]


def _ground(points: Floats, wood: Floats) -> Floats:
    """Colour of the table top and of the floor."""
    low, extent = np.array(TABLE_LOW), np.subtract(TABLE_HIGH, TABLE_LOW)
    table = _sample(wood, ((points[:, :2] - low) / extent)[:, ::-1])
    return np.where((points[:, 2] > FLOOR / 2)[:, None], table, np.array([[0.42, 0.43, 0.45]]))


def _wood(rng: np.random.Generator) -> Floats:
    """Planks along y: an RGB image, rows along x."""
    rows, columns, planks = 1500, 1700, 11
    grain = _noise(rng, rows, columns, (260, 7)) * 0.6 + _noise(rng, rows, columns, (700, 24)) * 0.4
    image = np.empty((rows, columns, 3))
    edges = np.linspace(0, rows, planks + 1).astype(int)
    for top, bottom in pairwise(edges):
        tone = rng.uniform(0.93, 1.05)
        image[top:bottom] = np.array([0.70, 0.55, 0.40]) * tone
        image[bottom - 2 : bottom] *= 0.80
    return np.clip(image * (1 + 0.11 * grain[:, :, None] * (0.8, 1.0, 1.2)), 0, 1)


def _noise(rng: np.random.Generator, rows: int, columns: int, cells: tuple[int, int]) -> Floats:
    """Smooth noise of unit deviation with ``cells`` (down, across)."""
    coarse = cv2.resize(rng.normal(size=cells), (columns, rows), interpolation=cv2.INTER_CUBIC)
    return np.asarray(coarse, dtype=np.float64)
