"""Which object lies on, in or against which, told by the surfaces of what stands for them."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.library.shapes import rotation_matrix
from grs_agents.perception.image_geometry import hull_of, inside_hull
from grs_agents.perception.surfaces import Tree, surface_of
from grs_agents.perception.types import Array, Relation, RelationKind

GAP = 0.006
"""Surfaces closer than this (m), beyond how densely they are sampled, touch; depth is not better than that."""
SUNK = 0.3
"""What is in a container begins below its rim by at least this share of the container's height."""
INSIDE = 0.7
"""So much of its outline is above the container."""
RAISED = 0.012
"""What begins lower than this above the table (m) stands on the table."""
CELL = 0.008
"""Heights are compared on a grid so fine, m."""


@dataclass(frozen=True)
class Body:
    """What stands for an object.

    Attributes:
        name: the object's.
        points: (N, 3) of the surface, m, robot frame.
        spacing: about how far they are apart, m.
        hollow: open at the top.
    """

    name: str
    points: Array
    spacing: float
    hollow: bool


def body_of(name: str, asset: str, pose: Pose, library: Library) -> Body:
    """The body of an asset whose bounding box has its centre (m) and rotation (xyzw) at ``pose``.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    surface = surface_of(asset, library)
    points = surface.points @ rotation_matrix(pose[1]).T + pose[0]
    return Body(name, points, surface.spacing, library.asset(asset).hollow)


def relations(bodies: Sequence[Body]) -> tuple[Relation, ...]:
    """At most one relation for each pair: ``in`` before ``on`` before ``touching``, which is told once."""
    trees = [Tree(one.points) for one in bodies]
    found: list[Relation] = []
    for first, one in enumerate(bodies):
        for second in range(first + 1, len(bodies)):
            other = bodies[second]
            if not _near(one, other):
                continue
            reach = GAP + max(one.spacing, other.spacing)
            close = trees[second].nearest(one.points)[1].min() < reach**2
            for subject, reference in ((one, other), (other, one)):
                if (kind := _lies(subject, reference, bool(close))) is not None:
                    found.append(Relation(kind=kind, subject=subject.name, reference=reference.name))
                    break
            else:
                if close:
                    found.append(Relation(kind="touching", subject=one.name, reference=other.name))
    return tuple(found)


def _near(one: Body, other: Body) -> bool:
    reach = GAP + max(one.spacing, other.spacing)
    low, high = one.points.min(axis=0) - reach, one.points.max(axis=0) + reach
    return bool((low < other.points.max(axis=0)).all() and (high > other.points.min(axis=0)).all())


def _lies(subject: Body, reference: Body, close: bool) -> RelationKind | None:
    low, high = subject.points.min(axis=0), subject.points.max(axis=0)
    bottom, top = float(reference.points[:, 2].min()), float(reference.points[:, 2].max())
    if reference.hollow and low[2] < top - SUNK * (top - bottom) and low[2] > bottom - GAP:
        hull = hull_of(reference.points)
        smaller = cv2.contourArea(hull_of(subject.points).astype(np.float32)) < cv2.contourArea(hull.astype(np.float32))
        if smaller and inside_hull(subject.points[:, :2], hull, margin=0.0).mean() > INSIDE:
            return "in"
    higher = low[2] > RAISED and high[2] > top and subject.points[:, 2].mean() > reference.points[:, 2].mean()
    return "on" if close and higher and _rests(subject.points, reference.points) else None


def _rests(upper: Array, lower: Array) -> bool:
    """Whether the underside of one meets the upper side of the other somewhere."""
    origin = np.minimum(upper[:, :2].min(axis=0), lower[:, :2].min(axis=0))
    least, most = _by_cell(upper, origin, lowest=True), _by_cell(lower, origin, lowest=False)
    gaps = np.array([least[cell] - most[cell] for cell in least.keys() & most.keys()])
    return bool(len(gaps) >= 3 and (np.abs(gaps) < 2 * GAP).sum() >= 3)


def _by_cell(points: Array, origin: Array, lowest: bool) -> dict[tuple[int, int], float]:
    """The lowest or the highest z in each cell of the grid."""
    order = np.argsort(points[:, 2] if not lowest else -points[:, 2])  # of a cell's points the last one stays
    cells = np.floor((points[order, :2] - origin) / CELL).astype(int)
    return {(int(row), int(column)): float(z) for (row, column), z in zip(cells, points[order, 2], strict=True)}
