"""Free space on the table: sampling of free poses, and search for free spots in a region, within the arm's reach."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.world.appearance import TABLE_SIDE
from grs_agents.sim.world.footprints import (
    Prism,
    least_outline_gaps,
    margins_inside_outline,
    rectangle_outline,
    rest_heights_for_gaps,
    rotation_matrix_2d,
    signed_outline_gaps,
)

_BATCH: Final = 256
_BATCHES: Final = 16
"""Yaws tried before giving up: with 6, every sixth draw for a zone of 10 x 29 cm among 11 objects failed, with 16 none
of 100; a failing draw takes 10 ms."""
_OCTAGON: Final = np.array([(np.cos(angle), np.sin(angle)) for angle in np.arange(8) * (np.pi / 4)])
_GRID, _TURN = 0.01, np.pi / 24
"""Spacing (m) and turns (rad) of the grid that is searched when random places fail."""
_FLUSH: Final = 0.003
_LEVEL: Final = 0.012
"""Support heights closer than this are the same level, metres."""


def sample_free_pose(
    size: Sequence[float],
    bounds: FloatArray,
    obstacles: Sequence[Prism],
    rng: np.random.Generator,
    arm: Arm,
    gap: float = 0.01,
    *,
    thorough: bool = False,
) -> Pose | None:
    """A free, reachable pose on the table for a box of ``size`` (m; signs ignored) with ``gap`` (m) around it, or None.

    Random places come first. If none is free, a ``thorough`` search draws one of all free places of a grid: of boxes
    within ``bounds``, or else of boxes that the arm reaches with their centres within ``bounds``.

    Cached with the state it leaves ``rng`` in, since resets of an environment repeat most draws.
    """
    sides, before = tuple(max(abs(float(extent)), 0.001) for extent in size), rng.bit_generator.state
    key = (sides, bounds.tobytes(), repr(before), tuple(map(id, obstacles)), id(arm), gap, thorough)
    if key not in _drawn:
        if len(_drawn) >= _REMEMBERED:
            _drawn.clear()
        pose = _sample_free_pose(sides, bounds, obstacles, rng, arm, gap)
        if pose is None and thorough and len(places := _find_free_places(sides, bounds, obstacles, arm, gap)):
            x, y, yaw = places[rng.integers(len(places))].tolist()
            pose = (x, y, sides[2] / 2), transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, yaw))
        _drawn[key] = _CachedPoseSample(pose, rng.bit_generator.state, (*obstacles, arm))
    rng.bit_generator.state = _drawn[key].state
    return _drawn[key].pose


@dataclass(frozen=True)
class _CachedPoseSample:
    """A drawn pose, or None."""

    pose: Pose | None
    state: Any  # of the generator afterwards
    kept: tuple[Any, ...]  # objects that the key identifies by id, kept alive


_REMEMBERED: Final = 256
_drawn: dict[Any, _CachedPoseSample] = {}


def _sample_free_pose(
    size: Sequence[float],
    bounds: FloatArray,
    obstacles: Sequence[Prism],
    rng: np.random.Generator,
    arm: Arm,
    gap: float,
) -> Pose | None:
    """A pose by rejection sampling: batches of random positions, a random yaw for each batch."""
    x, y, z = size
    (x0, x1), (y0, y1) = bounds[:2]
    around = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    for _ in range(_BATCHES):
        yaw = float(rng.uniform(-np.pi, np.pi))
        outline = rectangle_outline((0.0, 0.0), (x, y), yaw)
        free = rng.uniform(bounds[:2, 0], bounds[:2, 1], size=(_BATCH, 2))
        free = free[margins_inside_outline(outline, around, free) >= 0]
        for height in (z, z + 0.15):
            free = free[arm.reachable_mask(np.column_stack([free, np.full(len(free), height)]))]
        free = free[least_outline_gaps(outline, obstacles, free) >= gap]
        if len(free):
            rotation = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, yaw))
            return (float(free[0, 0]), float(free[0, 1]), z / 2), rotation
    return None


_searched: dict[Any, tuple[FloatArray, tuple[Any, ...]]] = {}


def _find_free_places(
    size: Sequence[float], bounds: FloatArray, obstacles: Sequence[Prism], arm: Arm, gap: float
) -> FloatArray:
    """Free places (N, 3) for a box on a grid: x, y (m) and yaw (rad); cached, as it does not depend on chance."""
    key = (tuple(size), bounds.tobytes(), tuple(map(id, obstacles)), id(arm), gap)
    if key not in _searched:
        if len(_searched) >= _REMEMBERED:
            _searched.clear()
        (x0, x1), (y0, y1) = bounds[:2]
        around = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        sides = np.clip(bounds[:2], -TABLE_SIDE, TABLE_SIDE)  # bounds are a program's, of any size
        grid = np.stack(np.meshgrid(*(np.arange(low, high + _GRID / 2, _GRID) for low, high in sides)), axis=-1)
        centers = grid.reshape(-1, 2)
        heights = (size[2], size[2] + 0.15)
        for height in heights:
            centers = centers[arm.reachable_mask(np.column_stack([centers, np.full(len(centers), height)]))]
        disc = min(size[:2]) / 2 * _OCTAGON  # lies within the box at every yaw
        centers = centers[least_outline_gaps(disc, obstacles, centers) >= gap]
        found: list[FloatArray] = []
        beyond: list[FloatArray] = []
        for yaw in np.arange(0, np.pi, _TURN).tolist():
            outline = rectangle_outline((0.0, 0.0), (size[0], size[1]), yaw)
            free = centers[least_outline_gaps(outline, obstacles, centers) >= gap]
            within = margins_inside_outline(outline, around, free) >= 0
            reached = np.ones(len(free), np.bool_)
            for corner in outline:
                for height in heights:
                    points = np.column_stack([free + corner, np.full(len(free), height)])
                    reached &= arm.reachable_mask(points)
            for kept, mask in ((found, within), (beyond, reached)):
                kept.append(np.column_stack([free[mask], np.full(int(mask.sum()), yaw)]))
        places = np.vstack(found)
        _searched[key] = (places if len(places) else np.vstack(beyond), (*obstacles, arm))
    return _searched[key][0]


def explain_lack_of_space(
    size: Sequence[float], bounds: FloatArray, obstacles: Sequence[Prism], arm: Arm, labels: Mapping[int, str]
) -> str:
    """Explain that no place is free for a box of ``size`` (m; signs ignored): the objects in the way where the fewest
    are, by their ``labels``, and the size that would fit."""
    size = [max(abs(extent), 0.001) for extent in size]
    (x0, x1), (y0, y1) = bounds[:2]
    xs, ys = np.linspace(float(x0), float(x1), 11).tolist(), np.linspace(float(y0), float(y1), 21).tolist()
    centers = np.array([(x, y) for x in xs for y in ys])
    centers = centers[arm.reachable_mask(np.column_stack([centers, np.full(len(centers), size[2])]))]
    fewest: list[str] | None = None
    for yaw in np.arange(0, np.pi, np.pi / 6).tolist():
        outline = rectangle_outline((0.0, 0.0), (size[0], size[1]), yaw)
        gaps = np.array([signed_outline_gaps(outline, prism.outline, centers) for prism in obstacles]) < 0.01
        if gaps.size and (fewest is None or gaps.sum(axis=0).min() < len(fewest)):
            blocking = np.flatnonzero(gaps[:, int(gaps.sum(axis=0).argmin())]).tolist()
            fewest = list(dict.fromkeys(labels.get(obstacles[row].owner, "the background") for row in blocking))
    smaller = (
        f"{share * size[0]:.2f} x {share * size[1]:.2f} m"
        for share in (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3)
        if len(_find_free_places((share * size[0], share * size[1], size[2]), bounds, obstacles, arm, 0.01))
    )
    fits = next(smaller, None)
    way = f", where the fewest are in the way: {' and '.join(fewest)}" if fewest else ""
    return (
        f"no place of {size[0]:.2f} x {size[1]:.2f} m is free in reach of the arm{way}; "
        f"{f'{fits} would fit' if fits else 'a third of that would not fit either'}"
    )


@dataclass(frozen=True)
class Region:
    """A turned rectangle on the table: centre (m), full extents (m), yaw (rad)."""

    center: tuple[float, float]
    size: tuple[float, float]
    yaw: float

    @property
    def corner_points(self) -> FloatArray:
        """Corners (4, 2)."""
        return rectangle_outline(self.center, self.size, self.yaw)

    def grid_points(self, spacing: float) -> FloatArray:
        """Grid points (N, 2) over it, its centre among them."""
        axes = [np.arange(-int(extent / 2 / spacing), int(extent / 2 / spacing) + 1) * spacing for extent in self.size]
        local = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        return local @ rotation_matrix_2d(self.yaw).T + np.asarray(self.center)


@dataclass(frozen=True)
class Spot:
    """A spot for an object: its centre (m), the turn from its current yaw (rad), the rest height (m)."""

    center: tuple[float, float]
    turn: float
    height: float


def rotated_outline_at_origin(body: Prism, center: FloatArray, angle: float) -> Prism:
    """A body's outline turned about its centre and moved to the origin."""
    return Prism((body.outline - center) @ rotation_matrix_2d(angle).T, body.low, body.high, body.owner)


def find_free_spot(
    body: Prism,
    center: Vec3,
    yaws: Sequence[float],
    region: Region,
    obstacles: Sequence[Prism],
    gap: float,
    suits: Callable[[FloatArray, FloatArray], npt.NDArray[np.bool_]],
    *,
    spread: bool = False,
    stack: bool = False,
    near: Vec3 | None = None,
) -> Spot | None:
    """A spot in a region where an object rests at the lowest level available, clear of its neighbours.

    Args:
        yaws: turns to try; the first with the lowest rest height wins.
        gap: clearance around the object, m.
        suits: mask of the offsets (N, 2) and rest heights (N,) that the arm can serve.
        spread: prefer spots close to ``near``, else to the centre; without it, the far corner.
        stack: accept any level.
    """
    reach, (x, y) = float(np.hypot(*region.size)) / 2, region.center
    offsets = region.grid_points(float(np.clip(min(region.size) / 24, 0.003, 0.015)))
    best: Spot | None = None
    for angle in yaws:
        shape = rotated_outline_at_origin(body, np.asarray(center[:2]), angle)
        within = margins_inside_outline(shape.outline, region.corner_points, offsets) >= 0.0005
        if not within.any():
            continue
        inside = offsets[within]
        nearby = reach + float(np.linalg.norm(shape.outline, axis=1).max()) + 0.05
        neighbours = [
            obstacle
            for obstacle, (x0, y0, x1, y1) in ((obstacle, obstacle.bounding_box_xy) for obstacle in obstacles)
            if math.hypot(max(x0 - x, 0.0, x - x1), max(y0 - y, 0.0, y - y1)) < nearby
        ]
        heights, resting = rest_heights_for_gaps(shape, neighbours, inside, (gap, gap if stack else -0.002))
        floor = float(resting.min())
        rows = np.arange(len(heights)) if stack else np.flatnonzero(heights <= max(floor, 0.0) + _LEVEL)
        rows = rows[suits(inside[rows], heights[rows])]
        steady = rows[_is_center_supported(inside[rows], heights[rows], neighbours)]
        rows = steady if len(steady) else rows
        if len(rows):
            points: FloatArray = inside[rows]
            levels: FloatArray = heights[rows]
            if spread:
                wanted = np.asarray((near or region.center)[:2])
                chosen = int(np.argmin(np.linalg.norm(points - wanted, axis=1) + levels))
            else:  # from the far corner of the region on, low levels first
                local = (points - np.asarray(region.center)) @ rotation_matrix_2d(region.yaw)
                chosen = int(np.lexsort((-local[:, 1], -local[:, 0], np.round(levels, 2)))[0])
            spot = Spot((float(points[chosen, 0]), float(points[chosen, 1])), angle, float(levels[chosen]))
            if best is None or spot.height < best.height - _LEVEL:
                best = spot
            if best.height <= _LEVEL:
                break  # on the table, or on a floor: the lowest level
    return best


def _is_center_supported(offsets: FloatArray, heights: FloatArray, obstacles: Sequence[Prism]) -> npt.NDArray[np.bool_]:
    """Mask (N,) of the offsets where a body's centre is over its support, so that it does not tip as on a rim."""
    supported = heights < _FLUSH
    levels = set[float](heights[~supported].tolist())  # tops of obstacles, hence few
    for prism in obstacles:
        if any(abs(level - prism.high) < _FLUSH for level in levels):
            near = ~supported & (np.abs(heights - prism.high) < _FLUSH)
            supported |= near & (margins_inside_outline(np.zeros((1, 2)), prism.outline, offsets) > 0)
    return supported


TALLEST_STACK: Final = 0.32
"""Greatest height of stacks that the arm carries objects over safely, metres."""
APPROACH: Final = 0.04
"""Height of the vertical approach above a place, metres."""


@dataclass(frozen=True)
class BlockedTarget:
    """A target occupied by an object that can be moved away first."""

    blocker: int
    keep_free: tuple[Prism, ...] = ()  # areas where the blocker must not go
    otherwise: Spot | None = None  # the target all the same, if the blocker cannot move; None if it must


Target = Spot | BlockedTarget | Stop


def wrap_angle(angle: float, period: float = 2 * np.pi) -> float:
    """The equivalent angle nearest zero, modulo ``period``."""
    return float(angle - period * np.round(angle / period))


@dataclass(frozen=True)
class ReachTest:
    """Mask of the offsets (N, 2) and rest heights (N,) that the cup can reach, and approach from above."""

    lift: float
    arm: Arm

    def __call__(self, offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        tips = np.column_stack([offsets, heights + self.lift])
        above = tips + np.array([0.0, 0.0, APPROACH])
        low, high = self.arm.reachable_mask(np.concatenate([tips, above])).reshape(2, -1)
        return low & high


def describe_out_of_reach(tip: Sequence[float], arm: Arm) -> str:
    """The reason why a point is out of reach, in words."""
    distance = float(np.hypot(tip[0], tip[1]))
    if distance > arm.farthest:
        return f"is {distance:.2f} m from the base, reach is {arm.farthest:.2f} m"
    if distance < arm.nearest:
        return f"is {distance:.2f} m from the base, nearest is {arm.nearest:.2f} m"
    return f"cannot be reached at height {tip[2]:.2f} m with the tool down, {distance:.2f} m from the base"


def format_point(point: Sequence[float]) -> str:
    """A point (x, y, z) in words, to the centimetre."""
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
