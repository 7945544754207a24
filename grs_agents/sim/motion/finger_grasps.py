"""Grasp search for two fingers: places where the pads close on opposite faces of an object, with room for the hand.

Candidates belong to an object and the side that is up; room, reach and neighbours belong to the scene.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm_parts import DOWN
from grs_agents.sim.arms.joint_paths import rotations_about_z
from grs_agents.sim.hands.hand import GRAVITY
from grs_agents.sim.hands.two_fingers import PAD_FRICTION, TwoFingerHand
from grs_agents.sim.instance.episode import Outcome
from grs_agents.sim.motion.arm_motion import UP
from grs_agents.sim.motion.hand_room import MARGIN, HandRoom
from grs_agents.sim.world.geom_triangles import geom_triangles_and_normals
from grs_agents.sim.world.physics import Physics

_SPACING: Final = 0.0035
_FEWEST, _MOST = 120, 700
"""Spacing of the sampled points of a convex part, metres, and how many it has."""
_YAWS, _TILTED_YAWS = 12, 8
_TILTS: Final = (np.pi / 6, np.pi / 4)
_DEPTHS: Final = (0.012, 0.02, 0.03, 0.042)
"""Depths of the finger ends below the top of the object that are tried, metres."""
_DEEP: Final = 0.03
"""Depth from which on a grasp is deep enough, metres."""
_SHALLOWEST: Final = 0.006
_ABOVE_TABLE: Final = 0.003
"""Lowest height of any part of the hand above the table, metres."""
_FACE: Final = 0.0015
"""Depth of what counts as the face that a pad touches, metres."""
_THINNEST: Final = 0.0008
_SLANT: Final = float(np.cos(np.arctan(0.5 * PAD_FRICTION[0])))
"""Least part of a face's normal along the closing direction: well within the friction cone, so that no corner at right
angles is taken diagonally."""
_SLIPPERY: Final = 4.0
"""Cost of a face's slant: 1 minus the part of its normal along the closing direction counts so often."""
_WORST: Final = 1.1
"""Cost from which on a grasp does not hold: slanted faces, few millimetres of them, far from the middle."""
_POOR: Final = 0.5
"""Cost of a grasp from above from which on tilted ones are sought, too."""
_SIDE: Final = 0.01
"""Clearance between an open pad and the object, metres: covers an error of the hand of 5 mm."""
_TIGHT: Final = 0.07
"""Width from which on little of the clearance is left, metres."""
_LOOKS: Final = 160
"""Candidates that are looked at."""
_MISS: Final = 0.01
"""Distance about a tilted grasp within which the arm must reach, too, metres."""
_APART, _TURNED = 0.012, 0.35
"""Distance (m) or angle (rad) by which two grasps of an object differ."""
_BACK: Final = (0.0, 0.012, 0.025, 0.045, 0.07, 0.1)
"""Distances from the grasp, back along the hand, at which the way in must be free, metres."""
RETREAT: Final = _BACK[-1]
"""Length of the straight approach and of the retreat along the hand, metres."""
RELEASE: Final = 0.008
"""Opening of each pad from a released object, metres."""
_LIFTED: Final = np.array([0.0, 0.0, MARGIN])
"""Shift of a hand at a place, metres: the support below it is nearer than the margin."""
_NEARLY: Final = 0.9998
"""``_STRAIGHT`` for the faces of an object that leans by a degree."""
_FEW: Final = 3
"""Fewest points of a convex part between the pads that count."""
_GAP: Final = 0.004
"""Clearance of a finger within an opening of the object, on each of its sides, metres."""
_STAGES: Final = ("table", "room", "place", "reach", "arm", "reach of the place")
"""Tests of a candidate, in their order."""
_STRAIGHT: Final = 1 - 1e-9
"""Least cosine of the tilt of a hand that points straight down."""
_FLIPS: Final = (1.0, -1.0)
_BEND: Final = 1.2
"""Largest joint motion of the approach, radians."""


@dataclass(frozen=True)
class FingerGrasp:
    """A grasp of an object.

    Attributes:
        tip: (3,) position of the tip, metres.
        hand: (3, 3) axes of the hand: the pads close along y, z points out of the hand.
        width: of what the pads close on, metres.
        opening: between the pads on the way there, metres.
        depth: of the finger ends below the upper end of the faces that the pads touch, metres.
        cost: lower is better.
    """

    tip: FloatArray
    hand: FloatArray
    width: float
    opening: float
    depth: float
    cost: float

    @property
    def pose(self) -> Pose:
        """Position of the tip (m) and rotation (xyzw) of the tool from straight down."""
        return transforms.to_vec3(self.tip), transforms.to_unit_quaternion(_quaternion(self.hand @ DOWN)[[1, 2, 3, 0]])


@dataclass(frozen=True)
class FingerGrasps:
    """Outcome of a search: grasps, best first, or why there are none."""

    grasps: tuple[FingerGrasp, ...]
    covered_by: tuple[int, ...] = ()  # ids of the objects that leave no room, most frequent first
    trouble: Outcome | None = None
    why: str = ""  # predicate of the object


def hand_axes(pose: Pose) -> FloatArray:
    """Axes (3, 3) of the hand at a pose of its tip, rotated from straight down."""
    return transforms.quaternion_to_matrix(pose[1]) @ DOWN


def _quaternion(matrix: FloatArray) -> FloatArray:
    """Quaternion (4,), wxyz, of a rotation matrix."""
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, np.ascontiguousarray(matrix).ravel())
    return turn


@dataclass(frozen=True)
class _Surface:
    """Points (N, 3) on the convex parts of an object, part by part, and their normals; frame of its body, metres.

    Vertices bound what the pads meet, yet have no normal: theirs are zero.
    """

    points: FloatArray
    normals: FloatArray
    parts: npt.NDArray[np.intp]  # (N,) number of the part of each point
    radius: float  # of a sphere about the origin around them


def object_surface(physics: Physics, number: int) -> _Surface:
    """Sampled surface of an object's colliders, body frame, cached with the compiled world."""
    known = physics.world.memory.get(("surface", number))
    if known is None:
        known = physics.world.memory[("surface", number)] = _sample_surface(physics.model, physics.world.bodies[number])
    return known


def _sample_surface(model: Any, body: int) -> _Surface:
    rng, first = np.random.default_rng(0), int(model.body_geomadr[body])
    points, normals = list[FloatArray](), list[FloatArray]()
    for geom in range(first, first + int(model.body_geomnum[body])):
        triangles = geom_triangles_and_normals(model, geom) if model.geom_contype[geom] else None
        if triangles is None:
            continue
        corners = triangles[0].reshape(-1, 3, 3)
        edge, side = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        across = np.cross(edge, side)
        twice: FloatArray = np.linalg.norm(across, axis=1)
        count = int(np.clip(twice.sum() / 2 / _SPACING**2, _FEWEST, _MOST))
        gone: FloatArray = np.cumsum(twice)
        chosen = np.searchsorted(gone, (np.arange(count) + 0.5) * (float(gone[-1]) / count)).clip(0, len(twice) - 1)
        shares: FloatArray = rng.random((count, 2))
        beyond = shares.sum(axis=1) > 1  # mirrored into the triangle
        shares[beyond] = 1 - shares[beyond]
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        axes = turn.reshape(3, 3)
        inside = corners[chosen, 0] + shares[:, :1] * edge[chosen] + shares[:, 1:] * side[chosen]
        out = across[chosen] / np.maximum(twice[chosen], 1e-15)[:, None]
        vertices = np.unique(np.round(corners.reshape(-1, 3), 6), axis=0)
        inside, out = np.concatenate([inside, vertices]), np.concatenate([out, np.zeros_like(vertices)])
        points.append(inside @ axes.T + model.geom_pos[geom])
        normals.append(out @ axes.T)
    if not points:
        return _Surface(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.intp), 0.0)
    together, parts = np.concatenate(points), np.repeat(np.arange(len(points)), [len(part) for part in points])
    return _Surface(together, np.concatenate(normals), parts, float(np.linalg.norm(together, axis=1).max()))


@dataclass(frozen=True)
class _Span:
    """Ends along the closing axis of what the pads would close on, metres."""

    low: float
    high: float


def _spans_between_pads(
    points: FloatArray, parts: npt.NDArray[np.intp], hand: TwoFingerHand, heights: FloatArray
) -> list[list[_Span]]:
    """Solid spans along the closing axis, with the ends of the fingers at ``heights`` (Z,), in the frame of the hand.

    Args:
        points: (N, 3) within the width of the pads, in the frame of the hand, part by part.
        parts: (N,) number of the convex part of each point.
        hand: the hand.
        heights: of the finger ends, metres.

    Gaps too narrow for a finger do not part spans.
    """
    if not len(points):
        return [[] for _ in heights]
    _, thickness, height = hand.pad
    starts = np.flatnonzero(np.diff(parts, prepend=-1))
    below = heights[:, None] - points[:, 2]
    inside = (below > 0) & (below < 2 * height)
    lows = np.minimum.reduceat(np.where(inside, points[:, 1], np.inf), starts, axis=1)
    highs = np.maximum.reduceat(np.where(inside, points[:, 1], -np.inf), starts, axis=1)
    full = np.add.reduceat(inside, starts, axis=1, dtype=np.intp) >= _FEW
    gap, found = 2 * thickness + 2 * _GAP, list[list[_Span]]()
    for row in range(len(heights)):
        joined: list[_Span] = []
        order = np.flatnonzero(full[row])
        order = order[np.argsort(lows[row, order])]
        for low, high in zip(lows[row, order].tolist(), highs[row, order].tolist(), strict=True):
            if joined and low - joined[-1].high < gap:
                joined[-1] = _Span(joined[-1].low, max(joined[-1].high, high))
            else:
                joined.append(_Span(low, high))
        found.append(joined)
    return found


def measure_between_pads(
    physics: Physics, number: int, tip: FloatArray, axes: FloatArray
) -> tuple[float, float] | None:
    """Ends along the closing axis, from the tip, metres, of what the open pads reach around; None for nothing."""
    hand, surface = physics.fingers.hand, object_surface(physics, number)
    position, turn = _body_frame(physics, number)
    if float(np.linalg.norm(position - tip)) > surface.radius + hand.stroke:
        return None
    points = (surface.points @ turn.T + position - tip) @ axes
    near = np.abs(points[:, 0]) < hand.pad[0]
    points = points[near]
    (spans,) = _spans_between_pads(points, surface.parts[near], hand, np.zeros(1))
    middle = [span for span in spans if span.high > -hand.stroke / 2 and span.low < hand.stroke / 2]
    above = points[np.abs(points[:, 1]) < hand.stroke / 2, 2]
    if not middle or float(above.min()) > -_SHALLOWEST:
        return None
    span = min(middle, key=lambda span: abs(span.low + span.high))
    return span.low, span.high


def _body_frame(physics: Physics, number: int) -> tuple[FloatArray, FloatArray]:
    """Position (3,) and axes (3, 3) of an object's body."""
    body = physics.world.bodies[number]
    return np.array(physics.data.xpos[body]), np.array(physics.data.xmat[body]).reshape(3, 3)


def _hand_frames(up: FloatArray, tilted: bool) -> Iterator[tuple[FloatArray, float]]:
    """Axes (3, 3) of hands, and their tilt (rad), for the direction ``up`` (3,)."""
    aside = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, aside)
    first /= np.linalg.norm(first)
    base = np.stack([first, np.cross(-up, first), -up], axis=1)
    count = _TILTED_YAWS if tilted else _YAWS
    for turn in rotations_about_z(np.linspace(0.0, np.pi, count, endpoint=False)):
        straight = base @ turn
        if not tilted:
            yield straight, 0.0
            continue
        for tilt in _TILTS:
            for angle in (tilt, -tilt):
                cos, sin = float(np.cos(angle)), float(np.sin(angle))
                yield straight @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]), tilt
                yield straight @ np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]), tilt


def find_candidates(physics: Physics, number: int, tilted: bool) -> tuple[FingerGrasp, ...]:
    """Antipodal grasps of an object alone, frame of its body, best first, for the side that is up now."""
    turn = _body_frame(physics, number)[1]
    x, y, z = (round(float(part), 2) for part in turn[2])  # the same for all that stands alike
    up, key = np.array([x, y, z]), ("grasps", number, tilted, x, y, z)
    known = physics.world.memory.get(key)
    if known is None:
        known = physics.world.memory[key] = _search_candidates(
            object_surface(physics, number),
            np.array(physics.model.body_ipos[physics.world.bodies[number]]),
            up / np.linalg.norm(up),
            physics.fingers.hand,
            float(physics.model.body_mass[physics.world.bodies[number]]),
            tilted,
        )
    return known


def _search_candidates(
    surface: _Surface, center: FloatArray, up: FloatArray, hand: TwoFingerHand, mass: float, tilted: bool
) -> tuple[FingerGrasp, ...]:
    found: list[FingerGrasp] = []
    if not len(surface.points):
        return ()
    for axes, tilt in _hand_frames(up, tilted):
        points, normals = (surface.points - center) @ axes, surface.normals @ axes
        if not _has_opposite_faces(normals):
            continue
        left, right = float(points[:, 0].min()), float(points[:, 0].max())
        top, low = float(points[:, 2].min()), float(points[:, 2].max())
        length = right - left
        xs = [0.0] if length < 0.02 else np.linspace(left + 0.006, right - 0.006, int(np.clip(length / 0.02, 3, 7)))
        deepest = min(hand.depth, low - 0.001 - top)
        zs = sorted({*(depth for depth in _DEPTHS if depth < deepest), deepest})
        heights = top + np.array(zs)
        for x in sorted({0.0, *np.round(xs, 4).tolist()}) if length >= 0.02 else [0.0]:
            near = np.flatnonzero(np.abs(points[:, 0] - x) < hand.pad[0])
            strip, facing = points[near], normals[near]
            if not _has_opposite_faces(facing):
                continue
            for depth, spans in zip(zs, _spans_between_pads(strip, surface.parts[near], hand, heights), strict=True):
                for span in spans:
                    grasp = _rate_span(span, strip, facing, hand, x, top + depth, depth, low - top)
                    if grasp is None:
                        continue
                    level = axes @ np.array([grasp.tip[0], grasp.tip[1], 0.0])
                    lever = float(np.linalg.norm(level - up * float(level @ up)))
                    # An object held beside its centre of mass turns: friction over the pads bears a bounded moment
                    if mass * GRAVITY * lever > 2 * hand.gripping_force(mass, lever) * PAD_FRICTION[0] * hand.pad[0]:
                        continue
                    rim = len(spans) > 1 or abs(float(grasp.tip[1])) > 0.02
                    cost = grasp.cost + 6.0 * lever + 0.2 * tilt + 0.1 * rim
                    if cost > _WORST:
                        continue
                    found.append(replace(grasp, tip=center + axes @ grasp.tip, hand=axes, cost=cost))
    found.sort(key=lambda grasp: grasp.cost)
    return tuple(found)


def _has_opposite_faces(normals: FloatArray) -> bool:
    """Whether any of the normals (N, 3) meet the closing axis of the hand on both sides."""
    along = normals[:, 1]
    return bool((along <= -_SLANT).any() and (along >= _SLANT).any())


def _rate_span(
    span: _Span,
    points: FloatArray,
    normals: FloatArray,
    hand: TwoFingerHand,
    x: float,
    z: float,
    depth: float,
    height: float,
) -> FingerGrasp | None:
    """A grasp of a span, in the frame of the hand with its origin at the centre of mass; None for a poor one.

    Points (N, 3) and their normals are those within the width of the pads.
    """
    width = span.high - span.low
    if not _THINNEST < width < hand.stroke - 2 * _GAP + 0.002:
        return None
    rows = np.flatnonzero(
        (points[:, 1] >= span.low)
        & (points[:, 1] <= span.high)
        & (points[:, 2] < z)
        & (points[:, 2] > z - 2 * hand.pad[2])
    )
    along, face = points[rows, 1], min(_FACE, width / 2)
    ends = rows[along < span.low + face], rows[along > span.high - face]
    if normals[ends[0], 1].min(initial=0.0) > -_SLANT or normals[ends[1], 1].max(initial=0.0) < _SLANT:
        return None
    counts = [int(np.count_nonzero(normals[end].any(axis=1))) for end in ends]
    if not min(counts):
        return None
    margin = min(-float(normals[ends[0], 1].sum()) / counts[0], float(normals[ends[1], 1].sum()) / counts[1])
    if margin < _SLANT:
        return None
    faces = [points[end][:, [0, 2]] for end in ends]
    bite = z - max(float(face[:, 1].min()) for face in faces)
    skew = float(np.linalg.norm(faces[0].mean(axis=0) - faces[1].mean(axis=0)))
    area = min(float(np.ptp(face, axis=0).sum()) for face in faces)
    cost = _SLIPPERY * (1 - min(margin, 1.0)) + 6.0 * skew - 6.0 * min(area, 0.04)
    cost += 10.0 * max(0.0, width - _TIGHT) + 10.0 * max(0.0, min(_DEEP, 0.8 * height) - depth)
    tip = np.array([x, (span.low + span.high) / 2, z])
    return FingerGrasp(tip, np.eye(3), width, min(hand.stroke, width + 2 * _SIDE), bite, cost)


def find_finger_grasps(
    physics: Physics,
    room: HandRoom,
    number: int,
    carry: Callable[[Pose], Pose] | None = None,
    wanted: int = 1,
) -> FingerGrasps:
    """Grasps of an object as it stands, from above if there are any, else tilted.

    Args:
        physics: the running world.
        room: shows the present scene.
        number: id of the object.
        carry: pose of the tip at the object's place, from the pose that takes it; None to find grasps for any place.
        wanted: how many unlike grasps end the search from above, and that of tilted ones.
    """
    hand = physics.fingers.hand
    mass = physics.object_mass(number)
    if mass > hand.payload:
        why = f"weighs {mass:.2g} kg, the {hand.maker} holds {hand.payload:g} kg"
        return FingerGrasps((), trouble="no_grip", why=f"{{name}} {why}")
    search = _SceneSearch(physics, room, number, carry)
    grasps: list[FingerGrasp] = []
    any_candidates = False
    for tilted in (False, True):
        candidates = find_candidates(physics, number, tilted)
        any_candidates |= bool(candidates)
        grasps += search.feasible(candidates, tilted, wanted)
        if grasps and (tilted or grasps[0].cost < _POOR):
            return FingerGrasps(tuple(sorted(grasps, key=lambda grasp: grasp.cost)))
    if not any_candidates:
        return FingerGrasps((), trouble="no_grip", why=_describe_shape(physics, number, hand))
    return search.explain()


def _describe_shape(physics: Physics, number: int, hand: TwoFingerHand) -> str:
    """Why the shape alone of an object gives the fingers no hold."""
    turn = _body_frame(physics, number)[1]
    points = object_surface(physics, number).points @ turn.T
    if not len(points):
        return "{name} has no body to hold"
    angles = np.arange(36) * (np.pi / 36)
    across = float(np.ptp(points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)]), axis=0).min())
    if across > hand.stroke - 2 * _GAP:
        return f"{{name}} is {across:.3f} m across, the {hand.maker} opens {hand.stroke:.3f} m"
    return f"no two faces of {{name}} are opposite enough, and near enough to its middle, for the {hand.maker}"


def _stand_candidates(physics: Physics, number: int, candidates: Sequence[FingerGrasp]) -> list[FingerGrasp | None]:
    """Candidates in the robot frame, drawn back until no part of the hand is at the table; None if too far."""
    if not candidates:
        return []
    position, turn = _body_frame(physics, number)
    hands = turn @ np.array([candidate.hand for candidate in candidates])
    for hand in hands:
        if not _is_tilted(hand):
            hand[:] = rotations_about_z(np.array([np.arctan2(hand[1, 0], hand[0, 0])]))[0] @ DOWN
    tips = np.array([candidate.tip for candidate in candidates]) @ turn.T + position
    lows = physics.fingers.hand.lowest_points(hands, np.array([candidate.opening for candidate in candidates]))
    drawn = np.maximum(0.0, _ABOVE_TABLE - tips[:, 2] - lows) / np.maximum(-hands[:, 2, 2], 0.5)
    tips -= drawn[:, None] * hands[:, :, 2]
    depths = [candidate.depth - back for candidate, back in zip(candidates, drawn.tolist(), strict=True)]
    return [
        replace(candidate, tip=tip, hand=hand, depth=depth) if depth >= _SHALLOWEST else None
        for candidate, tip, hand, depth in zip(candidates, tips, hands, depths, strict=True)
    ]


class _Standing:
    """A grasp in the scene as it stands; each check is made once."""

    def __init__(self, physics: Physics, room: HandRoom, number: int, grasp: FingerGrasp) -> None:
        self._physics, self._room, self._number, self.grasp = physics, room, number, grasp
        self._joints: dict[float, FloatArray | None] = {}

    @cached_property
    def touched(self) -> Sequence[int]:
        """Ids of what the hand would touch at the grasp, open or as it closes, -1 for the table."""
        grasp = self.grasp
        return self._touched_at(_BACK[0]) or self._room.touched_by_hand(
            grasp.tip, grasp.hand, grasp.width, self._number
        )

    @cached_property
    def touched_on_the_way(self) -> Sequence[int]:
        """As ``touched``, on the way in, and as the closed hand lifts."""
        grasp = self.grasp
        if touched := next((touched for back in _BACK[1:] if (touched := self._touched_at(back))), ()):
            return touched
        lifted = [grasp.tip + rise * UP for rise in _BACK[1:] if _is_tilted(grasp.hand)]
        ways = (self._room.touched_by_hand(tip, grasp.hand, grasp.width, self._number) for tip in lifted)
        return next(filter(None, ways), ())

    @cached_property
    def touched_by_arm(self) -> Sequence[int] | None:
        """Ids of what the arm would touch at the grasp; None if it does not reach it."""
        grasp = self.grasp
        joints = next((found for flip in _FLIPS if (found := self.reach(flip)) is not None), None)
        if joints is None:
            return None
        if _is_tilted(grasp.hand):  # a tilted wrist is near its limits
            outwards = np.array([*grasp.tip[:2], 0.0]) * (_MISS / max(float(np.hypot(*grasp.tip[:2])), _MISS))
            if not all(self._reaches(grasp.tip + way) for way in (outwards, -outwards)):
                return None
        return self._room.touched_by_arm(joints, grasp.opening)

    def reach(self, flip: float) -> FloatArray | None:
        """Joint positions (dof,) at the grasp, with the hand turned half around for -1; None out of reach."""
        if flip not in self._joints:
            seed = self._physics.commanded_joint_positions
            self._joints[flip] = solve_approach(self._physics, self.grasp.tip, self.grasp.hand, flip, seed)
        return self._joints[flip]

    def _reaches(self, tip: FloatArray) -> bool:
        seed = self._physics.commanded_joint_positions
        return any(solve_approach(self._physics, tip, self.grasp.hand, flip, seed) is not None for flip in _FLIPS)

    def _touched_at(self, back: float) -> Sequence[int]:
        grasp = self.grasp
        return self._room.touched_by_hand(grasp.tip - back * grasp.hand[:, 2], grasp.hand, grasp.opening)


class _SceneSearch:
    """Picks the candidates that the scene leaves room for, and counts why others fail."""

    def __init__(self, physics: Physics, room: HandRoom, number: int, carry: Callable[[Pose], Pose] | None) -> None:
        self._physics, self._room, self._number, self._carry = physics, room, number, carry
        self._reasons = Counter[str]()
        self._owners = Counter[int]()

    def feasible(self, candidates: Sequence[FingerGrasp], tilted: bool, wanted: int) -> list[FingerGrasp]:
        """The first few candidates with room that the arm reaches, each unlike the others, in the robot frame."""
        key, chosen = (self._number, tilted), list[FingerGrasp]()
        if key not in self._room.memory:
            self._room.memory[key] = [
                None if grasp is None else _Standing(self._physics, self._room, self._number, grasp)
                for grasp in _stand_candidates(self._physics, self._number, candidates[:_LOOKS])
            ]
        for standing in self._room.memory[key]:
            if standing is None:
                self._reasons["table"] += 1
                continue
            grasp = standing.grasp
            if (
                not any(_alike(grasp, other) for other in chosen)
                and not self._is_taken("room", standing.touched)
                and self._has_room_at_place(grasp)
                and not self._is_taken("room", standing.touched_on_the_way)
                and self._in_reach(grasp, standing)
            ):
                chosen.append(grasp)
                if len(chosen) == wanted:
                    break
        return chosen

    def _has_room_at_place(self, grasp: FingerGrasp) -> bool:
        """Whether the hand can come down at the place, open and draw back; the object itself does not count."""
        if self._carry is None:
            return True
        width = min(self._physics.fingers.hand.stroke, grasp.width + 2 * RELEASE)
        place = self._carry(grasp.pose)
        tip, axes = np.array(place[0]) + _LIFTED, hand_axes(place)
        ways = [tip - back * axes[:, 2] for back in _BACK]
        ways += [tip + rise * UP for rise in _BACK[1:] if _is_tilted(axes)]
        touched = (self._room.touched_by_hand(way, axes, width, self._number) for way in ways)
        return not any(self._is_taken("place", owners) for owners in touched)

    def _in_reach(self, grasp: FingerGrasp, standing: _Standing) -> bool:
        if standing.touched_by_arm is None:
            self._reasons["reach"] += 1
            return False
        if self._is_taken("arm", standing.touched_by_arm):
            return False
        if self._carry is None:
            return True
        place = self._carry(grasp.pose)
        for flip in _FLIPS:  # the arm carries the object there without turning its hand half around
            before = standing.reach(flip)
            if before is None:
                continue
            joints = solve_approach(self._physics, np.array(place[0]), hand_axes(place), flip, before)
            if joints is not None:
                return not self._is_taken("place", self._room.touched_by_arm(joints, grasp.opening, self._number))
        self._reasons["reach of the place"] += 1
        return False

    def _is_taken(self, reason: str, touched: Sequence[int]) -> bool:
        """Whether anything is touched; counts it for the reason."""
        if touched:
            self._reasons[reason] += 1
            self._owners.update(set(touched) - {self._number, -1})
        return bool(touched)

    def explain(self) -> FingerGrasps:
        """The reason for the lack of grasps: the last test that stopped a candidate."""
        hand = self._physics.fingers.hand
        reason = next((reason for reason in reversed(_STAGES) if self._reasons[reason]), "room")
        covered = tuple(owner for owner, _ in self._owners.most_common())
        if reason == "table":
            why = f"the fingers reach less than {1000 * _SHALLOWEST:.0f} mm down {{name}} before they meet the table"
            return FingerGrasps((), (), "no_grip", why)
        if reason in ("reach", "reach of the place"):
            why = "the arm reaches {name}" if reason == "reach" else "the arm reaches the place of {name}"
            return FingerGrasps((), (), "unreachable", f"{why} with no hold that the {hand.maker} has on it")
        if reason == "place":
            why = f"the place of {{name}} leaves the {hand.maker} no room to let go"
            return FingerGrasps((), covered, "target_occupied" if covered else "no_grip", why)
        return FingerGrasps((), covered, "no_grip", f"there is no room for the {hand.maker} beside {{name}}")


def solve_approach(
    physics: Physics, tip: FloatArray, axes: FloatArray, flip: float, seed: FloatArray
) -> FloatArray | None:
    """Joint positions (dof,) at a grasp, if the arm can come to it straight along the hand; None if not.

    Args:
        physics: the running world.
        tip: (3,) position of the tip, metres.
        axes: (3, 3) of the hand; z points out of it.
        flip: 1, or -1 for the hand turned half around, which closes on the same.
        seed: (dof,) joint positions that the arm comes from.
    """
    arm = physics.arm
    ways = np.stack([tip - RETREAT * axes[:, 2], tip])
    upright = axes[2, 2] < -_STRAIGHT
    if upright and not arm.reachable_mask(ways).all():
        return None
    rotation = axes @ np.diag([flip, flip, 1.0]) @ DOWN
    if upright:
        path = arm.solve_ik_tool_down(ways, np.full(2, np.arctan2(rotation[1, 0], rotation[0, 0])), seed)
    else:
        path = arm.solve_ik_for_poses(ways, np.repeat(rotation[None], 2, axis=0), seed)
    if not arm.is_path_within_limits(path) or float(np.abs(path[1] - path[0]).max()) > _BEND:
        return None
    return path[1] if arm.first_collision_along(path) is None else None


def _is_tilted(axes: FloatArray) -> bool:
    """Whether the axes (3, 3) of a hand point down aslant."""
    return bool(axes[2, 2] > -_NEARLY)


def _alike(first: FingerGrasp, second: FingerGrasp) -> bool:
    """Whether two grasps hardly differ."""
    angle = np.arccos(np.clip((float(np.trace(first.hand.T @ second.hand)) - 1) / 2, -1.0, 1.0))
    return float(np.linalg.norm(first.tip - second.tip)) < _APART and float(angle) < _TURNED
