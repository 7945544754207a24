"""Footprints: exact outlines of objects seen from above, as upright prisms around colliders, and their distances."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.shapes import ObjectModel, Shape
from grs_agents.sim.instance.goal import Zone

Value = TypeVar("Value")
Rest = ParamSpec("Rest")
_CIRCLE = 12
_REMEMBERED = 512
_ENDLESS = 10.0
"""Height beyond any arm on a table, metres."""


def cached_per_model(
    function: Callable[Concatenate[ObjectModel, Rest], Value],
) -> Callable[Concatenate[ObjectModel, Rest], Value]:
    """Cache a function's results for the last few hundred models, by identity: models never change."""
    known: dict[int, tuple[ObjectModel, Value]] = {}

    def compute_or_recall(model: ObjectModel, *rest: Rest.args, **more: Rest.kwargs) -> Value:
        entry = known.get(id(model))
        if entry is None:
            if len(known) >= _REMEMBERED:
                known.clear()
            entry = known[id(model)] = (model, function(model, *rest, **more))
        return entry[1]

    return compute_or_recall


@dataclass(frozen=True)
class Prism:
    """An upright prism: a convex outline (K, 2), counter-clockwise, between two heights, metres."""

    outline: FloatArray
    low: float
    high: float
    owner: int = -1

    @cached_property
    def bounding_box_xy(self) -> tuple[float, float, float, float]:
        """(x low, y low, x high, y high)."""
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    @cached_property
    def edge_ranges(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Outward normals (K, 2) of the edges, and the prism's extent along each, from (K,) and to (K,), metres."""
        normals = _outward_edge_normals(self.outline)
        along = self.outline @ normals.T
        return normals, along.min(axis=0), along.max(axis=0)

    @cached_property
    def without_top(self) -> "Prism":
        """The same prism without an upper end: objects can stand beside it, not on it."""
        return replace(self, high=_ENDLESS)


def convex_hull(points: FloatArray) -> FloatArray:
    """The convex hull of points (N, 2) as a counter-clockwise outline (K, 2)."""
    ordered: list[tuple[float, float]] = sorted({(x, y) for x, y in np.round(points, 7).tolist()})
    if len(ordered) < 3:
        return np.array(ordered, dtype=np.float64)

    def half(sequence: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for x, y in sequence:
            while len(chain) >= 2:
                (ax, ay), (bx, by) = chain[-2], chain[-1]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 1e-12:
                    break
                chain.pop()
            chain.append((x, y))
        return chain

    lower, upper = half(ordered), half(reversed(ordered))
    return np.array(lower[:-1] + upper[:-1], dtype=np.float64)


def hull_points_of_shape(shape: Shape) -> FloatArray:
    """Points (3, N) whose convex hull is the shape, object frame; the hull of a round shape is a little larger."""
    if shape.kind == "mesh":
        points = (np.asarray(shape.corners) * np.asarray(shape.size)).T
    elif shape.kind == "box":
        half = np.asarray(shape.size) / 2
        points = np.array(np.meshgrid(*[(-h, h) for h in half], indexing="ij")).reshape(3, -1)
    else:
        radius = shape.size[0]
        half_length = shape.size[1] / 2 if shape.kind == "cylinder" else radius
        angle = np.arange(_CIRCLE) * (2 * np.pi / _CIRCLE)
        ring = radius / np.cos(np.pi / _CIRCLE) * np.array([np.cos(angle), np.sin(angle)])
        points = np.vstack([np.hstack([ring, ring]), np.repeat([-half_length, half_length], _CIRCLE)])
    turned = transforms.IDENTITY if shape.kind == "sphere" else shape.quaternion
    return transforms.transform_points((shape.position, turned), points)


@cached_per_model
def _collider_hull_points(model: ObjectModel) -> tuple[FloatArray, ...]:
    return tuple(map(hull_points_of_shape, model.colliders))


@cached_per_model
def _rotating_collider_points(model: ObjectModel) -> list[tuple[FloatArray, float]]:
    """For each collider its points (3, N) that rotate with the object, and the offset below them in any rotation."""
    parts: list[tuple[FloatArray, float]] = []
    for shape, local in zip(model.colliders, _collider_hull_points(model), strict=True):
        center = np.asarray(shape.position)[:, None]
        parts.append((center, float((local - center)[2].min())) if shape.kind == "sphere" else (local, 0.0))
    return parts


@cached_per_model
def _lowest_point_when_upright(model: ObjectModel) -> float:
    """Height of the lowest point of an upright object's colliders above its origin, whatever its yaw."""
    return min((float(points[2].min()) + drop for points, drop in _rotating_collider_points(model)), default=0.0)


def _collider_points_at_pose(model: ObjectModel, pose: Pose) -> list[FloatArray]:
    """For each collider of an object at ``pose`` points (3, N) whose hull holds it; a ball's never rotate."""
    clouds: list[FloatArray] = []
    for shape, local in zip(model.colliders, _collider_hull_points(model), strict=True):
        if shape.kind == "sphere":
            center = np.asarray(shape.position)[:, None]
            clouds.append(transforms.transform_points(pose, center) + (local - center))
        else:
            clouds.append(transforms.transform_points(pose, local))
    return clouds


def collider_prisms_at_pose(model: ObjectModel, pose: Pose, owner: int = -1) -> list[Prism]:
    """A prism for each collider of an object at ``pose``."""
    clouds = _collider_points_at_pose(model, pose)
    return [Prism(convex_hull(cloud[:2].T), float(cloud[2].min()), float(cloud[2].max()), owner) for cloud in clouds]


def lowest_height_at_pose(model: ObjectModel, pose: Pose) -> float:
    """The height of the lowest point of an object's colliders at ``pose``, metres."""
    x, y, z, w = transforms.to_unit_quaternion(pose[1])
    if x == y == 0:
        return pose[0][2] + _lowest_point_when_upright(model)
    upward = np.array(
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    )  # third row of the rotation matrix
    heights = (float((upward @ points).min()) + drop for points, drop in _rotating_collider_points(model))
    return pose[0][2] + min(heights, default=0.0)


def object_prism_at_pose(model: ObjectModel, pose: Pose, owner: int = -1) -> Prism:
    """Prism around the whole object at ``pose``; flat for a mark without colliders."""
    if model.colliders:
        points = np.hstack(_collider_points_at_pose(model, pose))
    else:
        corners = np.array(np.meshgrid(*zip(*model.bounds, strict=True), indexing="ij"), dtype=np.float64)
        points = transforms.transform_points(pose, corners.reshape(3, -1))
    return Prism(convex_hull(points[:2].T), float(points[2].min()), float(points[2].max()), owner)


@cached_per_model
def _get_prism_cache(model: ObjectModel) -> dict[tuple[Pose, int], tuple[list[Prism], Prism]]:
    """Cache of an object's prisms by pose and owner: each reset puts most objects back where they were."""
    del model
    return {}


def find_prisms_at_pose(model: ObjectModel, pose: Pose, owner: int) -> tuple[list[Prism], Prism]:
    """Prisms of an object's colliders, and the prism around the whole object; cached."""
    known = _get_prism_cache(model)
    prisms = known.get((pose, owner))
    if prisms is None:
        if len(known) >= _REMEMBERED:
            known.clear()
        parts = collider_prisms_at_pose(model, pose, owner)
        if not parts:
            whole = object_prism_at_pose(model, pose, owner)
        elif len(parts) == 1:
            whole = parts[0]
        else:
            outline = convex_hull(np.concatenate([part.outline for part in parts]))
            whole = Prism(outline, min(part.low for part in parts), max(part.high for part in parts), owner)
        prisms = known[pose, owner] = parts, whole
    return prisms


def rectangle_outline(center: tuple[float, float], size: tuple[float, float], yaw: float) -> FloatArray:
    """The outline (4, 2) of a turned rectangle."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.asarray(size) / 2
    return corners @ rotation_matrix_2d(yaw).T + np.asarray(center)


def outline_of_zone(zone: Zone) -> FloatArray:
    """Outline (4, 2) of a zone, seen from above, m."""
    (x, y, _), turn = zone.pose
    return rectangle_outline((x, y), zone.size[:2], transforms.yaw_of_quaternion(turn))


def rotation_matrix_2d(yaw: float) -> FloatArray:
    """The 2 x 2 rotation by ``yaw`` radians."""
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def _outward_edge_normals(outline: FloatArray) -> FloatArray:
    normals = np.empty_like(outline)
    x, y = outline[:, 0], outline[:, 1]
    normals[:-1, 0], normals[-1, 0] = y[1:] - y[:-1], y[0] - y[-1]
    normals[:-1, 1], normals[-1, 1] = x[:-1] - x[1:], x[-1] - x[0]
    return normals / np.maximum(np.sqrt((normals * normals).sum(axis=1, keepdims=True)), 1e-12)


def signed_outline_gaps(moving: FloatArray, still: FloatArray, offsets: FloatArray) -> FloatArray:
    """Gaps (N,) between two convex outlines, ``moving`` shifted by ``offsets`` (N, 2); negative for overlap."""
    if len(moving) < 3 or len(still) < 3:
        return np.full(len(offsets), np.inf)
    axes = np.concatenate([_outward_edge_normals(moving), _outward_edge_normals(still)])
    moved, fixed, shift = moving @ axes.T, still @ axes.T, offsets @ axes.T
    before = fixed.min(axis=0) - (moved.max(axis=0) + shift)
    after = moved.min(axis=0) + shift - fixed.max(axis=0)
    return np.maximum(before, after).max(axis=1)


def least_outline_gaps(moving: FloatArray, others: Sequence[Prism], offsets: FloatArray) -> FloatArray:
    """Least (N,) of the ``signed_outline_gaps`` to each of the other prisms; infinite without any."""
    solid = [other for other in others if len(other.outline) >= 3]
    if len(moving) < 3 or not solid or not len(offsets):
        return np.full(len(offsets), np.inf)
    starts = np.cumsum([0, *(len(other.outline) for other in solid[:-1])])
    axes, points = _outward_edge_normals(moving), np.concatenate([other.outline for other in solid])
    own, along, shift = moving @ axes.T, _project_onto_axes(points, axes), _project_onto_axes(offsets, axes)
    least, most = np.minimum.reduceat(along, starts, axis=1), np.maximum.reduceat(along, starts, axis=1)
    across = np.full((len(solid), len(offsets)), -np.inf)  # along the edges of what moves
    for row, moved in enumerate(shift):
        before, after = least[row] - own[:, row].max(), own[:, row].min() - most[row]
        np.maximum(across, before[:, None] - moved, out=across)
        np.maximum(across, after[:, None] + moved, out=across)
    normals, low, high = (np.concatenate(part) for part in zip(*(other.edge_ranges for other in solid), strict=True))
    own, shift = moving @ normals.T, _project_onto_axes(offsets, normals)
    gaps = _gaps_along_axes(low - own.max(axis=0), own.min(axis=0) - high, shift)
    return np.maximum(across, np.maximum.reduceat(gaps, starts, axis=0)).min(axis=0)


def margins_inside_outline(moving: FloatArray, around: FloatArray, offsets: FloatArray) -> FloatArray:
    """Margins (N,) of an outline shifted by ``offsets`` inside a convex outline; negative if it sticks out."""
    axes = _outward_edge_normals(around)
    limit = (around * axes).sum(axis=1)
    margins = limit[:, None] - ((moving @ axes.T).max(axis=0)[:, None] + _project_onto_axes(offsets, axes))
    return np.asarray(np.minimum.reduce(margins, axis=0))


def rest_heights_at_offsets(body: Prism, obstacles: Iterable[Prism], offsets: FloatArray, gap: float) -> FloatArray:
    """Heights (N,) at which a body lowered at each offset comes to rest; 0 is the table top."""
    return rest_heights_for_gaps(body, obstacles, offsets, (gap,))[0]


def rest_heights_for_gaps(
    body: Prism, obstacles: Iterable[Prism], offsets: FloatArray, gaps: Sequence[float]
) -> FloatArray:
    """``rest_heights_at_offsets`` for several gaps, (G, N): an obstacle nearer than the gap carries the body."""
    heights = np.zeros((len(gaps), len(offsets)))
    if not len(offsets) or len(body.outline) < 3:
        return heights
    columns = np.ascontiguousarray(offsets.T)  # see `_project_onto_axes`
    low, high = body.outline.min(axis=0) + columns.min(axis=1), body.outline.max(axis=0) + columns.max(axis=1)
    x2, y2, x3, y3 = low[0] - max(gaps), low[1] - max(gaps), high[0] + max(gaps), high[1] + max(gaps)
    axes, least, most = body.edge_ranges
    shift = _project_onto_axes(offsets, axes)
    for obstacle in obstacles:
        x0, y0, x1, y1 = obstacle.bounding_box_xy
        if x0 > x3 or y0 > y3 or x1 < x2 or y1 < y2 or len(obstacle.outline) < 3:
            continue
        along = obstacle.outline @ axes.T
        apart = _largest_gap(along.min(axis=0) - most, least - along.max(axis=0), shift)
        normals, near, far = obstacle.edge_ranges
        own = body.outline @ normals.T
        sideways = _largest_gap(near - own.max(axis=0), own.min(axis=0) - far, _project_onto_axes(offsets, normals))
        np.maximum(apart, sideways, out=apart)
        for row, gap in zip(heights, gaps, strict=True):
            np.maximum(row, obstacle.high, out=row, where=apart < gap)
    return heights


def _project_onto_axes(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Projections (K, N) of points (N, 2) onto axes (K, 2), contiguous: numpy reduces long rows fastest."""
    return np.ascontiguousarray((points @ axes.T).T)


def _largest_gap(before: FloatArray, after: FloatArray, moved: FloatArray) -> FloatArray:
    """Largest (N,) of the gaps along axes (K,), before and after a body moved along them by (K, N)."""
    return np.asarray(np.maximum.reduce(_gaps_along_axes(before, after, moved), axis=0))


def _gaps_along_axes(before: FloatArray, after: FloatArray, moved: FloatArray) -> FloatArray:
    """Gaps (K, N) along axes (K,), before or after a body moved along them by (K, N)."""
    gaps = before[:, None] - moved
    return np.maximum(gaps, after[:, None] + moved, out=gaps)


def rest_height_of_prisms(body: Sequence[Prism], obstacles: Sequence[Prism], offset: FloatArray, gap: float) -> float:
    """Height at which the underside of a body of several prisms comes to rest, lowered at an offset (1, 2).

    Unlike a single prism around it, the body fits into cavities of its shape: an L into an L.
    """
    low = min(prism.low for prism in body)
    return max(float(rest_heights_at_offsets(prism, obstacles, offset, gap)[0]) - (prism.low - low) for prism in body)


def find_nearby_prisms(prism: Prism, others: Iterable[Prism], offset: Sequence[float], reach: float) -> list[Prism]:
    """Prisms that may be within ``reach`` (m) of a prism shifted by an offset (2,), seen from above."""
    (x0, y0, x1, y1), (dx, dy) = prism.bounding_box_xy, offset
    x0, y0, x1, y1 = x0 + dx - reach, y0 + dy - reach, x1 + dx + reach, y1 + dy + reach
    boxes = ((other, other.bounding_box_xy) for other in others)
    return [other for other, (x2, y2, x3, y3) in boxes if x2 <= x1 and y2 <= y1 and x3 >= x0 and y3 >= y0]


def nearest_point_of_outline(outline: FloatArray, point: FloatArray) -> FloatArray:
    """Point (2,) of a convex outline, or inside it, nearest to ``point`` (2,)."""
    edges = np.roll(outline, -1, axis=0) - outline
    length = np.maximum((edges**2).sum(axis=1), 1e-12)
    share = np.clip(((point - outline) * edges).sum(axis=1) / length, 0.0, 1.0)
    feet = outline + share[:, None] * edges
    away = np.linalg.norm(feet - point, axis=1)
    inside = margins_inside_outline(np.zeros((1, 2)), outline, point[None])[0] >= 0
    return point if inside else np.asarray(feet[int(np.argmin(away))])


def intersect_outlines(first: FloatArray, second: FloatArray) -> FloatArray:
    """Intersection of two convex outlines, an outline (K, 2); empty if they are apart (Sutherland-Hodgman clipping)."""
    kept = first
    for start, normal in zip(second, _outward_edge_normals(second), strict=True):
        if not len(kept):
            break
        depth = (kept - start) @ normal
        after, beyond = np.roll(kept, -1, axis=0), np.roll(depth, -1)
        share = np.where(depth == beyond, 0.0, depth / np.where(depth == beyond, 1.0, depth - beyond))
        crossing = (depth > 0) != (beyond > 0)
        rows = np.stack([kept, kept + share[:, None] * (after - kept)], axis=1).reshape(-1, 2)
        kept = rows[np.stack([depth <= 0, crossing], axis=1).ravel()]
    return kept


def distance_between_outlines(first: FloatArray, second: FloatArray) -> float:
    """Distance between two convex outlines, metres; 0 if they overlap."""
    if signed_outline_gaps(first, second, np.zeros((1, 2)))[0] <= 0:
        return 0.0
    return min(_min_distance_to_edges(first, second), _min_distance_to_edges(second, first))


def _min_distance_to_edges(points: FloatArray, outline: FloatArray) -> float:
    """Least distance from any of the points (N, 2) to any edge of an outline."""
    edges = np.roll(outline, -1, axis=0) - outline
    length = np.maximum((edges**2).sum(axis=1), 1e-12)
    offset = points[:, None] - outline[None]
    share = np.clip((offset * edges).sum(axis=2) / length, 0.0, 1.0)
    return float(np.linalg.norm(offset - share[..., None] * edges, axis=2).min())
