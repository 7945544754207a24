"""Where the suction cup can take hold: flat, uncovered points on an object's top, found by rays from above."""

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
"""What each point that is nearer to the middle counts against one."""
_ANGLES: Final = np.arange(8) * (np.pi / 4)
_RING: Final = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)

_STEP: Final = 0.005
"""What is no more than this above the surface does not hinder the cup, metres."""
_GIVE: Final = 0.003
"""How far the lip follows a surface that falls away: so a ball of more than 12 mm radius seals, metres."""
_CLEAR, _SWAY = 0.0015, 0.005
"""How near to the cup nothing may stand up, and how much farther off it had better be, metres."""
_AROUND: Final = 0.003
"""How far beside the cup its surroundings are looked at, metres."""
SEALED: Final = 0.7
"""The share of the lip that must be on the object for the cup to hold it."""


_LEAKS: Final = 1.0
"""What a point costs at least at which too little of the lip seals."""


def cup_sealed_fraction(physics: Physics, number: int) -> float:
    """The share of the cup's lip, where the cup is now, that lies on an object: 0..1."""
    matrix: FloatArray = np.array(physics.data.site_xmat[physics.world.tip_site]).reshape(3, 3)
    axis, start = matrix[:, 2], np.asarray(physics.tip_position) - 0.02 * matrix[:, 2]
    depth, owner = physics.cast_ray(start, axis)
    if owner != number or abs(depth - 0.02) > 0.02:
        return 0.0
    lip = physics.world.nozzle_for_object(number).lip
    rays = [physics.cast_ray(start + lip * (dx * matrix[:, 0] + dy * matrix[:, 1]), axis) for dx, dy in _RING]
    return sum(other == number and abs(far - depth) <= _GIVE for far, other in rays) / len(rays)


def find_touched_object(physics: Physics, aimed: int = -1) -> tuple[int, float] | None:
    """Of the objects that the cup touches and could hold, the one on which most of its lip lies, and that share. A bead
    seals however it lies; of a folded rope the cup takes the one that is ``aimed`` at."""
    touched, beads = physics.objects_touching_cup() & physics.world.welds.keys(), physics.world.beads
    if aimed in touched and aimed in beads:
        return aimed, 1.0
    shares = [(number, cup_sealed_fraction(physics, number)) for number in sorted(touched)]
    best, share = max(shares, key=lambda one: one[1], default=(-1, 0.0))
    return (best, 1.0 if best in beads else share) if touched else None


def find_object_in_seal(physics: Physics) -> int | None:
    """Id of the object that the cup, where it is now, would hold if it sucked."""
    found = find_touched_object(physics)
    return found[0] if found and found[1] >= SEALED else None


@dataclass(frozen=True)
class Grasp:
    """What looking down on an object finds."""

    point: Vec3 | None  # where the cup should touch, metres; None if there is no such point
    covered_by: tuple[int, ...] = ()  # ids of what is seen in its place, if it is covered
    trouble: Literal["no_seal", "would_tip"] | None = None  # what is wrong with the best of the points in sight


def find_grasp(physics: Physics, number: int, outline: Prism, others: Sequence[Prism] = ()) -> Grasp:
    """The flattest open point near the centre of an object's mass, where the cup seals and the object does not tip off
    it; ``others`` are thin things that rays would miss."""
    best: tuple[float, Vec3 | None] = (np.inf, None)
    covered: Counter[int] = Counter()
    center, tips = physics.center_of_mass(number), False
    around = find_nearby_prisms(outline, others, (0.0, 0.0), _body_radius(physics, number) + _SWAY)
    for rank, (x, y) in enumerate(_candidate_grasp_points(center, outline)):
        if best[0] <= _FARTHER * rank:
            break  # nothing that is left can be better
        height, roughness, cover = _look_down(physics, number, around, outline.low, (x, y))
        if cover >= 0 or np.isinf(roughness):
            covered[cover] += 1
            continue
        cost = roughness + (_FARTHER * rank if roughness else 0.0)
        leaks = roughness >= _LEAKS and number not in physics.world.beads
        if leaks or cost >= best[0]:
            continue
        if _would_tip_off_cup(physics, number, (x, y, height)):
            tips = True
            continue
        best = (cost, (x, y, height))
        if cost <= _FARTHER * (rank + 1):
            break
    return _make_grasp_or_reason(best[1], covered, tips)


def _make_grasp_or_reason(point: Vec3 | None, covered: Counter[int], tips: bool) -> Grasp:
    """What was found, or else what covers the object, the most frequent first, and what is wrong with the rest."""
    if point is not None:
        return Grasp(point)
    return Grasp(None, tuple(n for n, _ in covered.most_common() if n >= 0), "would_tip" if tips else "no_seal")


def _would_tip_off_cup(physics: Physics, number: int, point: Vec3) -> bool:
    """Whether the weight of an object, lifted at a point, bends it off the cup; a rope hangs freely."""
    x, y, z = np.subtract(point, physics.center_of_mass(number)).tolist()
    nozzle = physics.world.nozzle_for_object(number)
    burden = Payload(physics.object_mass(number), float(np.hypot(x, y)), max(0.0, z), nozzle)
    return burden.would_peel_off_cup and number not in physics.world.limp


def _body_radius(physics: Physics, number: int) -> float:
    """How near (m) to the axis of the nozzle for an object nothing may stand up."""
    return physics.world.nozzle_for_object(number).radius + _CLEAR


def _look_down(
    physics: Physics, number: int, around: Sequence[Prism], low: float, point: tuple[float, float]
) -> tuple[float, float, int]:
    """How high (m) what is seen from above at a point (m) lies, how rough it is for the cup (infinitely if it is not
    the object), and the id of what is in the way, -1 for nothing that reaches higher than ``low`` (m)."""
    height, owner = physics.surface_height_below(*point)
    if owner != number:
        return height, np.inf, owner if height > low else -1
    return height, *_score_grasp_point(physics, number, around, (*point, height))


def _score_grasp_point(physics: Physics, number: int, others: Sequence[Prism], point: Vec3) -> tuple[float, int]:
    """How rough a point of an object is for the cup, 0 = not at all, and the id of what is in its way, or -1."""
    roughness, beside = _estimate_seal_cost(physics, number, *point)
    if beside >= 0:
        return roughness, beside
    room, neighbour = _suction_cup_clearance(physics, others, _body_radius(physics, number), *point)
    return roughness + max(0.0, _SWAY - room), neighbour if room < 0 else -1


def _candidate_grasp_points(center: Vec3, outline: Prism) -> Iterator[tuple[float, float]]:
    """The middle, which mostly serves, and then points ever farther from it (m)."""
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
    """How far, metres, a cup of radius ``body`` is from what stands up beside a point, and what that is: rays go to
    nearest outlines."""
    point, room, found = np.array([x, y]), _SWAY, -1
    for prism in others:
        if prism.high <= height + _STEP:
            continue
        foot = nearest_point_of_outline(prism.outline, point)
        away = float(np.linalg.norm(foot - point))
        if 0 < away < body + room:
            beyond = foot + (foot - point) * (0.001 / away)
            top, owner = physics.surface_height_below(float(beyond[0]), float(beyond[1]))
            if owner == prism.owner and top > height + _STEP:
                room, found = away - body, owner
    return room, found


def _estimate_seal_cost(physics: Physics, number: int, x: float, y: float, height: float) -> tuple[float, int]:
    """How little of the cup's lip would seal (0 all; from ``_LEAKS`` on too little), what else is in its way, or -1."""
    missing, step, nozzle = 0, 0.0, physics.world.nozzle_for_object(number)
    for dx, dy in _RING:
        for radius in (nozzle.lip, nozzle.radius + _AROUND):
            around, owner = physics.surface_height_below(x + radius * float(dx), y + radius * float(dy))
            if owner != number and around > height + _STEP:
                return 1.0, owner
            if around > height + _GIVE:
                step = 0.05  # the object's own higher part: only if there is nothing better
            missing += radius == nozzle.lip and (owner != number or abs(around - height) > _GIVE)
    leaks = 1 - missing / len(_RING) < SEALED
    return 0.003 * missing + step + _LEAKS * leaks, -1
