"""Background reconstruction: the photo without table and objects, as a visible surface and collision boxes.

The surface is reconstructed from the depth image by a truncated signed distance function (TSDF) and marching cubes.
Boxes approximate its solid parts, since MuJoCo replaces a mesh by its convex hull, which would fill a room.
"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import ConfigError
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import label_connected_components, points_in_box_mask
from grs_agents.perception.plane_fitting import depth_tolerance
from grs_agents.perception.segmentation.patch_cutting import depth_jump_mask, smooth_frame_depth
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Aabb, Array, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame

CONFIG = DEFAULT.background

Faces = npt.NDArray[np.int64]
Grid = npt.NDArray[np.float32]
REACH: Final = 2  # pixels, of the central differences for normals
SLAB: Final = 16  # layers of voxels that are processed together


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, robot frame: (V, 3) vertices in metres and (F, 3) indices of them."""

    vertices: Array
    faces: Faces

    def simplify(self, cell: float, most_faces: int) -> "Mesh":
        """Vertex clustering in cells of ``cell`` metres, or larger until there are at most ``most_faces``."""
        # Vertices on open edges, which have a single face, outweigh the others and keep the mesh's border.
        edges = np.sort(np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]), axis=1)
        unique, times = np.unique(edges, axis=0, return_counts=True)
        weight = np.full(len(self.vertices), 1e-6)
        weight[unique[times == 1].ravel()] = 1.0
        mesh = self
        while len(self.vertices):
            _, group = np.unique(np.floor(self.vertices / cell).astype(np.int64), axis=0, return_inverse=True)
            group = group.ravel()
            count = np.bincount(group, weights=weight)
            means = [np.bincount(group, weights=weight * self.vertices[:, axis]) / count for axis in range(3)]
            a, b, c = group[self.faces].T
            kept = (a != b) & (b != c) & (c != a)
            mesh = _drop_unused_vertices(np.stack(means, axis=1), np.unique(group[self.faces][kept], axis=0))
            if len(mesh.faces) <= most_faces:
                break
            cell *= 1.5
        return mesh


def reconstruct_surface_mesh(frame: RGBDFrame, table: TableFrame, left: Mask, voxel: float) -> Mesh:
    """The surface of the pixels ``left`` (H, W), open at occlusions.

    Cells of the grid are ``voxel`` metres wide, or more if the grid would be too large."""
    try:
        measure: Any = importlib.import_module("skimage.measure")
    except ImportError as error:
        remedy = 'run: pip install "grs-agents[background]"'
        raise ConfigError(f"background.on = true needs scikit-image: {error}", remedy) from error
    cloud = robot_frame_point_map(frame, table)[left]
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    while np.prod(np.ceil((high - low) / voxel) + 5) > CONFIG.most_voxels:
        voxel *= 1.25
    origin = low - 2 * voxel
    shape = tuple(int(count) for count in np.ceil((high - low) / voxel) + 5)
    distance, known = compute_tsdf_grid(frame, table, left, (origin, voxel, (shape[0], shape[1], shape[2])))
    cells = np.ones(tuple(count - 1 for count in shape), np.bool_)
    for x, y, z in product((0, 1), repeat=3):
        cells &= known[x : x + cells.shape[0], y : y + cells.shape[1], z : z + cells.shape[2]]
    if not (cells.any() and distance.min() < 0 < distance.max()):
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    vertices, faces, _, _ = measure.marching_cubes(distance, 0.0)
    places = np.asarray(vertices, np.float64)
    triangles = np.asarray(faces, np.int64)
    # Without the surface in cells with an unknown corner.
    cell = np.minimum(places[triangles].mean(axis=1).astype(np.int64), np.array(cells.shape) - 1)
    triangles = triangles[cells[cell[:, 0], cell[:, 1], cell[:, 2]]]
    return _drop_unused_vertices(origin + places * voxel, triangles)


def compute_tsdf_grid(
    frame: RGBDFrame, table: TableFrame, left: Mask, grid: tuple[Array, float, tuple[int, int, int]]
) -> tuple[Grid, npt.NDArray[np.bool_]]:
    """Truncated signed distance in voxels, positive before the surface, and known voxels; both of the grid's shape.

    The distance is point to plane in a voxel's pixel: along the ray, surfaces at grazing angles would fall between two
    voxels. ``grid`` is the centre of its first voxel (3,) in the robot frame, the edge of a voxel, both in metres, and
    the counts along x, y, z.
    """
    origin, voxel, shape = grid
    pose, camera = np.asarray(table.T_robot_cam), frame.camera
    surface = frame.camera_frame_point_map()
    right, below = np.zeros_like(surface), np.zeros_like(surface)
    right[:, REACH:-REACH] = surface[:, 2 * REACH :] - surface[:, : -2 * REACH]
    below[REACH:-REACH] = surface[2 * REACH :] - surface[: -2 * REACH]
    normal = np.cross(right, below)
    along = np.abs((normal * surface).sum(axis=-1)) / np.maximum(np.linalg.norm(normal, axis=-1), 1e-12)
    facing = np.clip(along / np.maximum(surface[..., 2], 1e-6), CONFIG.flattest, 2.0)  # distance to plane per depth
    distance = np.full(shape, CONFIG.truncation, np.float32)
    known = np.zeros(shape, np.bool_)
    for start in range(0, shape[0], SLAB):
        layers = range(start, min(start + SLAB, shape[0]))
        index = np.stack(np.meshgrid(layers, range(shape[1]), range(shape[2]), indexing="ij"), axis=-1)
        places = (origin + voxel * index - pose[:3, 3]) @ pose[:3, :3]
        z = np.maximum(places[..., 2], 1e-6)
        columns = np.clip(np.rint(places[..., 0] / z * camera.fx + camera.cx), -1, camera.width).astype(np.int64)
        rows = np.clip(np.rint(places[..., 1] / z * camera.fy + camera.cy), -1, camera.height).astype(np.int64)
        seen = (places[..., 2] > 0.05) & (columns >= 0) & (columns < camera.width)
        seen &= (rows >= 0) & (rows < camera.height)
        rows, columns = np.where(seen, rows, 0), np.where(seen, columns, 0)
        gap = (frame.depth[rows, columns] - places[..., 2]) * facing[rows, columns] / voxel
        known[layers.start : layers.stop] = seen & left[rows, columns] & (gap > -CONFIG.truncation)
        distance[layers.start : layers.stop] = np.clip(gap, -CONFIG.truncation, CONFIG.truncation)
    return distance, known


def _drop_unused_vertices(vertices: Array, faces: Faces) -> Mesh:
    """The mesh without unreferenced vertices."""
    used, numbers = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], numbers.reshape(-1, 3).astype(np.int64))


_Cells = npt.NDArray[np.int32]


def cover_points_with_boxes(points: Array, cell: float) -> Array:
    """(B, 2, 3) lowest and highest corners (m) of a bounded number of boxes around all (N, 3) ``points`` (m).

    Space is divided into cells of ``cell`` metres, or more if there would be too many boxes. Occupied cells are merged
    greedily to full blocks, and each block is shrunk to its points, so that walls along an axis are thin.
    """
    if not len(points):
        return np.zeros((0, 2, 3))
    while True:
        index = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
        blocks = _label_voxel_cuboids(index)
        if blocks.max() <= CONFIG.most_boxes:
            break
        cell *= 1.25
    owner = blocks[index[:, 0], index[:, 1], index[:, 2]] - 1
    low, high = np.full((owner.max() + 1, 3), np.inf), np.full((owner.max() + 1, 3), -np.inf)
    np.minimum.at(low, owner, points)
    np.maximum.at(high, owner, points)
    thin = np.maximum(CONFIG.thickness - (high - low), 0) / 2
    return np.stack([low - thin, high + thin], axis=1)


def _label_voxel_cuboids(index: npt.NDArray[np.int64]) -> _Cells:
    """Grid with the number, from 1, of the block of each occupied cell, of (N, 3) ``index``."""
    free = np.zeros(index.max(axis=0) + 1, np.bool_)
    free[index[:, 0], index[:, 1], index[:, 2]] = True
    numbers = np.zeros(free.shape, np.int32)
    number = 0
    for start in np.argwhere(free):
        if not free[tuple(start)]:
            continue
        x, y, z = start.tolist()
        runs: list[int] = []  # occupied cells in a row along each axis
        for line in (free[x:, y, z], free[x, y:, z], free[x, y, z:]):
            runs.append(int(line.argmin()) if not line.all() else len(line))
        end = start + 1
        for axis in np.argsort([-run for run in runs]).tolist():  # grow the block along the longest run first
            while end[axis] < free.shape[axis]:
                low, high = start.tolist(), end.tolist()
                low[axis], high[axis] = high[axis], high[axis] + 1
                layer = tuple(slice(first, last) for first, last in zip(low, high, strict=True))
                if not free[layer].all():
                    break
                end[axis] += 1
        number += 1
        block = tuple(slice(first, last) for first, last in zip(start, end, strict=True))
        free[block], numbers[block] = False, number
    return numbers


@dataclass(frozen=True)
class Background:
    """A reconstructed background, in the robot frame."""

    mesh: Mesh  # its surface
    boxes: Array  # (B, 2, 3) lowest and highest corners (m) of the solid boxes
    color: Vec3  # mean red, green, blue, 0..1
    pixels: int  # of the (reduced) photo from which it was made


def reconstruct_background(
    frame: RGBDFrame, table: TableFrame, objects: Mask, boxes: Sequence[Aabb], arm: Array, voxel: float
) -> Background | None:
    """Reconstruct the rest of a photo without its objects and table; ``None`` if it is empty.

    Args:
        objects: (H, W) pixels of the objects.
        boxes: around the objects; the background keeps away from them.
        arm: (N, 4) centres and radii (m, robot frame) of spheres around the arm at home; it keeps away from them too.
        voxel: edge of the cells of the signed distance, metres.

    Raises:
        ConfigError: scikit-image is not installed.
    """
    small, factor = downscale_frame(frame)
    rows, columns = small.depth.shape
    # A cell of the reduced photo is an object's if any of its pixels is.
    whole = objects[: rows * factor, : columns * factor]
    taken = np.asarray(whole.reshape(rows, factor, columns, factor).any(axis=(1, 3)), np.bool_)
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    lows, highs = np.array([box.low for box in boxes]).reshape(-1, 3), np.array([box.high for box in boxes])
    keep_out = np.stack([lows, highs.reshape(-1, 3)], axis=1)
    left = background_pixel_mask(smooth, points, taken, keep_out, arm)
    if not left.any():
        return None
    raw = reconstruct_surface_mesh(smooth, table, left, voxel)
    solid = cover_points_with_boxes(raw.vertices, 2 * voxel)
    touching = np.zeros(len(solid), np.bool_)  # objects or the arm
    for low, high in keep_out:
        touching |= ((solid[:, 0] < high + CONFIG.clear) & (solid[:, 1] > low - CONFIG.clear)).all(axis=1)
    for x, y, z, radius in arm:
        nearest = np.clip((x, y, z), solid[:, 0], solid[:, 1])
        touching |= ((nearest - (x, y, z)) ** 2).sum(axis=1) < (radius + CONFIG.clear) ** 2
    solid = solid[~touching]
    if not len(solid):
        return None
    mean = small.rgb[left].mean(axis=0) / 255
    color = (float(mean[0]), float(mean[1]), float(mean[2]))
    return Background(raw.simplify(2 * voxel, CONFIG.most_faces), solid, color, int(left.sum()))


def background_pixel_mask(frame: RGBDFrame, points: Array, objects: Mask, boxes: Array, arm: Array) -> Mask:
    """(H, W) pixels of surfaces around the robot, neither objects nor table; arguments as of `reconstruct_background`.

    The frame is smoothed, ``points`` (H, W, 3) are its points in the robot frame, ``boxes`` (N, 2, 3) corners."""
    size = 2 * max(2, frame.depth.shape[1] // CONFIG.edge) + 1
    near_objects = cv2.dilate(objects.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    table = np.abs(np.nan_to_num(points[..., 2], nan=0.0)) < 2 * depth_tolerance(frame.depth.astype(np.float64))
    left = (frame.depth > 0) & ~near_objects & ~depth_jump_mask(frame.depth) & ~table
    rows, columns = np.nonzero(left)
    cloud = points[rows, columns]
    kept = points_in_box_mask(cloud, np.array(CONFIG.low), np.array(CONFIG.high))
    for low, high in boxes:
        kept &= ~points_in_box_mask(cloud, low - CONFIG.margin, high + CONFIG.margin)
    for x, y, z, radius in arm:
        kept &= ((cloud - (x, y, z)) ** 2).sum(axis=1) > (radius + CONFIG.margin) ** 2
    left[rows, columns] = kept
    return label_connected_components(left.astype(np.uint8), int(CONFIG.smallest * left.size)) > 0
