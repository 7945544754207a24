"""Which object lies on, in or against which, by the surfaces of what stands for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import hull_of, inside_hull
from grs_agents.perception.surfaces import Surface, Tree, asset_surface_at
from grs_agents.perception.types import Array, Relation

CONFIG = DEFAULT.relations


@dataclass(frozen=True)
class Body:
    """What stands for an object."""

    name: str  # the object's
    surface: Surface  # robot frame
    hollow: bool  # open at the top

    @property
    def points(self) -> Array:
        """(N, 3) of its surface, m, robot frame."""
        return self.surface.points


def body_of(name: str, asset: str, pose: Pose, library: Library) -> Body:
    """The body of an asset whose bounding box has its centre (m) and rotation (xyzw) at ``pose``."""
    return Body(name, asset_surface_at(asset, pose, library), library.asset(asset).hollow)


def relations(bodies: Sequence[Body]) -> tuple[Relation, ...]:
    """At most one relation for each pair: ``in`` before ``on`` before ``touching``, which is listed once."""
    pairs = [(one, other, _relation(one, other)) for one, other in combinations(bodies, 2)]
    return tuple(relation for *_, relation in pairs if relation is not None)


def _relation(one: Body, other: Body) -> Relation | None:
    """How two bodies lie to each other."""
    reach = CONFIG.gap + max(one.surface.spacing, other.surface.spacing)
    low, high = one.points.min(axis=0) - reach, one.points.max(axis=0) + reach
    if (low >= other.points.max(axis=0)).any() or (high <= other.points.min(axis=0)).any():
        return None
    close = bool(Tree(other.points).nearest(one.points)[1].min() < reach**2)
    for subject, reference in ((one, other), (other, one)):
        if _is_in(subject.points, reference):
            return Relation(kind="in", subject=subject.name, reference=reference.name)
        if close and _is_on(subject.points, reference.points):
            return Relation(kind="on", subject=subject.name, reference=reference.name)
    return Relation(kind="touching", subject=one.name, reference=other.name) if close else None


def _is_in(points: Array, container: Body) -> bool:
    """Whether (N, 3) points lie in an open container: below its rim, and mostly over its footprint."""
    lowest = points[:, 2].min()
    bottom, top = float(container.points[:, 2].min()), float(container.points[:, 2].max())
    if not container.hollow or not bottom - CONFIG.gap < lowest < top - CONFIG.sunk * (top - bottom):
        return False
    hull = hull_of(container.points)
    smaller = cv2.contourArea(hull_of(points).astype(np.float32)) < cv2.contourArea(hull.astype(np.float32))
    return bool(smaller and inside_hull(points[:, :2], hull, margin=0.0).mean() > CONFIG.inside)


def _is_on(upper: Array, lower: Array) -> bool:
    """Whether one surface is higher than another, and its underside meets the upper side of that somewhere."""
    raised = upper[:, 2].min() > CONFIG.raised and upper[:, 2].max() > lower[:, 2].max()
    if not raised or upper[:, 2].mean() <= lower[:, 2].mean():
        return False
    origin = np.minimum(upper[:, :2].min(axis=0), lower[:, :2].min(axis=0))
    least, most = _by_cell(upper, origin, CONFIG.cell, lowest=True), _by_cell(lower, origin, CONFIG.cell, lowest=False)
    gaps = np.array([least[cell] - most[cell] for cell in least.keys() & most.keys()])
    return bool(len(gaps) >= 3 and (np.abs(gaps) < 2 * CONFIG.gap).sum() >= 3)


def _by_cell(points: Array, origin: Array, size: float, lowest: bool) -> dict[tuple[int, int], float]:
    """The lowest or the highest z in each cell of the grid."""
    order = np.argsort(points[:, 2] if not lowest else -points[:, 2])  # of a cell's points the last one stays
    cells = np.floor((points[order, :2] - origin) / size).astype(int)
    return {(int(row), int(column)): float(z) for (row, column), z in zip(cells, points[order, 2], strict=True)}
