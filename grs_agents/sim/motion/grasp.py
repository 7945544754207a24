"""Grasp search for the suction cup: flat, uncovered points on top of an object, found by ray casting from above."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.motion.tool_paths import Payload
from grs_agents.sim.world.footprints import Prism, find_nearby_prisms, margins_inside_outline, nearest_point_of_outline
from grs_agents.sim.world.physics import Physics

_SPACING: Final = 0.009
_MOST: Final = 120
_FARTHER: Final = 0.0002
"""Cost per candidate point nearer to the centre of mass."""
_ANGLES: Final = np.arange(8) * (np.pi / 4)
_RING: Final = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)

_STEP: Final = 0.005
"""Obstacles no higher than this above the surface do not hinder the cup, metres."""
_GIVE: Final = 0.003
"""Compliance of the lip on a surface that falls away, metres: a ball of more than 12 mm radius seals."""
_CLEAR, _SWAY = 0.0015, 0.005
"""Least clearance around the cup, and the additional clearance that is preferred, metres."""
_AROUND: Final = 0.003
"""Radius beyond the cup at which its surroundings are probed, metres."""
SEALED: Final = 0.7
"""Share of the lip that must be on the object for the cup to hold it."""
_LEAKS: Final = 1.0
"""Least cost of a point without a seal."""


def cup_sealed_fraction(physics: Physics, number: int) -> float:
    """Share of the cup's lip, at its current pose, that lies on an object: 0..1."""
    matrix: FloatArray = np.array(physics.data.site_xmat[physics.world.tip_site]).reshape(3, 3)
    axis, start = matrix[:, 2], np.asarray(physics.tip_position) - 0.02 * matrix[:, 2]
    depth, owner = physics.cast_ray(start, axis)
    if owner != number or abs(depth - 0.02) > 0.02:
        return 0.0
    lip = physics.world.nozzle_for_object(number).lip
    rays = [physics.cast_ray(start + lip * (dx * matrix[:, 0] + dy * matrix[:, 1]), axis) for dx, dy in _RING]
    return sum(other == number and abs(far - depth) <= _GIVE for far, other in rays) / len(rays)


def find_touched_object(physics: Physics, aimed: int = -1) -> tuple[int, float] | None:
    """The object, of those that the cup touches and could hold, under most of its lip, and that share.

    A bead seals however it lies; of a folded rope the cup takes the bead that is ``aimed`` at.
    """
    if not (touching := physics.objects_touching_cup()):
        return None
    touched, beads = touching & physics.world.welds.keys(), physics.world.beads
    if aimed in touched and aimed in beads:
        return aimed, 1.0
    shares = [(number, cup_sealed_fraction(physics, number)) for number in sorted(touched)]
    best, share = max(shares, key=lambda pair: pair[1], default=(-1, 0.0))
    return (best, 1.0 if best in beads else share) if touched else None


def find_object_in_seal(physics: Physics) -> int | None:
    """Id of the object that the cup would hold with suction on, at its current pose."""
    touched = find_touched_object(physics)
    return touched[0] if touched and touched[1] >= SEALED else None


@dataclass(frozen=True)
class GraspSearchResult:
    """Outcome of a grasp search."""

    point: Vec3 | None  # contact point of the cup, metres; None without a valid point
    hindered_by: tuple[int, ...] = ()  # ids of the objects on top of it or beside the cup, most frequent first
    covered_by: frozenset[int] = frozenset()  # of these the objects seen on top of it from above
    trouble: Literal["no_seal", "would_tip"] | None = None  # defect of the best visible point


def find_grasp(physics: Physics, number: int, outline: Prism, others: Sequence[Prism] = ()) -> GraspSearchResult:
    """The flattest open point near an object's centre of mass where the cup seals and the object does not tip off.

    ``others`` are thin obstacles that rays would miss.
    """
    best: tuple[float, Vec3 | None] = (np.inf, None)
    hindering: Counter[int] = Counter()
    covering: set[int] = set()
    nozzle, mass = physics.world.nozzle_for_object(number), physics.object_mass(number)
    center, tips, body = physics.center_of_mass(number), False, nozzle.radius + _CLEAR
    around = find_nearby_prisms(outline, others, (0.0, 0.0), body + _SWAY)
    for rank, (x, y) in enumerate(_candidate_grasp_points(center, outline)):
        if best[0] <= _FARTHER * rank:
            break  # no later point can be better
        height, owner = physics.surface_height_below(x, y)
        if owner != number:
            if owner >= 0 and height > outline.low:
                hindering[owner] += 1
                if physics.cast_ray((x, y, outline.low), (0.0, 0.0, 1.0))[1] == number:  # not beside it
                    covering.add(owner)
            continue
        roughness, obstacle = _estimate_seal_cost(physics, number, x, y, height)
        if obstacle < 0:
            room, neighbour = _suction_cup_clearance(physics, around, body, x, y, height)
            roughness += max(0.0, _SWAY - room)
            obstacle = neighbour if room < 0 else -1
        if obstacle >= 0:
            hindering[obstacle] += 1
            continue
        cost = roughness + (_FARTHER * rank if roughness else 0.0)
        leaks = roughness >= _LEAKS and number not in physics.world.beads
        if leaks or cost >= best[0]:
            continue
        dx, dy, dz = np.subtract((x, y, height), center).tolist()
        payload = Payload(mass, float(np.hypot(dx, dy)), max(0.0, dz), nozzle)
        if payload.would_peel_off_cup and number not in physics.world.limp:  # a rope hangs freely
            tips = True
            continue
        best = (cost, (x, y, height))
        if cost <= _FARTHER * (rank + 1):
            break
    if best[1] is not None:
        return GraspSearchResult(best[1])
    hindered_by = tuple(owner for owner, _ in hindering.most_common())
    return GraspSearchResult(None, hindered_by, frozenset(covering), "would_tip" if tips else "no_seal")


def _candidate_grasp_points(center: Vec3, outline: Prism) -> Iterator[tuple[float, float]]:
    """The centre, which mostly serves, then grid points in order of their distance from it (m)."""
    yield center[:2]
    x0, y0, x1, y1 = outline.bounding_box_xy
    xs = center[0] + np.arange(np.ceil((x0 - center[0]) / _SPACING), (x1 - center[0]) / _SPACING) * _SPACING
    ys = center[1] + np.arange(np.ceil((y0 - center[1]) / _SPACING), (y1 - center[1]) / _SPACING) * _SPACING
    grid = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    inside = grid[margins_inside_outline(np.zeros((1, 2)), outline.outline, grid) > 0.002]
    ordered = inside[np.argsort(np.linalg.norm(inside - np.array(center[:2]), axis=1), kind="stable")]
    step = max(1, (len(ordered) + 1) // _MOST)
    yield from ((x, y) for x, y in ordered[step - 1 :: step].tolist())


def _suction_cup_clearance(
    physics: Physics, others: Sequence[Prism], body: float, x: float, y: float, height: float
) -> tuple[float, int]:
    """Clearance (m) of a cup of radius ``body`` from obstacles beside a point, at most ``_SWAY``, and its owner or -1.

    Rays probe just behind the nearest points of outlines.
    """
    point, room, nearest = np.array([x, y]), _SWAY, -1
    for prism in others:
        if prism.high <= height + _STEP:
            continue
        foot = nearest_point_of_outline(prism.outline, point)
        away = float(np.linalg.norm(foot - point))
        if 0 < away < body + room:
            beyond = foot + (foot - point) * (0.001 / away)
            top, owner = physics.surface_height_below(float(beyond[0]), float(beyond[1]))
            if owner == prism.owner and top > height + _STEP:
                room, nearest = away - body, owner
    return room, nearest


def _estimate_seal_cost(physics: Physics, number: int, x: float, y: float, height: float) -> tuple[float, int]:
    """Seal cost of a point, 0 for a full seal, from ``_LEAKS`` on without seal, and the id of an obstacle, or -1."""
    missing, step, nozzle = 0, 0.0, physics.world.nozzle_for_object(number)
    for dx, dy in _RING:
        for radius in (nozzle.lip, nozzle.radius + _AROUND):
            around, owner = physics.surface_height_below(x + radius * float(dx), y + radius * float(dy))
            if owner != number and around > height + _STEP:
                return 1.0, owner
            if around > height + _GIVE:
                step = 0.05  # a higher part of the object itself: a last resort
            missing += radius == nozzle.lip and (owner != number or abs(around - height) > _GIVE)
    leaks = 1 - missing / len(_RING) < SEALED
    return 0.003 * missing + step + _LEAKS * leaks, -1
