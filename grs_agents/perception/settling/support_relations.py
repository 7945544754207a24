"""Which object lies on, in or against which, by the surfaces of what stands for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import Surface, Tree, asset_surface_at_pose
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import convex_footprint_hull, points_in_hull_mask
from grs_agents.perception.types import Array, Relation

CONFIG = DEFAULT.relations


@dataclass(frozen=True)
class Body:
    """What stands for an object."""

    name: str  # the object's
    surface: Surface  # robot frame
    hollow: bool  # open at the top

    @property
    def surface_points(self) -> Array:
        """(N, 3) of its surface, m, robot frame."""
        return self.surface.points


def body_from_asset(name: str, asset: str, pose: Pose, library: Library) -> Body:
    """The body of an asset whose bounding box has its centre (m) and rotation (xyzw) at ``pose``."""
    return Body(name, asset_surface_at_pose(asset, pose, library), library.asset(asset).hollow)


def find_spatial_relations(bodies: Sequence[Body]) -> tuple[Relation, ...]:
    """At most one relation for each pair: ``in`` before ``on`` before ``touching``, which is listed once."""
    pairs = [(one, other, _classify_spatial_relation(one, other)) for one, other in combinations(bodies, 2)]
    return tuple(relation for *_, relation in pairs if relation is not None)


def _classify_spatial_relation(one: Body, other: Body) -> Relation | None:
    """How two bodies lie to each other."""
    reach = CONFIG.gap + max(one.surface.spacing, other.surface.spacing)
    low, high = one.surface_points.min(axis=0) - reach, one.surface_points.max(axis=0) + reach
    if (low >= other.surface_points.max(axis=0)).any() or (high <= other.surface_points.min(axis=0)).any():
        return None
    close = bool(Tree(other.surface_points).find_nearest_points(one.surface_points)[1].min() < reach**2)
    for subject, reference in ((one, other), (other, one)):
        if _is_inside_container(subject.surface_points, reference):
            return Relation(kind="in", subject=subject.name, reference=reference.name)
        if close and _is_resting_on(subject.surface_points, reference.surface_points):
            return Relation(kind="on", subject=subject.name, reference=reference.name)
    return Relation(kind="touching", subject=one.name, reference=other.name) if close else None


def _is_inside_container(points: Array, container: Body) -> bool:
    """Whether (N, 3) points lie in an open container: below its rim, and mostly over its footprint."""
    lowest = points[:, 2].min()
    bottom, top = float(container.surface_points[:, 2].min()), float(container.surface_points[:, 2].max())
    if not container.hollow or not bottom - CONFIG.gap < lowest < top - CONFIG.sunk * (top - bottom):
        return False
    hull = convex_footprint_hull(container.surface_points)
    small = cv2.contourArea(convex_footprint_hull(points).astype(np.float32)) < cv2.contourArea(hull.astype(np.float32))
    return bool(small and points_in_hull_mask(points[:, :2], hull, margin=0.0).mean() > CONFIG.inside)


def _is_resting_on(upper: Array, lower: Array) -> bool:
    """Whether one surface is higher than another, and its underside meets the upper side of that somewhere."""
    raised = upper[:, 2].min() > CONFIG.raised and upper[:, 2].max() > lower[:, 2].max()
    if not raised or upper[:, 2].mean() <= lower[:, 2].mean():
        return False
    origin = np.minimum(upper[:, :2].min(axis=0), lower[:, :2].min(axis=0))
    least = _extreme_height_by_cell(upper, origin, CONFIG.cell, lowest=True)
    most = _extreme_height_by_cell(lower, origin, CONFIG.cell, lowest=False)
    gaps = np.array([least[cell] - most[cell] for cell in least.keys() & most.keys()])
    return bool(len(gaps) >= 3 and (np.abs(gaps) < 2 * CONFIG.gap).sum() >= 3)


def _extreme_height_by_cell(points: Array, origin: Array, size: float, lowest: bool) -> dict[tuple[int, int], float]:
    """The lowest or the highest z in each cell of the grid."""
    order = np.argsort(points[:, 2] if not lowest else -points[:, 2])  # of a cell's points the last one stays
    cells = np.floor((points[order, :2] - origin) / size).astype(int)
    return {(int(row), int(column)): float(z) for (row, column), z in zip(cells, points[order, 2], strict=True)}
