"""What the photo shows besides the table and the objects, as a surface to look at and boxes to bump into.
The surface comes from one depth image: a truncated signed distance on a grid, then marching cubes. Boxes stand for its
solid parts because MuJoCo takes a mesh for its convex hull, which would fill a room."""

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
from grs_agents.perception.segmentation.patch_cutting import depth_jump_mask, smooth_frame_depth
from grs_agents.perception.table_finding import depth_tolerance, robot_frame_point_map
from grs_agents.perception.types import Aabb, Array, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame

CONFIG = DEFAULT.background

Faces = npt.NDArray[np.int64]
Grid = npt.NDArray[np.float32]
REACH: Final = 2  # the slope of a surface at a pixel is taken between the pixels this far to both sides
SLAB: Final = 16  # so many layers of voxels are looked up at a time


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, robot frame: (V, 3) vertices in metres and (F, 3) indices of them."""

    vertices: Array
    faces: Faces

    def simplify(self, cell: float, most_faces: int) -> "Mesh":
        """The vertices in each cell of ``cell`` metres become one, at their mean; coarser until faces are few."""
        while len((mesh := _cluster_vertices(self, cell)).faces) > most_faces:
            cell *= 1.5
        return mesh


def reconstruct_surface_mesh(frame: RGBDFrame, table: TableFrame, left: Mask, voxel: float) -> Mesh:
    """The surface that the pixels ``left``, (H, W), show; it is open where something hides what is behind.
    The edge of the grid's cells is ``voxel`` metres, or larger where the grid would be too large."""
    measure = _import_skimage_measure()
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
    # Where a corner of the cell is unknown, the surface there is made up.
    cell = np.minimum(places[triangles].mean(axis=1).astype(np.int64), np.array(cells.shape) - 1)
    triangles = triangles[cells[cell[:, 0], cell[:, 1], cell[:, 2]]]
    return _drop_unused_vertices(origin + places * voxel, triangles)


def compute_tsdf_grid(
    frame: RGBDFrame, table: TableFrame, left: Mask, grid: tuple[Array, float, tuple[int, int, int]]
) -> tuple[Grid, npt.NDArray[np.bool_]]:
    """The signed distance in voxels, positive before the surface, and where it is known; both of the grid's shape.

    It is the distance to the plane of the surface in a voxel's pixel: along the ray alone, what is seen at a grazing
    angle would be lost between two voxels. ``grid`` is the centre of its first voxel (3,) in the robot frame, the
    distance of two centres, both in metres, and the counts along x, y, z.
    """
    origin, voxel, shape = grid
    pose, camera = np.asarray(table.T_robot_cam), frame.camera
    facing = _surface_distance_per_depth(frame)
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


def _surface_distance_per_depth(frame: RGBDFrame) -> Array:
    """(H, W) metres perpendicular to the surface for each metre of depth."""
    points = frame.camera_frame_point_map()
    across, down = np.zeros_like(points), np.zeros_like(points)
    across[:, REACH:-REACH] = points[:, 2 * REACH :] - points[:, : -2 * REACH]
    down[REACH:-REACH] = points[2 * REACH :] - points[: -2 * REACH]
    normal = np.cross(across, down)
    length = np.maximum(np.linalg.norm(normal, axis=-1), 1e-12)
    along = np.abs((normal * points).sum(axis=-1)) / length
    return np.clip(along / np.maximum(points[..., 2], 1e-6), CONFIG.flattest, 2.0)


def _import_skimage_measure() -> Any:
    try:
        return importlib.import_module("skimage.measure")
    except ImportError as error:
        remedy = 'run: pip install "grs-agents[background]"'
        raise ConfigError(f"background.on = true needs scikit-image: {error}", remedy) from error


def _cluster_vertices(mesh: Mesh, cell: float) -> Mesh:
    """One vertex for each cell of space: where the mesh ends in a cell, it lies on the border."""
    if not len(mesh.vertices):
        return mesh
    weight = np.where(_border_vertex_mask(mesh), 1.0, 1e-6)
    _, group = np.unique(np.floor(mesh.vertices / cell).astype(np.int64), axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group, weights=weight)
    means = [np.bincount(group, weights=weight * mesh.vertices[:, axis]) / count for axis in range(3)]
    faces = group[mesh.faces]
    a, b, c = faces.T
    return _drop_unused_vertices(np.stack(means, axis=1), np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0))


def _border_vertex_mask(mesh: Mesh) -> Mask:
    """(V,) vertices on edges that have one face only."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    found, times = np.unique(edges, axis=0, return_counts=True)
    border = np.zeros(len(mesh.vertices), np.bool_)
    border[found[times == 1].ravel()] = True
    return border


def _drop_unused_vertices(vertices: Array, faces: Faces) -> Mesh:
    """Without the vertices that no face has."""
    used, numbers = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], numbers.reshape(-1, 3).astype(np.int64))


_Cells = npt.NDArray[np.int32]


def cover_points_with_boxes(points: Array, cell: float) -> Array:
    """(B, 2, 3) lowest and highest corners (m) of a bounded number of boxes that hold all (N, 3) ``points`` (m).

    Space is cut into cells with an edge of ``cell`` metres, or more where there would be too many boxes; cells with
    points are joined to the largest blocks that are full, and each block is shrunk to its points, so that a wall along
    an axis is as thin as it was measured.
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
    """A grid with the number, from 1, of the block that each full cell of (N, 3) ``index`` belongs to."""
    free = np.zeros(index.max(axis=0) + 1, np.bool_)
    free[index[:, 0], index[:, 1], index[:, 2]] = True
    numbers = np.zeros(free.shape, np.int32)
    number = 0
    for start in np.argwhere(free):
        if not free[tuple(start)]:
            continue
        end = start + 1
        for axis in np.argsort([-_count_consecutive_cells(free, start, axis) for axis in range(3)]):
            end = _extend_block_end(free, start, end, int(axis))
        number += 1
        block = tuple(slice(first, last) for first, last in zip(start, end, strict=True))
        free[block], numbers[block] = False, number
    return numbers


def _count_consecutive_cells(free: npt.NDArray[np.bool_], start: npt.NDArray[np.int64], axis: int) -> int:
    """How many full cells follow on each other along an axis."""
    along = tuple(slice(int(start[at]), None) if at == axis else int(start[at]) for at in range(3))
    line = free[along]
    return int(line.argmin()) if not line.all() else len(line)


def _extend_block_end(
    free: npt.NDArray[np.bool_], start: npt.NDArray[np.int64], end: npt.NDArray[np.int64], axis: int
) -> npt.NDArray[np.int64]:
    """The end of the block from ``start``, moved on along an axis for as long as all its cells are full."""
    end = end.copy()
    while end[axis] < free.shape[axis]:
        low, high = start.tolist(), end.tolist()
        layer = tuple(slice(high[at], high[at] + 1) if at == axis else slice(low[at], high[at]) for at in range(3))
        if not free[layer].all():
            break
        end[axis] += 1
    return end


@dataclass(frozen=True)
class Background:
    """A reconstructed background, in the robot frame."""

    mesh: Mesh  # its surface
    boxes: Array  # (B, 2, 3) lowest and highest corners (m) of the boxes that are solid
    color: Vec3  # mean red, green, blue, 0..1
    pixels: int  # how many of the (reduced) photo's pixels it was made from


def reconstruct_background(
    frame: RGBDFrame, table: TableFrame, objects: Mask, boxes: Sequence[Aabb], arm: Array, voxel: float
) -> Background | None:
    """Reconstruct what is left of a photo after its objects and its table are taken out; ``None`` if nothing is.

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
    # A cell of the smaller photo is an object's if any of its pixels is.
    whole = objects[: rows * factor, : columns * factor]
    taken = np.asarray(whole.reshape(rows, factor, columns, factor).any(axis=(1, 3)), np.bool_)
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    lows, highs = np.array([one.low for one in boxes]).reshape(-1, 3), np.array([one.high for one in boxes])
    keep_out = np.stack([lows, highs.reshape(-1, 3)], axis=1)
    left = background_pixel_mask(smooth, points, taken, keep_out, arm)
    if not left.any():
        return None
    raw = reconstruct_surface_mesh(smooth, table, left, voxel)
    solid = cover_points_with_boxes(raw.vertices, 2 * voxel)
    solid = solid[~_boxes_touching_obstacles(solid, keep_out, arm)]
    if not len(solid):
        return None
    mean = small.rgb[left].mean(axis=0) / 255
    color = (float(mean[0]), float(mean[1]), float(mean[2]))
    return Background(raw.simplify(2 * voxel, CONFIG.most_faces), solid, color, int(left.sum()))


def background_pixel_mask(frame: RGBDFrame, points: Array, objects: Mask, boxes: Array, arm: Array) -> Mask:
    """(H, W) pixels of surfaces around the robot, neither objects nor table; arguments as of `reconstruct_background`.
    The frame is smoothed, ``points`` are (H, W, 3) its points in the robot frame, ``boxes`` (N, 2, 3) corners."""
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


def _boxes_touching_obstacles(solid: Array, boxes: Array, arm: Array) -> Mask:
    """Which boxes, (B, 2, 3), come too near to the objects' ``boxes`` or the arm's spheres."""
    touching = np.zeros(len(solid), np.bool_)
    for low, high in boxes:
        touching |= ((solid[:, 0] < high + CONFIG.clear) & (solid[:, 1] > low - CONFIG.clear)).all(axis=1)
    for x, y, z, radius in arm:
        nearest = np.clip((x, y, z), solid[:, 0], solid[:, 1])
        touching |= ((nearest - (x, y, z)) ** 2).sum(axis=1) < (radius + CONFIG.clear) ** 2
    return touching
