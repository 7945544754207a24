"""Few convex solids that stand for a shape in contact: flat below and on top, hollow where the shape is."""

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
    """A closed mesh, with its foot and its top made flat."""

    vertices: Array  # (V, 3) m, object frame
    faces: npt.NDArray[np.int64]  # (F, 3)

    @classmethod
    def from_shape(cls, shape: ObjectShape) -> "_Body":
        vertices = shape.mesh.vertices.copy()
        height = float(vertices[:, 2].max())
        vertices[vertices[:, 2] < min(CONFIG.foot, height / 4), 2] = 0.0
        seat = max(_suction_seat_height(vertices), height * CONFIG.highest)
        vertices[:, 2] = np.minimum(vertices[:, 2], seat)
        vertices[vertices[:, 2] > seat - min(CONFIG.top, height / 4), 2] = seat
        return cls(vertices, shape.mesh.faces)

    @property
    def volume(self) -> float:
        """In the mesh, m^3."""
        return abs(mesh_volume(self.vertices, self.faces))

    @property
    def edges(self) -> Segments:
        """Its edges."""
        one, two = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).T
        both = np.unique(one * len(self.vertices) + two)
        return self.vertices[np.stack(np.divmod(both, len(self.vertices)), axis=1)]


def fit_colliders(shape: ObjectShape, solid: Solid, hollow: bool) -> tuple[Collider, ...]:
    """The simplest colliders that are near enough to a shape: a box or a cylinder, a ring of hulls on a floor or four
    walls where one can put something into it, its hull, or the hulls of pieces of it.

    Args:
        solid: what its box is filled with, where its walls were not measured.
        hollow: whether one can put something into it, though its shape may not show it.
    """
    body = _Body.from_shape(shape)
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    if shape.walls is not None:
        axis = _lathe_axis_position(shape)
        return (*ring_colliders(shape.walls, axis), *_hull_of_protruding_handle(shape.mesh.vertices, shape.walls, axis))
    if (shape.hollow or hollow) and (high - low).min() > 4 * CONFIG.wall:
        middle = (low + high)[:2] / 2
        return (
            open_box_colliders(low, high)
            if solid == "box" or shape.method == "box"
            else ring_colliders(_wall_profile_about_center(body, middle), middle)
        )
    primitive = _fit_box_or_cylinder(body)
    if primitive is not None:
        return (primitive,)
    return tuple(Hull(corners) for corners in split_into_hulls(body)) or (_box_between(low, high),)


def _box_between(low: Array, high: Array) -> Shape:
    """A box between two corners, (3,) m, no thinner than what touches may be."""
    size = np.maximum(high - low, CONFIG.thinnest)
    return Shape(kind="box", size=to_vec3(size), position=to_vec3(low + size / 2))


def lower_underside(colliders: Sequence[Collider], by: float) -> tuple[Collider, ...]:
    """Colliders that reach down ``by`` so much more (m) where they are lowest."""
    ends = [one.corners[:, 2].min() if isinstance(one, Hull) else shape_bounds(one)[0][2] for one in colliders]
    foot = min(ends) + CONFIG.foot
    return tuple(_lengthen_down(one, foot, by) if end < foot else one for one, end in zip(colliders, ends, strict=True))


def _lengthen_down(collider: Collider, below: float, by: float) -> Collider:
    """A box or an upright cylinder longer ``by`` so much (m), or a hull whose corners ``below`` a height are lower."""
    if isinstance(collider, Hull):
        return Hull(collider.corners - np.where(collider.corners[:, 2:] < below, (0, 0, by), 0.0))
    (x, y, z), sizes = collider.position, list(collider.size)
    sizes[-1 if collider.kind == "box" else 1] += by
    return collider.model_copy(update={"size": tuple(sizes), "position": (x, y, z - by / 2)})


def _hull_of_protruding_handle(vertices: Array, walls: Array, axis: Array) -> tuple[Collider, ...]:
    """The hull of what of a surface sticks out of its walls, if anything does."""
    beyond = np.linalg.norm(vertices[:, :2] - axis, axis=1) - np.interp(vertices[:, 2], walls[:, 2], walls[:, 1])
    handle = vertices[beyond > CONFIG.wall]
    wide = len(handle) > 3 and np.ptp(handle, axis=0).min() > CONFIG.wall
    return (Hull(reduce_to_corners(handle)),) if wide else ()


def _wall_profile_about_center(body: "_Body", middle: Array) -> Array:
    """Walls (N, 3) as in `ObjectShape` that are as wide as a body about its ``middle`` (2,), m."""
    walls: list[tuple[float, float, float]] = []
    edges, bottom, top = body.edges, float(body.vertices[:, 2].min()), float(body.vertices[:, 2].max())
    for height in np.linspace(CONFIG.wall, top, CONFIG.levels).tolist():
        seen = max(height, bottom)  # a shape may begin above what it stands on
        crossing = (edges[..., 2].min(axis=1) <= seen) & (edges[..., 2].max(axis=1) >= seen)
        start, end = edges[crossing].transpose(1, 0, 2)
        share = (seen - start[:, 2]) / np.where(end[:, 2] == start[:, 2], np.inf, end[:, 2] - start[:, 2])
        level = start + share[:, None] * (end - start)
        radius = float(np.percentile(np.linalg.norm(level[:, :2] - middle, axis=1), CONFIG.outermost))
        walls.append((max(radius - CONFIG.wall, CONFIG.wall), max(radius, 2 * CONFIG.wall), height))
    return np.array(walls)


def _suction_seat_height(vertices: Array) -> float:
    """How far up a surface is wide enough for a suction cup, m."""
    bearings = np.arange(CONFIG.bearings) * np.pi / CONFIG.bearings
    downwards = vertices[np.argsort(-vertices[:, 2])]
    across = downwards[:, :2] @ np.stack([np.cos(bearings), np.sin(bearings)])
    wide = np.maximum.accumulate(across) - np.minimum.accumulate(across) >= CONFIG.seat
    return float(downwards[int(wide.all(axis=1).argmax()), 2])


def _fit_box_or_cylinder(body: _Body) -> Shape | None:
    """The upright box or cylinder that a solid is, and fills, if it is one."""
    corners = body.vertices[body.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    points, weights = corners.mean(axis=1), areas / areas.sum()
    low, high = _weighted_bounds(points, weights)
    low[2], high[2] = 0.0, body.vertices[:, 2].max()
    middle, half = (low + high) / 2, (high - low) / 2
    local = points - middle
    radius = float(half[:2].mean())
    across = np.column_stack([np.hypot(local[:, 0], local[:, 1]) - radius, np.abs(local[:, 2]) - half[2]])
    box = Shape(kind="box", size=to_vec3(2 * half), position=to_vec3(middle))
    cylinder = Shape(kind="cylinder", size=(radius, float(2 * half[2])), position=to_vec3(middle))
    tried = [
        (_mean_distance_to_sides(np.abs(local) - half, weights), box),
        (_mean_distance_to_sides(across, weights), cylinder),
    ]
    off, best = min(tried, key=lambda one: one[0])
    return best if off < CONFIG.primitive and body.volume > CONFIG.convex * shape_volume(best) else None


def _weighted_bounds(points: Array, weights: Array) -> tuple[Array, Array]:
    """Between which coordinates weighted points (N, 3) lie, but for the outermost shares."""
    low, high = np.zeros(3), np.zeros(3)
    for axis in range(3):
        order = np.argsort(points[:, axis])
        places = points[order, axis]
        low[axis], high[axis] = np.interp((CONFIG.stray, 1 - CONFIG.stray), np.cumsum(weights[order]), places)
    return low, high


def _mean_distance_to_sides(beyond: Array, weights: Array) -> float:
    """The mean distance (m) from a surface of weighted points so far (N, D) beyond its sides."""
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return float(np.abs(outside + np.minimum(beyond.max(axis=1), 0)) @ weights)


def _lathe_axis_position(shape: ObjectShape) -> Array:
    """Where the axis of a lathe stands, (2,) m: the middle of the circle at its rim."""
    assert shape.walls is not None
    _, radius, top = shape.walls[-1]
    rim = shape.mesh.vertices[np.abs(shape.mesh.vertices[:, 2] - top) < CONFIG.wall, :2]
    middle = (rim.min(axis=0) + rim.max(axis=0)) / 2
    for _ in range(CONFIG.rounds):
        near = rim[np.abs(np.linalg.norm(rim - middle, axis=1) - radius) < 2 * CONFIG.wall]
        if len(near) < 3:
            break
        away = np.linalg.norm(near - middle, axis=1, keepdims=True)
        middle = middle + 2 * ((1 - radius / np.maximum(away, 1e-9)) * (near - middle)).mean(axis=0)
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
    for first, last in _split_profile_into_straight_bands(np.column_stack([inner, outer]), heights):
        rows = [first, last]
        profile = [(float(radii[row]), float(heights[row])) for row in rows for radii in (inner, outer)]
        profile += low if first == 0 else []
        for start in range(CONFIG.sectors):
            corners = [
                (radius * (1 + out) / 2 * np.cos(angle), radius * (1 + out) / 2 * np.sin(angle), height)
                for radius, height in profile
                for angle in angles[start : start + 2]
            ]
            pieces.append(Hull(np.add(corners, (*axis, 0.0))))
    return tuple(pieces)


def _split_profile_into_straight_bands(radii: Array, heights: Array) -> list[tuple[int, int]]:
    """Between which rows of a profile its walls (N, 2) are nearly straight."""
    first, last = 0, len(heights) - 1
    line = radii[[first]] + (radii[[last]] - radii[[first]]) * ((heights - heights[0]) / np.ptp(heights))[:, None]
    off = np.abs(radii - line).max(axis=1)
    knee = int(off.argmax())
    return [(first, last)] if off[knee] < CONFIG.bent else [(first, knee), (knee, last)]


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
    """What of a solid lies between two corners, (3,) m."""

    low: Array
    high: Array
    size: int  # how many cells its hull fills

    def cut(self, axis: int, share: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """The corners of its two parts, below and above a share of an axis."""
        under, over = self.high.copy(), self.low.copy()
        under[axis] = over[axis] = self.low[axis] + share * (self.high[axis] - self.low[axis])
        return (self.low, under), (over, self.high)


class _Splitter:
    """Counts the cells that hulls of parts of a solid fill, on a coarse copy of its surface."""

    def __init__(self, body: _Body) -> None:
        self.low, self.high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        extents = self.high - self.low
        around = math.prod(extents.tolist())
        counts = np.maximum(np.ceil(extents / (around / CONFIG.cells) ** (1 / 3)), 2).astype(np.int64)
        self.cells = (np.indices(tuple(counts.tolist())).reshape(3, -1).T + 0.5) / counts * extents + self.low
        middles = body.edges.mean(axis=1)
        points = np.concatenate([body.vertices, middles])
        self.reach = float(extents.max()) / CONFIG.points
        step = np.asarray(np.round((points - self.low) / self.reach), np.int64)
        coarse = np.unique(step[:, 0] + (step[:, 1] << 20) + (step[:, 2] << 40), return_index=True)[1]
        self.points = points[coarse]
        self.points_along, self.cells_along = (
            self.points @ _corner_search_directions().T,
            self.cells @ _corner_search_directions().T,
        )
        self.volume = body.volume / around * len(self.cells)

    def piece(self, low: Array, high: Array) -> _Piece:
        """The part between two corners."""
        near = ((self.points >= low - self.reach) & (self.points <= high + self.reach)).all(axis=1)
        if near.sum() < 4:
            return _Piece(low, high, 0)
        along = self.points_along[near]
        own = ((self.cells > low) & (self.cells <= high)).all(axis=1)
        cells = self.cells_along[own]
        return _Piece(low, high, int(((cells >= along.min(axis=0)) & (cells <= along.max(axis=0))).all(axis=1).sum()))

    def split_into_smallest_halves(self, whole: _Piece) -> tuple[_Piece, ...]:
        """The two parts of a piece whose hulls fill least together; none where it is too small to be cut."""
        pairs = [
            [self.piece(*corners) for corners in whole.cut(axis, share)]
            for axis, share in product(range(3), CONFIG.cuts)
            if whole.high[axis] - whole.low[axis] > CONFIG.shortest
        ]
        return tuple(min(pairs, key=lambda pair: sum(part.size for part in pair), default=()))


def split_into_hulls(body: _Body) -> list[Array]:
    """Corners (N, 3) of the hull of a solid, or of few pieces of it whose hulls add little to it together."""
    splitter = _Splitter(body)
    whole = splitter.piece(splitter.low, splitter.high)
    pieces = [whole] if splitter.volume >= CONFIG.convex * whole.size else _split_pieces(splitter, whole)
    hulls = [_hull_corners_within_box(body.edges, one.low, one.high) for one in pieces]
    return [corners for corners in hulls if len(corners) > 3 and np.ptp(corners, axis=0).min() > CONFIG.thinnest]


def _split_pieces(splitter: _Splitter, whole: _Piece) -> list[_Piece]:
    """Pieces of a solid: the one is cut whose hull shrinks most by it, until there are enough."""
    pieces, splits = [whole], [splitter.split_into_smallest_halves(whole)]
    while len(pieces) < CONFIG.most and sum(one.size for one in pieces) > splitter.volume / CONFIG.filled:
        gains = [
            one.size - sum(part.size for part in parts) if parts else 0
            for one, parts in zip(pieces, splits, strict=True)
        ]
        best = int(np.argmax(gains))
        if gains[best] < CONFIG.gain * splitter.volume:
            break
        pieces[best : best + 1] = parts = splits[best]
        splits[best : best + 1] = [splitter.split_into_smallest_halves(part) for part in parts]
    return pieces


def _hull_corners_within_box(edges: Segments, low: Array, high: Array) -> Array:
    """The corners (N, 3) of the hull of what of a surface lies between two corners."""
    for axis, normal in enumerate(np.eye(3)):
        edges = _clip_segments_to_half_space(
            _clip_segments_to_half_space(edges, normal, high[axis] + 1e-9), -normal, 1e-9 - low[axis]
        )
    return reduce_to_corners(edges.reshape(-1, 3)) if len(edges) else edges.reshape(-1, 3)


def _clip_segments_to_half_space(edges: Segments, normal: Array, offset: float) -> Segments:
    """What of segments lies where ``normal @ p <= offset``."""
    ends = edges @ normal - offset
    inside = (ends <= 0).any(axis=1)
    edges, ends = edges[inside], ends[inside]
    length = np.where(np.ptp(ends, axis=1) > 0, ends[:, 0] - ends[:, 1], 1.0)
    crossing = edges[:, 0] + (ends[:, 0] / length)[:, None] * (edges[:, 1] - edges[:, 0])
    return np.where((ends > 0)[..., None], crossing[:, None], edges)


def clip_hull_corners_to_half_space(corners: Array, normal: Array, offset: float) -> Array:
    """The corners (M, 3) of what of a hull of corners (N, 3) lies where ``normal @ p <= offset``; none if nothing does.

    What is left may have a hull that is larger by what `reduce_to_corners` leaves out, and never reaches beyond.
    """
    ends = corners @ normal - offset
    inside, outside = np.flatnonzero(ends <= 0), np.flatnonzero(ends > 0)
    if not len(outside):
        return corners
    kept, gone = (part.ravel() for part in np.meshgrid(inside, outside, indexing="ij"))
    share = ends[kept] / (ends[kept] - ends[gone])
    crossings = corners[kept] + share[:, None] * (corners[gone] - corners[kept])
    left = np.concatenate([corners[inside], crossings])
    return reduce_to_corners(left) if len(left) else left


def reduce_to_corners(points: Array) -> Array:
    """The points of (N, 3) that are farthest in some of many directions, (M, 3): nearly the corners of their hull."""
    spread = points @ _corner_search_directions().T
    return points[np.unique(np.concatenate([spread.argmax(axis=0), spread.argmin(axis=0)]))]


@cache
def _evenly_spread_axes(fineness: int) -> Array:
    """(K, 3) unit vectors, evenly spread, one of each two opposites."""
    every = icosphere(fineness)[0].round(9)
    return np.array([axis for axis in every if tuple(axis[::-1]) > (0.0, 0.0, 0.0)])


@cache
def _corner_search_directions() -> Array:
    """(K, 3) unit vectors: evenly spread, and more that are level or steep, for sides, flat feet and tops."""
    bearings = np.arange(12) * np.pi / 6
    around = np.column_stack([np.cos(bearings), np.sin(bearings)])
    steep = np.column_stack([around, np.full(12, 5.0)]) / np.sqrt(26)
    level = np.column_stack([around[:6], np.zeros(6)])
    return np.concatenate([_evenly_spread_axes(1), steep, level])
