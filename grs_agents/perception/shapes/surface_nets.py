"""Closed triangle mesh of a signed distance grid.

Surface nets: Gibson, "Constrained elastic surface nets", MICCAI 1998. Smoothing: Taubin, "A signal processing approach
to fair surface design", SIGGRAPH 1995."""

from importlib import import_module
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.perception.types import Array

Faces = npt.NDArray[np.int64]
Grid = npt.NDArray[np.float64]
_INSIDE = -1e-6  # value of a corner that closes an ambiguous cell


def mesh_zero_level(values: Grid, origin: Array, step: float) -> tuple[Array, Faces]:
    """The closed zero level set of ``values`` (X, Y, Z), negative inside; faces counter-clockwise from outside.
    ``origin`` (3,) and ``step``, m, place the grid. Each edge of the mesh has exactly two faces."""
    grid = _resolve_ambiguities(np.pad(values, 1, constant_values=float(np.abs(values).max()) + 1e-9))
    inside = grid < 0
    corners = [inside[x : x - 1 or None, y : y - 1 or None, z : z - 1 or None] for x, y, z in product((0, 1), repeat=3)]
    count = np.sum(corners, axis=0, dtype=np.int8)
    cells = np.argwhere((count > 0) & (count < 8))
    number = np.full(count.shape, -1, np.int64)
    number[tuple(cells.T)] = np.arange(len(cells))
    total, crossings = np.zeros((len(cells), 3)), np.zeros(len(cells))
    faces: list[Faces] = []
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        for offset in product((0, 1), repeat=2):
            start = np.zeros(3, np.int64)
            start[second], start[third] = offset
            end = start + np.eye(3, dtype=np.int64)[axis]
            a, b = grid[tuple((cells + start).T)], grid[tuple((cells + end).T)]
            crossed = (a < 0) != (b < 0)
            share = np.where(crossed, a / np.where(crossed, a - b, 1), 0)
            total[crossed] += start
            total[:, axis] += share
            crossings += crossed
        faces.append(_quads_across_axis(inside, number, axis))
    vertices = (cells + total / crossings[:, None] - 1) * step + origin
    return vertices, np.concatenate(faces)


def _quads_across_axis(inside: npt.NDArray[np.bool_], number: Faces, axis: int) -> Faces:
    """Two triangles, between the four cells around it, for each grid edge along an axis that crosses the surface."""
    second, third = (axis + 1) % 3, (axis + 2) % 3
    ahead = np.moveaxis(inside, axis, 0)
    starts = np.argwhere(np.moveaxis(ahead[:-1] != ahead[1:], 0, axis))
    leaves = inside[tuple(starts.T)]  # the edge leaves the solid along the axis
    unit = np.eye(3, dtype=np.int64)
    around = [starts - unit[second] - unit[third], starts - unit[third], starts, starts - unit[second]]
    a, b, c, d = (number[tuple(cell.T)] for cell in around)
    b, d = np.where(leaves, b, d), np.where(leaves, d, b)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _resolve_ambiguities(grid: Grid) -> Grid:
    """Move a third corner inside where only two opposite corners of a grid face are: else four faces of the mesh would
    share an edge."""
    grid = grid.copy()
    for _ in range(20):
        changed = False
        for axis in range(3):
            turned = np.moveaxis(grid, axis, 2)  # a view of the grid
            inside = turned < 0
            a, b, c, d = inside[:-1, :-1], inside[1:, :-1], inside[1:, 1:], inside[:-1, 1:]
            for first in (True, False):
                found = (a & c & ~b & ~d) if first else (b & d & ~a & ~c)
                x, y, z = np.nonzero(found)
                if not len(x):
                    continue
                changed = True
                turned[x + (1 if first else 0), y, z] = _INSIDE
        if not changed:
            break
    return grid


def smooth_grid(values: Grid) -> Grid:
    """The grid smoothed by a kernel of three along each axis."""
    for axis in range(3):
        turned = np.moveaxis(values, axis, 0)
        padded = np.concatenate([turned[:1], turned, turned[-1:]])
        values = np.moveaxis(0.22 * padded[:-2] + 0.56 * padded[1:-1] + 0.22 * padded[2:], 0, axis)
    return values


def edges_of_mesh(faces: Faces) -> Faces:
    """(E, 2) each edge once, the lower number first, in ascending order."""
    starts, ends = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    count = int(faces.max(initial=0)) + 1
    keys = np.unique(np.minimum(starts, ends) * count + np.maximum(starts, ends))  # far faster than unique rows
    return np.stack(np.divmod(keys, count), axis=1)


def smooth_mesh(vertices: Array, faces: Faces, rounds: int) -> Array:
    """(V, 3) vertices after Taubin smoothing, which keeps the volume."""
    edges = edges_of_mesh(faces)
    starts, ends = np.concatenate([edges, edges[:, ::-1]]).T
    count = np.maximum(np.bincount(starts, minlength=len(vertices)), 1)
    for strength in (0.5, -0.53) * rounds:
        means = [
            np.bincount(starts, weights=vertices[ends, axis], minlength=len(vertices)) / count for axis in range(3)
        ]
        vertices = vertices + strength * (np.stack(means, axis=1) - vertices)
    return vertices


def keep_large_pieces(vertices: Array, faces: Faces, share: float) -> tuple[Array, Faces]:
    """The mesh without closed cavities and pieces below ``share`` of the largest piece's volume."""
    links = edges_of_mesh(faces)
    graph: Any = import_module("scipy.sparse").coo_array((np.ones(len(links)), links.T), (len(vertices), len(vertices)))
    count, labels = import_module("scipy.sparse.csgraph").connected_components(graph, directed=False)
    corners = vertices[faces]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    pieces = np.bincount(labels[faces[:, 0]], weights=volumes, minlength=count)
    faces = faces[(pieces >= share * pieces.max())[labels[faces[:, 0]]]]
    used, numbered = np.unique(faces, return_inverse=True)
    return vertices[used], numbered.reshape(-1, 3)
