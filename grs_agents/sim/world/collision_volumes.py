"""An object's real collision volume as weighted points: boxes, cylinders, spheres and the hulls of meshes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.hulls import hull_half_spaces
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import ObjectModel, Shape
from grs_agents.sim.instance.goal import Zone
from grs_agents.sim.world.footprints import cached_per_model

_POINTS: Final = 600
"""Approximate number of sample points of an object."""
_ROUND: Final = 6
"""Least number of cells along each axis of a round shape or a mesh."""
_FINE: Final = 24
_ALONG: Final = 200
"""Most cells along an axis: a sheet would have many more than ``_POINTS`` otherwise."""
_REMEMBERED: Final = 512


@dataclass(frozen=True)
class Volume:
    """Points (3, N) spread evenly over an object's colliders, object frame, and their weights (N,), which sum to 1."""

    points: FloatArray
    weights: FloatArray


_shares: dict[tuple[int, Pose, tuple[tuple[Pose, Vec3], ...], float], tuple[Volume, float]] = {}


@cached_per_model
def sample_collision_volume(model: ObjectModel, library: Library) -> Volume:
    """Collision volume of an object, one point for a mark; raises ``InputError`` for a mesh that cannot be read."""
    if not model.colliders:
        return Volume(np.zeros((3, 1)), np.ones(1))
    solids = [_Solid.from_shape(shape, library) for shape in model.colliders]
    widest = max(float((solid.high - solid.low).max()) for solid in solids)
    cell = max((sum(solid.size for solid in solids) / _POINTS) ** (1 / 3), widest / _ALONG)
    clouds = [solid.sample_points_inside(cell) for solid in solids]
    weights = np.concatenate(
        [np.full(cloud.shape[1], solid.size / cloud.shape[1]) for solid, cloud in zip(solids, clouds, strict=True)]
    )
    return Volume(np.hstack(clouds), weights / weights.sum())


_CELLS: Final = 160
_MOUTH: Final = 0.15
"""Cells along each axis of a level, and the depth below the rim at which walls are sought, as a share of the height."""
_ABOVE: Final = 0.006
"""Height above the floor at which a container is measured, metres: what is no higher counts as standing on it."""


@cached_per_model
def measure_inner_size(model: ObjectModel, library: Library) -> Vec3 | None:
    """Inner size of an upright container: x and y between its walls just above the floor, since what goes into a bowl
    stands there, z from floor to rim, metres.

    None for objects without an inside: solids, marks, flat plates.
    """
    solids = [_Solid.from_shape(shape, library) for shape in model.colliders]
    low, high = (np.asarray(corner, np.float64) for corner in model.bounds)
    cell = (high - low) / _CELLS

    def are_points_inside_solids(points: FloatArray) -> npt.NDArray[np.bool_]:
        return np.any([solid.contains_points_in_object_frame(points) for solid in solids], axis=0)

    def find_hollow_cells(height: float) -> npt.NDArray[np.int64]:
        """Free cells (N, 2) of a level with walls on all four sides."""
        level = _grid_cell_centers(
            np.array([*low[:2], height]), np.array([*high[:2], height]), np.array([_CELLS, _CELLS, 1])
        )
        walls = are_points_inside_solids(level).reshape(_CELLS, _CELLS)
        walled = ~walls
        for side in range(4):
            walled &= np.rot90(np.maximum.accumulate(np.rot90(walls, side)), -side)
        return np.argwhere(walled)

    mouth = find_hollow_cells(high[2] - _MOUTH * (high[2] - low[2])) if solids else np.zeros((0, 2), np.int64)
    if not len(mouth):
        return None
    middle = low[:2] + (mouth.mean(axis=0) + 0.5) * cell[:2]
    column = _grid_cell_centers(np.array([*middle, low[2]]), np.array([*middle, high[2]]), np.array([1, 1, _CELLS]))
    floor = float(column[2][are_points_inside_solids(column)].max(initial=low[2]) + cell[2] / 2)
    across = (np.ptp(find_hollow_cells(min(floor + _ABOVE, (floor + high[2]) / 2)), axis=0) + 1) * cell[:2]
    return (float(across[0]), float(across[1]), float(high[2] - floor))


def volume_share_in_zones(volume: Volume, pose: Pose, zones: Sequence[Zone], ceiling: float) -> float:
    """Share of an object's volume above any of the zones and below ``ceiling`` (m)."""
    key = (id(volume), pose, tuple((zone.pose, zone.size) for zone in zones), ceiling)  # numbers are hashed fast
    known = _shares.get(key)  # most objects have not moved since the last score
    if known is None:
        if len(_shares) >= _REMEMBERED:
            _shares.clear()
        points = transforms.transform_points(pose, volume.points)
        inside = np.zeros(points.shape[1], dtype=bool)
        for zone in zones:
            local = transforms.transform_points(transforms.invert_pose(zone.pose), points)
            inside |= (np.abs(local[0]) <= zone.size[0] / 2) & (np.abs(local[1]) <= zone.size[1] / 2)
        share = min(1.0, round(float(volume.weights[inside & (points[2] < ceiling)].sum()), 9))
        known = _shares[key] = (volume, share)
    return known[1]


@dataclass(frozen=True)
class _Solid:
    """A collider in its own frame: bounding box (3,), (3,), half-spaces (K, 4) of a mesh, and volume ``size``."""

    shape: Shape
    low: FloatArray
    high: FloatArray
    faces: FloatArray
    size: float

    @staticmethod
    def from_shape(shape: Shape, library: Library) -> "_Solid":
        faces = np.zeros((0, 4))
        if shape.kind == "mesh":
            vertices = read_vertices(library.mesh_or_texture_path(shape.mesh or "")) * np.asarray(shape.size)
            low, high, faces = vertices.min(axis=0), vertices.max(axis=0), hull_half_spaces(vertices)
        else:
            radius, length = shape.size[0], shape.size[1] if shape.kind == "cylinder" else 2 * shape.size[0]
            half = np.asarray(shape.size if shape.kind == "box" else (2 * radius, 2 * radius, length)) / 2
            low, high = -half, half
        whole = float(np.prod(high - low))
        share = {"box": 1.0, "cylinder": np.pi / 4, "sphere": np.pi / 6}.get(shape.kind)
        if share is None:
            grid = _grid_cell_centers(low, high, np.full(3, _FINE))
            share = max(float(_are_within_half_spaces(faces, grid).mean()), 1e-3)
        return _Solid(shape, low, high, faces, max(whole * share, 1e-12))

    def sample_points_inside(self, cell: float) -> FloatArray:
        """Points (3, N) of a grid of about ``cell`` metres inside the solid, object frame."""
        counts = np.maximum(1, np.round((self.high - self.low) / cell))
        if self.shape.kind != "box":
            counts = np.maximum(counts, _ROUND)
        grid = _grid_cell_centers(self.low, self.high, counts)
        inside = self._contains_points(grid)
        kept = grid[:, inside] if inside.any() else ((self.low + self.high) / 2)[:, None]
        return transforms.transform_points((self.shape.position, self.shape.quaternion), kept)

    def contains_points_in_object_frame(self, points: FloatArray) -> npt.NDArray[np.bool_]:
        """Mask (N,) of the points (3, N), object frame, inside the solid."""
        to_shape = transforms.invert_pose((self.shape.position, self.shape.quaternion))
        local = transforms.transform_points(to_shape, points)
        near = np.asarray(((local >= self.low[:, None]) & (local <= self.high[:, None])).all(axis=0), np.bool_)
        near[near] = self._contains_points(local[:, near])
        return near

    def _contains_points(self, grid: FloatArray) -> npt.NDArray[np.bool_]:
        if self.shape.kind in ("box", "mesh"):
            return _are_within_half_spaces(self.faces, grid)
        across = grid if self.shape.kind == "sphere" else grid[:2]
        within: npt.NDArray[np.bool_] = np.square(across).sum(axis=0) <= self.shape.size[0] ** 2
        return within


def _grid_cell_centers(low: FloatArray, high: FloatArray, counts: FloatArray) -> FloatArray:
    """Centres (3, N) of the equal cells of a box."""
    axes = [
        a + (np.arange(int(count)) + 0.5) * (b - a) / int(count) for a, b, count in zip(low, high, counts, strict=True)
    ]
    return np.array(np.meshgrid(*axes, indexing="ij")).reshape(3, -1)


def _are_within_half_spaces(faces: FloatArray, points: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray((faces[:, :3] @ points <= faces[:, 3:] + 1e-9).all(axis=0), dtype=np.bool_)
