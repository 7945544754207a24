"""Depth picture of a point cloud, seen by the colour camera."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import read_npy
from grs_agents.perception.reading.frame_assembly import Depth
from grs_agents.perception.reading.point_cloud_files import MOST_POINTS, Points, read_pcd, read_ply
from grs_agents.perception.types import Camera

SUFFIXES = (".ply", ".pcd", ".npy")
ASTRAY = 1.5
"""Largest median reprojection error, pixels, of an organised cloud; with a larger error it is unorganised."""
WIDEST = 7  # largest splat of a point of a sparse cloud, pixels a side
LEAST_SEEN = 0.2  # least share of the points in the camera's view
CELL = 16  # pixels a side of the cells that measure the covered area


@dataclass(frozen=True)
class Cloud:
    """Points in the colour camera's frame (OpenCV axes), in the file's unit."""

    points: Points  # (N, 3) float32; NaN or infinite where nothing was measured
    shape: tuple[int, int]  # rows and columns, if the file says so; (1, N) if not
    where: str  # its name in errors


def read_point_cloud(file: Path) -> Cloud | npt.NDArray[np.number]:
    """Read a cloud; a two-dimensional ``.npy`` wider than 8 is a depth picture, and returned as such."""
    if file.suffix.lower() == ".ply":
        return Cloud(*read_ply(file), str(file))
    if file.suffix.lower() == ".pcd":
        return Cloud(*read_pcd(file), str(file))
    array = read_npy(file)
    if array.ndim == 2 and array.shape[1] > 8:
        return array
    if array.ndim not in (2, 3) or not 3 <= array.shape[-1] <= 8:
        remedy = "give (H, W) depth, or points as (N, 3) or (H, W, 3): x, y, z"
        raise InputError(f"{file} has the shape {array.shape}", remedy)
    rows, columns = array.shape[:2] if array.ndim == 3 else (1, array.shape[0])
    if rows * columns > MOST_POINTS:
        raise InputError(f"{file} holds {rows * columns} points, more than {MOST_POINTS}", "thin it out")
    with np.errstate(over="ignore"):
        return Cloud(array[..., :3].reshape(-1, 3).astype(np.float32), (rows, columns), str(file))


def depth_from_cloud(cloud: Cloud, camera: Camera) -> tuple[Depth, str]:
    """(H, W) depth at the camera's pixels in the cloud's unit, 0 without a point; and a note on the method.

    Depth is read from the grid of an organised cloud, else projected."""
    grid = _depth_from_organised_cloud(cloud, camera)
    if grid is not None:
        return grid, f"depth is z of the organised cloud {Path(cloud.where).name}"
    points = cloud.points[np.isfinite(cloud.points).all(axis=1)]
    if not len(points):
        raise InputError(f"{cloud.where} has no finite point among {len(cloud.points)}", "record the cloud again")
    ahead = points[points[:, 2] > 0]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        columns = np.rint(camera.fx * (ahead[:, 0] / ahead[:, 2]) + camera.cx)
        rows = np.rint(camera.fy * (ahead[:, 1] / ahead[:, 2]) + camera.cy)
        inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    if inside.sum() < LEAST_SEEN * len(points):
        raise InputError(
            f"{cloud.where}: {int(inside.sum())} of {len(points)} points lie in the camera's view "
            f"({len(points) - len(ahead)} behind it), at least {LEAST_SEEN:.0%} must",
            "give the points in the colour camera's frame, x right, y down, z forward, and that camera's numbers",
        )
    rows, columns, z = rows[inside].astype(np.int64), columns[inside].astype(np.int64), ahead[inside, 2]
    # Splat width at which a sampled surface is closed: 1 for a dense cloud.
    cells, counts = np.unique(rows // CELL * (camera.width // CELL + 1) + columns // CELL, return_counts=True)
    spacing = CELL / float(np.sqrt(np.median(counts))) if len(cells) else np.inf
    width = max(2 * int(np.ceil((min(spacing, 1000.0) - 1.25) / 2)) + 1, 1)
    if width > WIDEST:
        raise InputError(
            f"{cloud.where}: its points lie {spacing:.0f} pixels apart in a picture of {camera.width}x{camera.height}, "
            f"more than {WIDEST}",
            "give a denser cloud, or the picture at a smaller size with the camera's numbers for it",
        )
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    order = np.argsort(-z, kind="stable")  # the nearest point is written last
    rows, columns, z = rows[order], columns[order], z[order]
    reach = range(-(width // 2), width // 2 + 1)
    for row, column in product(reach, reach):
        at, along = rows + row, columns + column
        inside = (at >= 0) & (at < camera.height) & (along >= 0) & (along < camera.width)
        layer = np.full_like(depth, np.inf)
        layer[at[inside], along[inside]] = z[inside]
        np.minimum(depth, layer, out=depth)
    depth[np.isinf(depth)] = 0
    spread = "" if width == 1 else f", each {width} pixels wide"
    return depth, f"depth is {len(z)} points of {Path(cloud.where).name} as the camera sees them{spread}"


def _depth_from_organised_cloud(cloud: Cloud, camera: Camera) -> Depth | None:
    """(H, W) z of an organised cloud, if its grid is the camera's."""
    size = (camera.height, camera.width)
    if len(cloud.points) != size[0] * size[1] or cloud.shape not in (size, (1, len(cloud.points))):
        return None
    x, y, z = (axis.reshape(size) for axis in cloud.points.T)
    valid = np.isfinite(cloud.points).all(axis=1).reshape(size) & (z > 0)
    if not valid.any():
        return np.zeros(size, np.float32)
    rows, columns = np.nonzero(valid)
    with np.errstate(over="ignore", invalid="ignore"):
        across = camera.fx * x[valid] / z[valid] + camera.cx - columns
        down = camera.fy * y[valid] / z[valid] + camera.cy - rows
        if not np.median(np.hypot(across, down)) <= ASTRAY:
            return None
    return np.where(valid, z, 0).astype(np.float32)
