"""Surfaces of assets as points with normals, registration of point clouds, and symmetries of assets.

Nearest points and generalised ICP come from small_gicp. Rotations are compared up to the asset's symmetry.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from itertools import permutations, product
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import rotation_about_axis
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import visual_triangle_corners
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.types import Array

SAMPLES = 2000


@dataclass(frozen=True)
class SurfaceSamples:
    """Points spread evenly over a surface."""

    points: Array  # (N, 3) m, about the centre of the bounding box, or in the robot frame if placed
    normals: Array  # (N, 3) unit, outwards if the mesh is wound so
    half: Array  # (3,) half the asset's extents, m
    spacing: float  # mean distance of neighbours, m

    def distances_within_reach(self, cloud: Array, reach: float) -> Array:
        """As `distances_to_points`, infinite for points farther than ``reach`` m from its bounding box."""
        low, high = self.points.min(axis=0) - reach, self.points.max(axis=0) + reach
        inside = np.flatnonzero(((cloud >= low) & (cloud <= high)).all(axis=1))
        found = np.full(len(cloud), np.inf)
        if len(inside):
            found[inside] = self.distances_to_points(cloud[inside])
        return found

    def distances_to_points(self, cloud: Array) -> Array:
        """(M,) distances of (M, 3) points from the surface, m: point to plane over it, else point to point."""
        nearest, squares = Tree(self.points).find_nearest_points(cloud)
        across = np.abs(np.einsum("ni,ni->n", cloud - self.points[nearest], self.normals[nearest]))
        beside = np.sqrt(np.maximum(squares - across**2, 0)) > 2 * self.spacing
        return np.where(beside, np.sqrt(squares), across)


def sample_asset_surface(name: str, library: Library) -> SurfaceSamples:
    """The visible surface of an asset about the middle of its bounds; deterministic."""
    corners = asset_triangle_corners(name, library)
    surface = _surface_from_corner_bytes(corners.tobytes(), len(corners))
    middle = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    return replace(surface, points=surface.points + middle - np.mean(library.load_object_model(name).bounds, axis=0))


def asset_surface_at_pose(asset: str, pose: Pose, library: Library) -> SurfaceSamples:
    """The surface of an asset placed at ``pose``: centre (m) and rotation (xyzw) of its bounding box, robot frame."""
    surface, turn = sample_asset_surface(asset, library), matrix_from_quaternion(pose[1])
    return replace(surface, points=surface.points @ turn.T + pose[0], normals=surface.normals @ turn.T)


_corners: WeakKeyDictionary[Library, dict[str, Array]] = WeakKeyDictionary()


def asset_triangle_corners(name: str, library: Library) -> Array:
    """(T, 3, 3) corners of an asset's visible triangles, m, in the asset's frame; read-only."""
    known = _corners.setdefault(library, {})
    if name not in known:
        known[name] = visual_triangle_corners(name, library).round(5)
        known[name].setflags(write=False)
    return known[name]


@lru_cache(maxsize=128)
def _surface_from_corner_bytes(data: bytes, count: int) -> SurfaceSamples:
    corners = np.frombuffer(data).reshape(count, 3, 3)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    drawn = sample_triangle_points(corners, SAMPLES, np.random.default_rng(0))
    spacing = float(np.sqrt(drawn.area / SAMPLES))
    return SurfaceSamples(drawn.points - (low + high) / 2, drawn.normals, (high - low) / 2, spacing)


_NEIGHBOURS = 12  # for the estimation of normals


def _import_small_gicp() -> Any:
    """The bindings; they come without types."""
    return import_module("small_gicp")


class RegistrationCloud:
    """Points (N, 3), m, with their normals, prepared for registration."""

    def __init__(self, points: Array) -> None:
        gicp = _import_small_gicp()
        self.cloud: Any = gicp.PointCloud(np.ascontiguousarray(points))
        self.tree: Any = gicp.KdTree(self.cloud)
        gicp.estimate_normals_covariances(self.cloud, self.tree, num_neighbors=_NEIGHBOURS, num_threads=1)

    @property
    def normals(self) -> Array:
        """(N, 3) unit, of either sign."""
        return np.asarray(self.cloud.normals(), np.float64)[:, :3]


class Tree:
    """k-d tree of points (N, 3), m."""

    def __init__(self, points: Array) -> None:
        self._tree: Any = _import_small_gicp().KdTree(np.ascontiguousarray(points))

    def find_nearest_points(self, points: Array) -> tuple[npt.NDArray[np.int64], Array]:
        """Nearest neighbours of (M, 3) points. Returns: indices (M,), squared distances (M,), m^2."""
        indices, squares = self._tree.batch_nearest_neighbor_search(np.ascontiguousarray(points), num_threads=1)
        return np.asarray(indices, np.int64), np.asarray(squares, np.float64)


def align_point_clouds(target: RegistrationCloud, source: RegistrationCloud, start: Array, reach: float) -> Array:
    """Generalised ICP from ``start`` (4, 4), with correspondences within ``reach`` m.

    Returns: transform (4, 4) from ``source`` to ``target``.
    """
    fit = _import_small_gicp().align(
        target.cloud,
        source.cloud,
        target.tree,
        start,
        registration_type="GICP",
        max_correspondence_distance=reach,
        num_threads=1,
        max_iterations=20,
        rotation_epsilon=0.002,
        translation_epsilon=0.0002,
    )
    pose = np.asarray(fit.T_target_source, np.float64)
    return pose if np.isfinite(pose).all() else start


Floats = npt.NDArray[np.float64]
_COARSE, _FINE = 250, 2500
_SLACK = 0.003
"""Tolerance of a symmetry, m: 95th percentile of the distance of the turned surface, beyond that of resampling."""


@dataclass(frozen=True)
class Symmetry:
    """Rotations that leave an asset's shape unchanged, in its frame."""

    turns: Floats  # (N, 3, 3) discrete rotations, including the identity
    axes: Floats  # (M, 3) unit axes of continuous symmetry

    def rotation_error_degrees(self, rotation: Floats, true: Floats) -> float:
        """Angle (degrees) between a rotation (3, 3) and the nearest equivalent of the true rotation (3, 3)."""
        apart = rotation.T @ true @ self.turns
        best = float(np.arccos(np.clip((np.trace(apart, axis1=1, axis2=2).max() - 1) / 2, -1, 1)))
        for axis in self.axes:
            # Free rotation about the axis leaves the angle between both axes.
            remains = np.arccos(np.clip(np.einsum("i,nij,j->n", axis, apart, axis), -1, 1))
            best = min(best, float(remains.min()))
        return float(np.rad2deg(best))


def find_asset_symmetry(name: str, library: Library) -> Symmetry:
    """The symmetry of an asset's visible shape, regardless of its texture."""
    corners = asset_triangle_corners(name, library)
    return _symmetry_from_corner_bytes(corners.tobytes(), len(corners))


@lru_cache(maxsize=128)
def _symmetry_from_corner_bytes(data: bytes, count: int) -> Symmetry:
    corners = np.frombuffer(data).reshape(count, 3, 3)
    middle = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    rng = np.random.default_rng(0)
    coarse, fine = (sample_triangle_points(corners, count, rng).points - middle for count in (_COARSE, _FINE))
    tree = Tree(fine)
    bound = _percentile_nearest_distance(coarse, tree) + _SLACK
    half = np.ptp(corners.reshape(-1, 3), axis=0) / 2

    def same(rotation: Floats) -> bool:
        quarter = bool(np.allclose(np.abs(rotation) % 1, 0))
        if quarter and np.abs(np.abs(rotation) @ half - half).max() > 2 * _SLACK:
            return False  # the extents differ
        return _percentile_nearest_distance(coarse @ rotation.T, tree) < bound

    turns = [turn for turn in cube_rotation_matrices() if same(turn)]
    axes = [axis for axis in np.eye(3) if all(same(rotation_about_axis(axis, angle)) for angle in (0.5, 1.0, 1.9))]
    return Symmetry(np.array(turns), np.array(axes).reshape(-1, 3))


def cube_rotation_matrices() -> list[Floats]:
    """The 24 rotations of a cube, the identity first."""
    turns = product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    found = [np.eye(3)[list(order)] * np.array(signs)[:, None] for order, signs in turns]
    return [matrix for matrix in found if np.linalg.det(matrix) > 0]


@dataclass(frozen=True)
class TriangleSamples:
    """Points spread evenly over triangles."""

    points: Floats  # (N, 3)
    normals: Floats  # (N, 3) unit, of their triangles
    triangles: npt.NDArray[np.int64]  # (N,) indices of their triangles
    weights: Floats  # (N, 3) barycentric
    area: float  # of all triangles


def sample_triangle_points(corners: Floats, count: int, rng: np.random.Generator) -> TriangleSamples:
    """Sample ``count`` points of triangles (T, 3, 3), uniformly by area."""
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(crosses, axis=1)
    chosen = rng.choice(len(corners), size=count, p=doubled / doubled.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), size=count)
    points = np.einsum("ni,nij->nj", weights, corners[chosen])
    return TriangleSamples(points, crosses[chosen] / doubled[chosen, None], chosen, weights, float(doubled.sum() / 2))


def _percentile_nearest_distance(points: Floats, tree: Tree) -> float:
    """95th percentile of the distances to the nearest points of a tree, m."""
    return float(np.sqrt(np.percentile(tree.find_nearest_points(points)[1], 95)))
