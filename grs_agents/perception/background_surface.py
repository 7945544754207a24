"""A surface from one depth image: truncated signed distance on a grid, then marching cubes."""

import importlib
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.errors import ConfigError
from grs_agents.perception.frame import Array, Mask, RGBDFrame
from grs_agents.perception.table import robot_points
from grs_agents.perception.types import TableFrame

Faces = npt.NDArray[np.int64]
Grid = npt.NDArray[np.float32]
TRUNCATION: Final = 3.0
"""Farther than so many voxels behind a surface nothing is known."""
MOST_VOXELS: Final = 8_000_000
"""Of more the grid is made coarser: it holds one float and one flag each."""
MOST_FACES: Final = 20_000
REACH: Final = 2
"""The slope of a surface at a pixel is taken between the pixels this far to both sides."""
FLATTEST: Final = 0.05
"""Flatter than this (metres of distance for each metre of depth) a surface is not taken to be seen."""
SLAB: Final = 16
"""So many layers of voxels are looked up at a time."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, robot frame: (V, 3) vertices in metres and (F, 3) indices of them."""

    vertices: Array
    faces: Faces

    def simplified(self, cell: float) -> "Mesh":
        """The vertices in each cell of ``cell`` metres become one, at their mean; coarser until faces are few."""
        while True:
            found = _clustered(self, cell)
            if len(found.faces) <= MOST_FACES:
                return found
            cell *= 1.5


def surface_of(frame: RGBDFrame, table: TableFrame, left: Mask, voxel: float) -> Mesh:
    """The surface that the pixels ``left``, (H, W), show; it is open where something hides what is behind.

    Args:
        frame: the photo.
        table: tells where its camera is.
        left: pixels of the surface; at least one.
        voxel: edge of the grid's cells, metres; larger where the grid would be too large.

    Raises:
        ConfigError: scikit-image is not installed.
    """
    measure = _measure()
    cloud = robot_points(frame, table)[left]
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    while np.prod(np.ceil((high - low) / voxel) + 5) > MOST_VOXELS:
        voxel *= 1.25
    origin = low - 2 * voxel
    shape = tuple(int(count) for count in np.ceil((high - low) / voxel) + 5)
    distance, known = signed_distance(frame, table, left, origin, voxel, (shape[0], shape[1], shape[2]))
    cells = np.ones(tuple(count - 1 for count in shape), np.bool_)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                cells &= known[x : x + cells.shape[0], y : y + cells.shape[1], z : z + cells.shape[2]]
    if not (cells.any() and distance.min() < 0 < distance.max()):
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    vertices, faces, _, _ = measure.marching_cubes(distance, 0.0)
    places = np.asarray(vertices, np.float64)
    triangles = np.asarray(faces, np.int64)
    # Where a corner of the cell is unknown, the surface there is made up.
    cell = np.minimum(places[triangles].mean(axis=1).astype(np.int64), np.array(cells.shape) - 1)
    triangles = triangles[cells[cell[:, 0], cell[:, 1], cell[:, 2]]]
    return _compact(origin + places * voxel, triangles)


def signed_distance(
    frame: RGBDFrame, table: TableFrame, left: Mask, origin: Array, voxel: float, shape: tuple[int, int, int]
) -> tuple[Grid, npt.NDArray[np.bool_]]:
    """The signed distance in voxels, positive before the surface, and where it is known; both ``shape``.

    It is the distance to the plane of the surface in a voxel's pixel: along the ray alone, what is seen at a grazing
    angle would be lost between two voxels.

    Args:
        frame, table, left: as of `surface_of`.
        origin: (3,) of the first voxel's centre, metres, robot frame.
        voxel: distance of two centres, metres.
        shape: counts along x, y, z.
    """
    pose, camera = np.asarray(table.T_robot_cam), frame.camera
    facing = _facing(frame)
    distance = np.full(shape, TRUNCATION, np.float32)
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
        known[layers.start : layers.stop] = seen & left[rows, columns] & (gap > -TRUNCATION)
        distance[layers.start : layers.stop] = np.clip(gap, -TRUNCATION, TRUNCATION)
    return distance, known


def _facing(frame: RGBDFrame) -> Array:
    """(H, W) metres perpendicular to the surface for each metre of depth."""
    points = frame.points()
    across, down = np.zeros_like(points), np.zeros_like(points)
    across[:, REACH:-REACH] = points[:, 2 * REACH :] - points[:, : -2 * REACH]
    down[REACH:-REACH] = points[2 * REACH :] - points[: -2 * REACH]
    normal = np.cross(across, down)
    length = np.maximum(np.linalg.norm(normal, axis=-1), 1e-12)
    along = np.abs((normal * points).sum(axis=-1)) / length
    return np.clip(along / np.maximum(points[..., 2], 1e-6), FLATTEST, 2.0)


def _measure() -> Any:
    try:
        return importlib.import_module("skimage.measure")
    except ImportError as error:
        raise ConfigError(
            f"background.on = true needs scikit-image: {error}", 'run: pip install "grs-agents[background]"'
        ) from error


def _clustered(mesh: Mesh, cell: float) -> Mesh:
    """One vertex for each cell of space: where the mesh ends in a cell, it lies on the border."""
    if not len(mesh.vertices):
        return mesh
    weight = np.where(_border(mesh), 1.0, 1e-6)
    _, group = np.unique(np.floor(mesh.vertices / cell).astype(np.int64), axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group, weights=weight)
    means = [np.bincount(group, weights=weight * mesh.vertices[:, axis]) / count for axis in range(3)]
    faces = group[mesh.faces]
    a, b, c = faces.T
    return _compact(np.stack(means, axis=1), np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0))


def _border(mesh: Mesh) -> Mask:
    """(V,) vertices on edges that have one face only."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    found, times = np.unique(edges, axis=0, return_counts=True)
    border = np.zeros(len(mesh.vertices), np.bool_)
    border[found[times == 1].ravel()] = True
    return border


def _compact(vertices: Array, faces: Faces) -> Mesh:
    """Without the vertices that no face has."""
    used, numbers = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], numbers.reshape(-1, 3).astype(np.int64))
