"""Spatial relations of the objects of a scene (on, in, touching) from their surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import cv2
import numpy as np

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import SurfaceSamples, Tree, asset_surface_at_pose
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import convex_footprint_hull, points_in_hull_mask
from grs_agents.perception.types import Array, SpatialRelation

CONFIG = DEFAULT.relations


@dataclass(frozen=True)
class Body:
    """The surface of an object."""

    name: str  # the object's
    surface: SurfaceSamples  # robot frame
    hollow: bool  # open at the top

    @property
    def surface_points(self) -> Array:
        """Points (N, 3) of its surface, m, robot frame."""
        return self.surface.points

    @cached_property
    def box(self) -> Array:
        """Lowest and highest corner (2, 3) of the surface, m."""
        return np.array([self.surface_points.min(axis=0), self.surface_points.max(axis=0)])

    def points_near_box(self, box: Array, reach: float) -> Array:
        """The points (M, 3) of its surface within ``reach`` m of a box, of lowest and highest corner (2, 3)."""
        points = self.surface_points
        return points[((points >= box[0] - reach) & (points <= box[1] + reach)).all(axis=1)]


def body_from_asset(name: str, asset: str, pose: Pose, library: Library) -> Body:
    """The body of an asset whose bounding box has its centre (m) and rotation (xyzw) at ``pose``."""
    return Body(name, asset_surface_at_pose(asset, pose, library), library.asset(asset).hollow)


def find_spatial_relations(bodies: Sequence[Body]) -> tuple[SpatialRelation, ...]:
    """At most one relation for each pair: ``in`` before ``on`` before ``touching``, which is listed once."""
    relations: list[SpatialRelation] = []
    for first, second in combinations(bodies, 2):
        reach = CONFIG.gap + max(first.surface.spacing, second.surface.spacing)
        (low, high), (lower, upper) = first.box, second.box
        if (low - reach >= upper).any() or (high + reach <= lower).any():
            continue
        near = [first.points_near_box(second.box, reach), second.points_near_box(first.box, reach)]
        close = all(map(len, near)) and bool(Tree(near[1]).find_nearest_points(near[0])[1].min() < reach**2)
        for subject, reference in ((first, second), (second, first)):
            if _is_inside_container(subject.surface_points, reference):
                relations.append(SpatialRelation(kind="in", subject=subject.name, reference=reference.name))
                break
            if close and _is_resting_on(subject.surface_points, reference.surface_points):
                relations.append(SpatialRelation(kind="on", subject=subject.name, reference=reference.name))
                break
        else:
            if close:
                relations.append(SpatialRelation(kind="touching", subject=first.name, reference=second.name))
    return tuple(relations)


def _is_inside_container(points: Array, container: Body) -> bool:
    """Whether points (N, 3) lie in an open container: below its rim, and mostly over its footprint."""
    lowest = points[:, 2].min()
    bottom, top = float(container.surface_points[:, 2].min()), float(container.surface_points[:, 2].max())
    if not container.hollow or not bottom - CONFIG.gap < lowest < top - CONFIG.sunk * (top - bottom):
        return False
    hull = convex_footprint_hull(container.surface_points)
    small = cv2.contourArea(convex_footprint_hull(points).astype(np.float32)) < cv2.contourArea(hull.astype(np.float32))
    return bool(small and points_in_hull_mask(points[:, :2], hull, margin=0.0).mean() > CONFIG.inside)


def _is_resting_on(upper: Array, lower: Array) -> bool:
    """Whether a surface (N, 3) is above another (M, 3), and its underside meets the top of that in some cells."""
    raised = upper[:, 2].min() > CONFIG.raised and upper[:, 2].max() > lower[:, 2].max()
    if not raised or upper[:, 2].mean() <= lower[:, 2].mean():
        return False
    origin = np.minimum(upper[:, :2].min(axis=0), lower[:, :2].min(axis=0))
    underside = _extreme_height_by_cell(upper, origin, CONFIG.cell, lowest=True)
    top = _extreme_height_by_cell(lower, origin, CONFIG.cell, lowest=False)
    gaps = np.array([underside[cell] - top[cell] for cell in underside.keys() & top.keys()])
    return bool(len(gaps) >= 3 and (np.abs(gaps) < 2 * CONFIG.gap).sum() >= 3)


def _extreme_height_by_cell(points: Array, origin: Array, size: float, lowest: bool) -> dict[tuple[int, int], float]:
    """The lowest or the highest z in each cell of the grid."""
    order = np.argsort(points[:, 2] if not lowest else -points[:, 2])  # the last point of a cell wins
    cells = np.floor((points[order, :2] - origin) / size).astype(int)
    return {(int(row), int(column)): float(z) for (row, column), z in zip(cells, points[order, 2], strict=True)}
