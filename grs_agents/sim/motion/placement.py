"""Where there is room: random free poses, and tight packing of several objects into a region.
The ways of choosing a target share what the arm can serve, and how targets are named."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.world.footprints import (
    Prism,
    least_outline_gaps,
    margins_inside_outline,
    rectangle_outline,
    rest_heights_for_gaps,
    rotation_matrix_2d,
)

_BATCH: Final = 256
_BATCHES: Final = 16
"""Yaws that are tried before there is said to be no room: with 6, every sixth draw for a zone of 10 x 29 cm among 11
things found none, with 16 none of 100 did; a vain draw takes 10 ms."""
_FLUSH: Final = 0.003
_LEVEL: Final = 0.012
"""Supports that differ by less than this are one level, metres."""


def sample_free_pose(
    size: Sequence[float],
    bounds: FloatArray,
    obstacles: Sequence[Prism],
    rng: np.random.Generator,
    arm: Arm,
    gap: float = 0.01,
) -> Pose | None:
    """A free pose on the table, in reach, for a box of ``size`` (m; signs ignored) with ``gap`` around it, or None.

    Remembered, with the state it leaves ``rng`` in: each reset of an environment draws most places as the one before.
    """
    sides, before = tuple(max(abs(float(extent)), 0.001) for extent in size), rng.bit_generator.state
    key = (sides, bounds.tobytes(), repr(before), tuple(map(id, obstacles)), id(arm), gap)
    if key not in _drawn:
        if len(_drawn) >= _REMEMBERED:
            _drawn.clear()
        pose = _sample_free_pose(sides, bounds, obstacles, rng, arm, gap)
        _drawn[key] = _CachedPoseSample(pose, rng.bit_generator.state, (*obstacles, arm))
    rng.bit_generator.state = _drawn[key].state
    return _drawn[key].pose


@dataclass(frozen=True)
class _CachedPoseSample:
    """A pose that was drawn, if there was one."""

    pose: Pose | None
    state: Any  # of the generator afterwards
    kept: tuple[Any, ...]  # what the key tells by identity


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
    x, y, z = size
    for _ in range(_BATCHES):
        yaw = float(rng.uniform(-np.pi, np.pi))
        outline = rectangle_outline((0.0, 0.0), (x, y), yaw)
        offsets = rng.uniform(bounds[:2, 0], bounds[:2, 1], size=(_BATCH, 2))
        chosen = _find_first_free_offset(outline, z, offsets, bounds, obstacles, arm, gap)
        if chosen is not None:
            rotation = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, yaw))
            return (float(chosen[0]), float(chosen[1]), z / 2), rotation
    return None


def _find_first_free_offset(
    outline: FloatArray,
    top: float,
    offsets: FloatArray,
    bounds: FloatArray,
    others: Sequence[Prism],
    arm: Arm,
    gap: float,
) -> FloatArray | None:
    """The first (2,) of some offsets (N, 2) that is free and in reach."""
    (x0, x1), (y0, y1) = bounds[:2]
    around = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    free = offsets[margins_inside_outline(outline, around, offsets) >= 0]
    for height in (top, top + 0.15):
        free = free[arm.reachable_mask(np.column_stack([free, np.full(len(free), height)]))]
    free = free[least_outline_gaps(outline, others, free) >= gap]
    return np.asarray(free[0]) if len(free) else None


@dataclass(frozen=True)
class Region:
    """A turned rectangle on the table: centre (m), full extents (m), yaw (rad)."""

    center: tuple[float, float]
    size: tuple[float, float]
    yaw: float

    @property
    def corner_points(self) -> FloatArray:
        """Its corners (4, 2)."""
        return rectangle_outline(self.center, self.size, self.yaw)

    def grid_points(self, spacing: float) -> FloatArray:
        """Points (N, 2) that cover it, its centre among them."""
        axes = [np.arange(-int(extent / 2 / spacing), int(extent / 2 / spacing) + 1) * spacing for extent in self.size]
        local = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        return local @ rotation_matrix_2d(self.yaw).T + np.asarray(self.center)


@dataclass(frozen=True)
class Spot:
    """A place for an object: its centre (m), how far it is turned from now (rad), the height it rests at (m)."""

    center: tuple[float, float]
    turn: float
    height: float


def rotated_outline_at_origin(body: Prism, center: FloatArray, angle: float) -> Prism:
    """A body's outline about its own centre, turned and moved to the origin."""
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
    """A place inside a region where an object rests on the lowest level there is, clear of its neighbours.

    Of ``yaws`` the first one is taken with which it rests lowest; ``suits`` says which offsets (N, 2) and rest heights
    (N,) the arm can serve. With ``spread``, places far from the edge and from others but close to ``near`` are
    preferred, else the far corner; with ``stack``, any level will do.
    """
    offsets = region.grid_points(float(np.clip(min(region.size) / 24, 0.003, 0.015)))
    best: Spot | None = None
    for angle in yaws:
        shape = rotated_outline_at_origin(body, np.asarray(center[:2]), angle)
        within = margins_inside_outline(shape.outline, region.corner_points, offsets) >= 0.0005
        if not within.any():
            continue
        inside = offsets[within]
        neighbours = _obstacles_near_region(obstacles, region, shape)
        heights, resting = rest_heights_for_gaps(shape, neighbours, inside, (gap, gap if stack else -0.002))
        floor = float(resting.min())
        rows = np.arange(len(heights)) if stack else np.flatnonzero(heights <= max(floor, 0.0) + _LEVEL)
        rows = rows[suits(inside[rows], heights[rows])]
        steady = rows[_is_center_supported(inside[rows], heights[rows], neighbours)]
        rows = steady if len(steady) else rows
        if len(rows):
            points, levels = inside[rows], heights[rows]
            chosen = _choose_spot_index(points, levels, region, near or region.center if spread else None)
            spot = Spot((float(points[chosen, 0]), float(points[chosen, 1])), angle, float(levels[chosen]))
            if best is None or spot.height < best.height - _LEVEL:
                best = spot
            if best.height <= _LEVEL:
                break  # on the table, or on a floor: nothing is lower
    return best


def _is_center_supported(offsets: FloatArray, heights: FloatArray, obstacles: Sequence[Prism]) -> npt.NDArray[np.bool_]:
    """Where (N,) a body's centre is over what carries it: it will not tip, as it would on a rim."""
    supported = heights < _FLUSH
    levels = set[float](heights[~supported].tolist())  # tops of obstacles, so that they are few
    for prism in obstacles:
        if any(abs(level - prism.high) < _FLUSH for level in levels):
            near = ~supported & (np.abs(heights - prism.high) < _FLUSH)
            supported |= near & (margins_inside_outline(np.zeros((1, 2)), prism.outline, offsets) > 0)
    return supported


def _obstacles_near_region(obstacles: Sequence[Prism], region: Region, shape: Prism) -> list[Prism]:
    reach = float(np.hypot(*region.size)) / 2 + float(np.linalg.norm(shape.outline, axis=1).max()) + 0.05
    x, y = region.center
    boxes = ((obstacle, obstacle.bounding_box_xy) for obstacle in obstacles)
    return [
        obstacle
        for obstacle, (x0, y0, x1, y1) in boxes
        if math.hypot(max(x0 - x, 0.0, x - x1), max(y0 - y, 0.0, y - y1)) < reach
    ]


def _choose_spot_index(points: FloatArray, heights: FloatArray, region: Region, near: Sequence[float] | None) -> int:
    """The row nearest a point, else the first one from the region's far corner on, low levels first."""
    if near is not None:
        return int(np.argmin(np.linalg.norm(points - np.asarray(near[:2]), axis=1) + heights))
    local = (points - np.asarray(region.center)) @ rotation_matrix_2d(region.yaw)
    return int(np.lexsort((-local[:, 1], -local[:, 0], np.round(heights, 2)))[0])


TALLEST_STACK: Final = 0.32
"""The arm carries things safely over stacks up to this height, metres."""
_APPROACH: Final = 0.04


@dataclass(frozen=True)
class BlockedTarget:
    """The target is taken by something that can be moved away first."""

    blocker: int
    keep_free: tuple[Prism, ...] = ()  # where it must not be put
    otherwise: Spot | None = None  # the target all the same, if the blocker cannot be moved; None if it must be


Target = Spot | BlockedTarget | Stop


def wrap_angle(angle: float, period: float = 2 * np.pi) -> float:
    """The angle nearest zero that differs by a multiple of ``period``."""
    return float(angle - period * np.round(angle / period))


@dataclass(frozen=True)
class ReachTest:
    """A test of offsets (N, 2) and rest heights (N,): can the arm bring the cup there and come down from above?"""

    lift: float
    arm: Arm

    def __call__(self, offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        tips = np.column_stack([offsets, heights + self.lift])
        above = tips + np.array([0.0, 0.0, _APPROACH])
        low, high = self.arm.reachable_mask(np.concatenate([tips, above])).reshape(2, -1)
        return low & high


def describe_out_of_reach(tip: Sequence[float], arm: Arm) -> str:
    """How a point lies out of reach, in words."""
    distance = float(np.hypot(tip[0], tip[1]))
    if distance > arm.farthest:
        return f"is {distance:.2f} m from the base, reach is {arm.farthest:.2f} m"
    if distance < arm.nearest:
        return f"is {distance:.2f} m from the base, nearest is {arm.nearest:.2f} m"
    return f"cannot be reached at height {tip[2]:.2f} m with the tool down, {distance:.2f} m from the base"


def format_point(point: Sequence[float]) -> str:
    """A point (x, y, z) in words, to the centimetre."""
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
