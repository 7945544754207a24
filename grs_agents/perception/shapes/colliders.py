"""Convex colliders of a reconstructed shape: few solids, flat below and on top, hollow where the shape is."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.spheres import icosphere
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.library.mesh_files import mesh_volume
from grs_agents.library.shapes import Shape, shape_bounds, shape_volume
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.types import ObjectShape
from grs_agents.perception.types import Array, Solid

CONFIG = DEFAULT.colliders
Segments = npt.NDArray[np.float64]  # (S, 2, 3) ends of edges, m


@dataclass(frozen=True)
class Hull:
    """A convex solid."""

    corners: Array  # (N, 3) m, object frame


Collider = Shape | Hull
"""A box or cylinder of the library, or a hull; object frame."""


@dataclass(frozen=True)
class _Body:
    """A closed mesh with a flat foot and a flat top."""

    vertices: Array  # (V, 3) m, object frame
    faces: npt.NDArray[np.int64]  # (F, 3)

    @classmethod
    def from_shape(cls, shape: ObjectShape) -> "_Body":
        """Flatten the foot, and the top down to the height at which a suction cup fits in all bearings."""
        vertices = shape.mesh.vertices.copy()
        height = float(vertices[:, 2].max())
        vertices[vertices[:, 2] < min(CONFIG.foot, height / 4), 2] = 0.0
        bearings = np.arange(CONFIG.bearings) * np.pi / CONFIG.bearings
        downwards = vertices[np.argsort(-vertices[:, 2])]
        across = downwards[:, :2] @ np.stack([np.cos(bearings), np.sin(bearings)])
        wide = np.maximum.accumulate(across) - np.minimum.accumulate(across) >= CONFIG.seat
        seat = max(float(downwards[int(wide.all(axis=1).argmax()), 2]), height * CONFIG.highest)
        vertices[:, 2] = np.minimum(vertices[:, 2], seat)
        vertices[vertices[:, 2] > seat - min(CONFIG.top, height / 4), 2] = seat
        return cls(vertices, shape.mesh.faces)

    @property
    def volume(self) -> float:
        """Volume of the mesh, m^3."""
        return abs(mesh_volume(self.vertices, self.faces))

    @property
    def edges(self) -> Segments:
        """(S, 2, 3) each edge once."""
        starts, ends = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).T
        keys = np.unique(starts * len(self.vertices) + ends)
        return self.vertices[np.stack(np.divmod(keys, len(self.vertices)), axis=1)]

    def wall_profile_about(self, middle: Array) -> Array:
        """Walls (N, 3) as in `ObjectShape`, of the width of its cross-sections about its ``middle`` (2,), m."""
        walls: list[tuple[float, float, float]] = []
        edges, bottom, top = self.edges, float(self.vertices[:, 2].min()), float(self.vertices[:, 2].max())
        for height in np.linspace(CONFIG.wall, top, CONFIG.levels).tolist():
            cut = max(height, bottom)  # a shape may begin above its support
            crossing = (edges[..., 2].min(axis=1) <= cut) & (edges[..., 2].max(axis=1) >= cut)
            start, end = edges[crossing].transpose(1, 0, 2)
            share = (cut - start[:, 2]) / np.where(end[:, 2] == start[:, 2], np.inf, end[:, 2] - start[:, 2])
            section = start + share[:, None] * (end - start)
            radius = float(np.percentile(np.linalg.norm(section[:, :2] - middle, axis=1), CONFIG.outermost))
            walls.append((max(radius - CONFIG.wall, CONFIG.wall), max(radius, 2 * CONFIG.wall), height))
        return np.array(walls)

    def fit_box_or_cylinder(self) -> Shape | None:
        """The upright box or cylinder nearest to its surface; ``None`` if it is too far off or not filled."""
        corners = self.vertices[self.faces]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        points, weights = corners.mean(axis=1), areas / areas.sum()
        low, high = np.zeros(3), np.zeros(3)
        for axis in range(2):  # bounds without the outermost shares of the surface
            order = np.argsort(points[:, axis])
            shares = np.cumsum(weights[order])
            low[axis], high[axis] = np.interp((CONFIG.stray, 1 - CONFIG.stray), shares, points[order, axis])
        high[2] = self.vertices[:, 2].max()
        middle, half = (low + high) / 2, (high - low) / 2
        local = points - middle
        radius = float(half[:2].mean())
        across = np.column_stack([np.hypot(local[:, 0], local[:, 1]) - radius, np.abs(local[:, 2]) - half[2]])

        def mean_distance(beyond: Array) -> float:
            """Mean distance (m) from the surface of points that lie so far (N, D) beyond its sides."""
            outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
            return float(np.abs(outside + np.minimum(beyond.max(axis=1), 0)) @ weights)

        box = Shape(kind="box", size=to_vec3(2 * half), position=to_vec3(middle))
        cylinder = Shape(kind="cylinder", size=(radius, float(2 * half[2])), position=to_vec3(middle))
        candidates = [(mean_distance(np.abs(local) - half), box), (mean_distance(across), cylinder)]
        distance, best = min(candidates, key=lambda candidate: candidate[0])
        return best if distance < CONFIG.primitive and self.volume > CONFIG.convex * shape_volume(best) else None


def fit_colliders(shape: ObjectShape, solid: Solid, hollow: bool) -> tuple[Collider, ...]:
    """The simplest colliders that are near enough to a shape: a box or a cylinder, a ring of hulls on a floor or four
    walls if objects can be put into it, its hull, or the hulls of pieces of it.

    Args:
        solid: primitive for a hollow object whose walls were not measured.
        hollow: whether objects can be put into it, though its shape may not show it.
    """
    body = _Body.from_shape(shape)
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    if shape.walls is not None:
        axis = _rim_center(shape.mesh.vertices, shape.walls)
        colliders = list(ring_colliders(shape.walls, axis))
        vertices, heights, outer = shape.mesh.vertices, shape.walls[:, 2], shape.walls[:, 1]
        beyond = np.linalg.norm(vertices[:, :2] - axis, axis=1) - np.interp(vertices[:, 2], heights, outer)
        handle = vertices[beyond > CONFIG.wall]
        if len(handle) > 3 and np.ptp(handle, axis=0).min() > CONFIG.wall:
            colliders.append(Hull(_reduce_to_corners(handle)))
        return tuple(colliders)
    if (shape.hollow or hollow) and (high - low).min() > 4 * CONFIG.wall:
        if solid == "box" or shape.method == "box":
            return open_box_colliders(low, high)
        middle = (low + high)[:2] / 2
        return ring_colliders(body.wall_profile_about(middle), middle)
    primitive = body.fit_box_or_cylinder()
    if primitive is not None:
        return (primitive,)
    hulls = tuple(Hull(corners) for corners in _split_into_hulls(body))
    size = np.maximum(high - low, CONFIG.thinnest)
    return hulls or (Shape(kind="box", size=to_vec3(size), position=to_vec3(low + size / 2)),)


def lower_underside(colliders: Sequence[Collider], by: float) -> tuple[Collider, ...]:
    """The colliders with their lowest parts extended downwards ``by`` a length, m."""
    ends = [part.corners[:, 2].min() if isinstance(part, Hull) else shape_bounds(part)[0][2] for part in colliders]
    foot = min(ends) + CONFIG.foot
    lowered: list[Collider] = []
    for collider, end in zip(colliders, ends, strict=True):
        if end >= foot:
            lowered.append(collider)
        elif isinstance(collider, Hull):
            lowered.append(Hull(collider.corners - np.where(collider.corners[:, 2:] < foot, (0, 0, by), 0.0)))
        else:
            (x, y, z), sizes = collider.position, list(collider.size)
            sizes[-1 if collider.kind == "box" else 1] += by
            lowered.append(collider.model_copy(update={"size": tuple(sizes), "position": (x, y, z - by / 2)}))
    return tuple(lowered)


def _rim_center(vertices: Array, walls: Array) -> Array:
    """(2,) center of the circle of known radius at the rim of a lathe's vertices (V, 3), m."""
    _, radius, top = walls[-1]
    rim = vertices[np.abs(vertices[:, 2] - top) < CONFIG.wall, :2]
    middle = (rim.min(axis=0) + rim.max(axis=0)) / 2
    for _ in range(CONFIG.rounds):
        near = rim[np.abs(np.linalg.norm(rim - middle, axis=1) - radius) < 2 * CONFIG.wall]
        if len(near) < 3:
            break
        distance = np.linalg.norm(near - middle, axis=1, keepdims=True)
        middle = middle + 2 * ((1 - radius / np.maximum(distance, 1e-9)) * (near - middle)).mean(axis=0)
    return middle


def ring_colliders(walls: Array, axis: Array) -> tuple[Collider, ...]:
    """A floor, and a wall of hulls around ``axis`` (2,), m; ``walls`` as in `ObjectShape`."""
    inner, outer, heights = walls[:, 0], walls[:, 1], walls[:, 2]
    floor = max(float(walls[0, 2]), CONFIG.thinnest)
    base = Shape(kind="cylinder", size=(float(outer[0]), floor), position=(float(axis[0]), float(axis[1]), floor / 2))
    inner = np.minimum(inner, outer - CONFIG.thinnest)
    low = [(float(np.interp(0.0, heights, radii)), 0.0) for radii in (outer, inner)]
    pieces: list[Collider] = [base]
    angles = np.arange(CONFIG.sectors + 1) * 2 * np.pi / CONFIG.sectors
    out = 1 / np.cos(np.pi / CONFIG.sectors)  # as large as the round wall on average
    # A bulging profile is split at its knee into two rings.
    radii, last = np.column_stack([inner, outer]), len(heights) - 1
    line = radii[[0]] + (radii[[last]] - radii[[0]]) * ((heights - heights[0]) / np.ptp(heights))[:, None]
    off = np.abs(radii - line).max(axis=1)
    knee = int(off.argmax())
    for rows in [(0, last)] if off[knee] < CONFIG.bent else [(0, knee), (knee, last)]:
        profile = [(float(side[row]), float(heights[row])) for row in rows for side in (inner, outer)]
        profile += low if rows[0] == 0 else []
        for start in range(CONFIG.sectors):
            corners = [
                (radius * (1 + out) / 2 * np.cos(angle), radius * (1 + out) / 2 * np.sin(angle), height)
                for radius, height in profile
                for angle in angles[start : start + 2]
            ]
            pieces.append(Hull(np.add(corners, (*axis, 0.0))))
    return tuple(pieces)


def open_box_colliders(low: Array, high: Array) -> tuple[Shape, ...]:
    """The floor and the four walls of an open box between two corners, (3,) m."""
    x, y, z = high - low
    middle, wall = (low + high) / 2, min(CONFIG.wall, float((high - low).min()) / 4)
    parts = [((x, y, wall), (0.0, 0.0, (wall - z) / 2))]
    parts += [((wall, y, z), (side * (x - wall) / 2, 0.0, 0.0)) for side in (1, -1)]
    parts += [((x, wall, z), (0.0, side * (y - wall) / 2, 0.0)) for side in (1, -1)]
    return tuple(Shape(kind="box", size=to_vec3(size), position=to_vec3(middle + offset)) for size, offset in parts)


@dataclass(frozen=True)
class _Piece:
    """The part of a solid between two corners, (3,) m."""

    low: Array
    high: Array
    size: int  # cells within its hull


class _HullCounter:
    """Counts the cells within the hulls of parts of a solid, on a coarse sample of its surface."""

    def __init__(self, body: _Body) -> None:
        self.low, self.high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        extents = self.high - self.low
        around = math.prod(extents.tolist())
        counts = np.maximum(np.ceil(extents / (around / CONFIG.cells) ** (1 / 3)), 2).astype(np.int64)
        self.cells = (np.indices(tuple(counts.tolist())).reshape(3, -1).T + 0.5) / counts * extents + self.low
        points = np.concatenate([body.vertices, body.edges.mean(axis=1)])
        self.reach = float(extents.max()) / CONFIG.points
        step = np.asarray(np.round((points - self.low) / self.reach), np.int64)
        coarse = np.unique(step[:, 0] + (step[:, 1] << 20) + (step[:, 2] << 40), return_index=True)[1]
        self.points = points[coarse]
        self.points_along = self.points @ _corner_search_directions().T
        self.cells_along = self.cells @ _corner_search_directions().T
        self.volume = body.volume / around * len(self.cells)

    def piece(self, low: Array, high: Array) -> _Piece:
        """The part between two corners."""
        near = ((self.points >= low - self.reach) & (self.points <= high + self.reach)).all(axis=1)
        if near.sum() < 4:
            return _Piece(low, high, 0)
        along = self.points_along[near]
        within = ((self.cells > low) & (self.cells <= high)).all(axis=1)
        cells = self.cells_along[within]
        return _Piece(low, high, int(((cells >= along.min(axis=0)) & (cells <= along.max(axis=0))).all(axis=1).sum()))

    def split(self, whole: _Piece) -> tuple[_Piece, ...]:
        """The two parts of a piece, by an axis-aligned cut, whose hulls fill least; none if it is too small."""
        pairs: list[tuple[_Piece, _Piece]] = []
        for axis, share in product(range(3), CONFIG.cuts):
            if whole.high[axis] - whole.low[axis] > CONFIG.shortest:
                under, over = whole.high.copy(), whole.low.copy()
                under[axis] = over[axis] = whole.low[axis] + share * (whole.high[axis] - whole.low[axis])
                pairs.append((self.piece(whole.low, under), self.piece(over, whole.high)))
        return min(pairs, key=lambda pair: sum(part.size for part in pair), default=())


def _split_into_hulls(body: _Body) -> list[Array]:
    """Corners (N, 3) of the hull of a solid, or of few pieces of it whose hulls fill little more than the solid.

    Greedy: the piece is cut whose hulls shrink most by it.
    """
    counter = _HullCounter(body)
    whole = counter.piece(counter.low, counter.high)
    pieces = [whole]
    if counter.volume < CONFIG.convex * whole.size:
        splits = [counter.split(whole)]
        while len(pieces) < CONFIG.most and sum(piece.size for piece in pieces) > counter.volume / CONFIG.filled:
            gains = [
                piece.size - sum(part.size for part in parts) if parts else 0
                for piece, parts in zip(pieces, splits, strict=True)
            ]
            best = int(np.argmax(gains))
            if gains[best] < CONFIG.gain * counter.volume:
                break
            pieces[best : best + 1] = parts = splits[best]
            splits[best : best + 1] = [counter.split(part) for part in parts]
    hulls: list[Array] = []
    surface = body.edges
    for piece in pieces:
        edges = surface
        for axis, normal in enumerate(np.eye(3)):
            edges = _clip_segments_to_half_space(edges, normal, piece.high[axis] + 1e-9)
            edges = _clip_segments_to_half_space(edges, -normal, 1e-9 - piece.low[axis])
        if len(edges):
            corners = _reduce_to_corners(edges.reshape(-1, 3))
            if len(corners) > 3 and np.ptp(corners, axis=0).min() > CONFIG.thinnest:
                hulls.append(corners)
    return hulls


def _clip_segments_to_half_space(edges: Segments, normal: Array, offset: float) -> Segments:
    """Segments clipped to the half-space ``normal @ p <= offset``."""
    ends = edges @ normal - offset
    inside = (ends <= 0).any(axis=1)
    edges, ends = edges[inside], ends[inside]
    length = np.where(np.ptp(ends, axis=1) > 0, ends[:, 0] - ends[:, 1], 1.0)
    crossing = edges[:, 0] + (ends[:, 0] / length)[:, None] * (edges[:, 1] - edges[:, 0])
    return np.where((ends > 0)[..., None], crossing[:, None], edges)


def clip_hull_corners_to_half_space(corners: Array, normal: Array, offset: float) -> Array:
    """The corners (M, 3) of a hull of corners (N, 3) clipped to the half-space ``normal @ p <= offset``; none if the
    hull lies outside.

    The clipped hull lies within the exact one, as `_reduce_to_corners` may drop corners.
    """
    ends = corners @ normal - offset
    inside, outside = np.flatnonzero(ends <= 0), np.flatnonzero(ends > 0)
    if not len(outside):
        return corners
    kept, gone = (part.ravel() for part in np.meshgrid(inside, outside, indexing="ij"))
    share = ends[kept] / (ends[kept] - ends[gone])
    crossings = corners[kept] + share[:, None] * (corners[gone] - corners[kept])
    left = np.concatenate([corners[inside], crossings])
    return _reduce_to_corners(left) if len(left) else left


def _reduce_to_corners(points: Array) -> Array:
    """(M, 3) the extreme points of (N, 3) in many directions: nearly the corners of their hull."""
    spread = points @ _corner_search_directions().T
    return points[np.unique(np.concatenate([spread.argmax(axis=0), spread.argmin(axis=0)]))]


@cache
def _corner_search_directions() -> Array:
    """(K, 3) unit vectors, each standing for its opposite too: evenly spread, and more that are steep or level, for
    flat feet, tops and sides."""
    even = np.array([axis for axis in icosphere(1)[0].round(9) if tuple(axis[::-1]) > (0.0, 0.0, 0.0)])
    bearings = np.arange(12) * np.pi / 6
    around = np.column_stack([np.cos(bearings), np.sin(bearings)])
    steep = np.column_stack([around, np.full(12, 5.0)]) / np.sqrt(26)
    level = np.column_stack([around[:6], np.zeros(6)])
    return np.concatenate([even, steep, level])
