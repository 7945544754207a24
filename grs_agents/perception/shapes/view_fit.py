"""Primitives fitted to the view, and the agreement of a mesh with the photo's mask and depth.

Boxes, solids of revolution, cups and open boxes are fitted by coordinate descent over their lengths.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.perception.proxies.meshes import box_mesh, join_meshes
from grs_agents.perception.shapes.colliders import open_box_colliders
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.lathe import Axis, TurnedSolid, mesh_turned_solid
from grs_agents.perception.shapes.object_crop import ObjectCrop
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array

CONFIG = DEFAULT.view_fit
OPEN_TOP = DEFAULT.open_top
PARALLEL = 1e-12  # a ray's least slope against a pair of sides, which keeps its distances finite


@dataclass(frozen=True)
class Agreement:
    """Agreement of a mesh with the view."""

    overlap: float  # intersection over union of silhouette and mask, where nothing nearer hides the mesh
    raw_error: float  # 90th percentile of |mesh - measured| over the mask's measured pixels that it covers, m
    error: float  # the same of the smoothed depth away from the mask's edge, where pixels do not mix two surfaces
    near: float  # share of those pixels where the mesh is within `ShapeChoice.explained_within` of the depth
    close: float  # and within `ShapeChoice.explained_closely`


def compare_mesh_with_photo(crop: ObjectCrop, vertices: Array, faces: Faces) -> Agreement:
    """Render a mesh from the photo's camera and compare."""
    drawn = crop.render_depth(vertices, faces)
    shown, known = drawn > 0, crop.measured > 0
    hidden = ~crop.mask & known & shown & (crop.measured < drawn - DEFAULT.observation.nearer)
    union = ((shown & ~hidden) | crop.mask).sum()
    both = shown & crop.mask
    raw = np.abs(drawn - crop.measured)[both & known]
    inner = np.abs(drawn - crop.depth)[both & known & (crop.edge < -DEFAULT.choice.inset)]
    within = max(DEFAULT.choice.explained_within, 3 * crop.noise)
    closely = np.clip(2 * crop.noise, DEFAULT.choice.explained_closely, DEFAULT.choice.explained_within)
    return Agreement(
        float(both.sum() / max(union, 1)),
        float(np.percentile(raw, 90)) if len(raw) else np.inf,
        float(np.percentile(inner, 90)) if len(inner) else np.inf,
        float((inner < within).mean()) if len(inner) else 0.0,
        float((inner < closely).mean()) if len(inner) else 0.0,
    )


def cost_of_mesh(crop: ObjectCrop, vertices: Array, faces: Faces) -> float:
    """Silhouette mismatch plus truncated depth residual of a mesh, both in pixels, as a share of the mask."""
    return _cost_of_depth(crop, crop.render_depth(vertices, faces))


def _cost_of_depth(crop: ObjectCrop, drawn: Array) -> float:
    """`cost_of_mesh` of a shape's depth (h, w), m; 0 beside the shape."""
    shown, known = drawn > 0, crop.measured > 0
    hidden = ~crop.mask & known & shown & (crop.measured < drawn - DEFAULT.observation.nearer)
    off = np.minimum(np.abs(drawn - crop.measured)[shown & crop.mask & known] / CONFIG.far, 1.0)
    mismatch = np.count_nonzero((shown & ~hidden) != crop.mask)
    return (mismatch + float(off.sum())) / max(np.count_nonzero(crop.mask), 1)


def fit_box(crop: ObjectCrop, size: tuple[float, float, float]) -> tuple[Array, Faces]:
    """The mesh of the upright box of least cost, starting from the measured box of ``size``, m."""
    small, radius = _reduce_crop(crop), float(np.hypot(*size[:2])) / 2
    rays = (small.lift(np.ones(small.mask.shape, np.float32)) - small.eye).reshape(-1, 3).T

    def extents(values: Array) -> tuple[Array, Array, Array]:
        """Center (3,), half lengths (3,) and rotation (3, 3) of the box."""
        low = np.array([*values[:2], 0.0])
        high = np.maximum(values[2:5], low + CONFIG.thinnest)
        cosine, sine = np.cos(values[5] / radius), np.sin(values[5] / radius)
        return (low + high) / 2, (high - low) / 2, np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])

    def cost(values: Array) -> float:
        """Cost of the box as its rays meet it: the slab method (Kay and Kajiya 1986)."""
        center, half, rotation = extents(values)
        enter, leave = np.zeros(rays.shape[1]), np.full(rays.shape[1], np.inf)
        for along, offset, extent in zip(rotation.T @ rays, (center - small.eye) @ rotation, half, strict=True):
            inverse = 1 / np.where(np.abs(along) < PARALLEL, PARALLEL, along)
            middle, reach = offset * inverse, extent * np.abs(inverse)
            enter, leave = np.maximum(enter, middle - reach), np.minimum(leave, middle + reach)
        return _cost_of_depth(small, np.where(enter <= leave, enter, 0.0).reshape(small.mask.shape))

    measured = np.array([-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2, size[2], 0.0])
    center, half, rotation = extents(_search_lengths(measured, cost, CONFIG.box_steps).values)
    vertices, faces = box_mesh(to_vec3(2 * half), (0.0, 0.0, 0.0), CONFIG.grid)
    return vertices @ rotation.T + center, faces


def fit_turned_solid(crop: ObjectCrop, turned: TurnedSolid) -> TurnedSolid:
    """A solid of revolution, shifted and scaled in radius and height to least cost."""
    small, (vertices, faces) = _reduce_crop(crop), mesh_turned_solid(turned, CONFIG.faces)
    axis, widest = turned.axis, float(turned.profile[:, 0].max())
    foot = np.array([axis.x, axis.y, 0.0])

    def factors(values: Array) -> tuple[float, float]:
        return max(1 + values[2] / widest, CONFIG.least), max(1 + values[3] / turned.top, CONFIG.least)

    def cost(values: Array) -> float:
        wider, higher = factors(values)
        return cost_of_mesh(
            small, foot + np.array([*values[:2], 0.0]) + (vertices - foot) * (wider, wider, higher), faces
        )

    values = _search_lengths(np.zeros(4), cost, CONFIG.turned_steps).values
    wider, higher = factors(values)
    return TurnedSolid(
        replace(axis, x=axis.x + float(values[0]), y=axis.y + float(values[1])),
        turned.profile * (wider, higher),
        turned.outer * (higher, wider),
        None if turned.walls is None else turned.walls * (wider, wider, higher),
    )


def fit_open_top(crop: ObjectCrop, size: tuple[float, float, float]) -> TurnedSolid | tuple[Array, Faces]:
    """The straight-walled cup or the mesh of the open box, whichever costs less, from the measured ``size``, m.

    Of such objects often little but the floor is measured.
    """
    small, radius = _reduce_crop(crop), (size[0] + size[1]) / 4

    def cost_of_cup(values: Array) -> float:
        return cost_of_mesh(small, *mesh_turned_solid(_cup(values, 2), CONFIG.faces))

    def open_box(values: Array, grid: int) -> tuple[Array, Faces]:
        low = np.array([*values[:2], 0.0])
        high = np.maximum(values[2:], low + OPEN_TOP.least)
        return join_meshes([box_mesh(to_vec3(box.size), box.position, grid) for box in open_box_colliders(low, high)])

    def cost_of_box(values: Array) -> float:
        return cost_of_mesh(small, *open_box(values, 1))

    corners = np.array([-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2, size[2]])
    cup = _search_lengths(np.array([0.0, 0.0, radius, radius, size[2]]), cost_of_cup, OPEN_TOP.first_steps)
    box = _search_lengths(corners, cost_of_box, OPEN_TOP.first_steps)
    if cup.cost < box.cost:
        return _cup(_search_lengths(cup.values, cost_of_cup, OPEN_TOP.last_steps).values, OPEN_TOP.levels)
    return open_box(_search_lengths(box.values, cost_of_box, OPEN_TOP.last_steps).values, CONFIG.grid)


def _cup(values: Array, levels: int) -> TurnedSolid:
    """A cup of center x and y, radius of foot and rim, and height (5,), m."""
    x, y, foot, rim, height = (
        float(value) for value in np.maximum(values, (-np.inf, -np.inf, *3 * (OPEN_TOP.least / 2,)))
    )
    heights: Array = np.linspace(0.0, height, levels)
    outer: Array = np.linspace(foot, rim, levels)
    inside: Array = np.concatenate([[OPEN_TOP.wall], heights[1:]])
    around: Array = np.interp(inside, heights, outer)
    walls = np.stack([around - OPEN_TOP.wall, around, inside], axis=1)
    side = np.stack([outer, heights], axis=1)
    profile = np.concatenate([np.zeros((1, 2)), side, walls[::-1, [0, 2]], [(0.0, OPEN_TOP.wall)]])
    return TurnedSolid(Axis(x, y, 1.0, 2 * np.pi), profile, side[:, ::-1], walls)


@dataclass(frozen=True)
class _Fitted:
    """Lengths of a shape and their cost."""

    values: Array  # (N,) m
    cost: float  # see `cost_of_mesh`


def _search_lengths(start: Array, cost: Callable[[Array], float], steps: tuple[float, ...]) -> _Fitted:
    """Coordinate descent: each value moves by a step as long as the cost falls; then by the next, smaller step."""
    best = _Fitted(start, cost(start))
    tried_before: set[tuple[int, ...]] = set()  # in tenths of a micrometre
    for step in steps:
        for _ in range(CONFIG.rounds):
            before = best.cost
            for number in range(len(start)):
                for move in (step, -step):
                    values = best.values.copy()
                    values[number] += move
                    key = tuple(np.rint(values * 1e7).astype(int).tolist())
                    if key in tried_before:
                        continue
                    tried_before.add(key)
                    tried = _Fitted(values, cost(values))
                    if tried.cost < best.cost:
                        best = tried
                        break
            if best.cost == before:
                break
    return best


def _reduce_crop(crop: ObjectCrop) -> ObjectCrop:
    """The crop subsampled for fitting; only its mask, raw depth and intrinsics are reduced."""
    step = max(1, -(-max(crop.mask.shape) // CONFIG.pixels))
    few = np.s_[::step, ::step]
    return replace(
        crop,
        mask=crop.mask[few],
        measured=crop.measured[few],
        focal=(crop.focal[0] / step, crop.focal[1] / step),
        center=(crop.center[0] / step, crop.center[1] / step),
    )
