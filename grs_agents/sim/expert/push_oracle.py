"""The oracle's strokes: of many, the one that is expected to bring most of what is astray to where goals want it.

The expectation is a quick guess: pieces in the spatula's way end up ahead of it, one behind the other.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm_parts import BLADE_THICKNESS, BLADE_WIDTH
from grs_agents.sim.expert.oracle import Action, Oracle
from grs_agents.sim.goals.relation_rules import object_footprint_as_zone
from grs_agents.sim.goals.scene_view import SceneView, make_oracle_stop
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.motion.push import HEIGHT, action_points_for_stroke
from grs_agents.sim.world.footprints import rectangle_outline, rotation_matrix_2d, signed_outline_gaps
from grs_agents.sim.world.tabletop import Tabletop

BoolArray = npt.NDArray[np.bool_]
_LANES: Final = 11
"""Strips of the blade's width in which pieces queue up behind one another."""


@dataclass(frozen=True)
class Pieces:
    """What may be pushed, seen from above."""

    ids: tuple[int, ...]
    places: FloatArray  # (N, 2) their centres, metres
    radii: FloatArray  # (N,) half of their mean widths, metres


@dataclass(frozen=True)
class Strokes:
    """Ways of the blade's front between two different points each, (S, 2), metres."""

    start_points: FloatArray
    end_points: FloatArray

    @property
    def unit_directions(self) -> FloatArray:
        """Unit vectors (S, 2)."""
        step = self.end_points - self.start_points
        return step / np.linalg.norm(step, axis=1, keepdims=True)

    def select_by_mask(self, chosen: BoolArray) -> "Strokes":
        """Those of them that are chosen (S,)."""
        return Strokes(self.start_points[chosen], self.end_points[chosen])


def _project_onto_strokes(strokes: Strokes, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far ahead of the start and how far to the side (S, N) places (N, 2) are."""
    along = strokes.unit_directions
    offset = places[None] - strokes.start_points[:, None]
    ahead = offset[..., 0] * along[:, :1] + offset[..., 1] * along[:, 1:]
    aside = offset[..., 1] * along[:, :1] - offset[..., 0] * along[:, 1:]
    return ahead, aside


def find_clear_stroke_starts(strokes: Strokes, pieces: Pieces, margin: float = 0.003) -> BoolArray:
    """Which strokes (S,) begin where the blade comes down on nothing."""
    ahead, aside = _project_onto_strokes(strokes, pieces.places)
    reach = pieces.radii * 1.3 + margin
    under = (ahead > -BLADE_THICKNESS - reach) & (ahead < reach) & (np.abs(aside) < BLADE_WIDTH / 2 + reach)
    return np.logical_not(under.any(axis=1))


def predict_piece_positions(strokes: Strokes, pieces: Pieces) -> FloatArray:
    """Where the pieces (S, N, 2) would be after each stroke alone."""
    ahead, aside = _project_onto_strokes(strokes, pieces.places)
    length = np.linalg.norm(strokes.end_points - strokes.start_points, axis=1)[:, None]
    half = BLADE_WIDTH / 2
    swept = (np.abs(aside) < half) & (ahead > 0)
    lane = np.clip(((aside + half) * (_LANES / BLADE_WIDTH)).astype(int), 0, _LANES - 1)
    width = BLADE_WIDTH / _LANES
    order = np.argsort(np.where(swept, ahead, np.inf), axis=1)
    front = np.repeat(length, _LANES, axis=1)  # how far each lane is taken up, from the start
    moved = ahead.copy()
    rows, radii = np.arange(len(ahead)), pieces.radii
    for rank in range(int(swept.sum(axis=1).max(initial=0))):
        piece = order[:, rank]
        active = swept[rows, piece]
        strip = lane[rows, piece]
        here = np.maximum(ahead[rows, piece], front[rows, strip] + radii[piece])
        moved[rows[active], piece[active]] = here[active]
        depth = np.minimum(4 * radii[piece] ** 2 / width, 2 * radii[piece])
        full = np.maximum(front[rows, strip], here - radii[piece] + depth)
        pushed = active & (here > ahead[rows, piece])
        front[rows[pushed], strip[pushed]] = full[pushed]
    return pieces.places[None] + (moved - ahead)[..., None] * strokes.unit_directions[:, None]


_DIRECTIONS: Final = 16
_ASTRAY: Final = 0.02
"""What a piece outside its place costs besides its distance, metres, so that the last ones count."""
_SIDE: Final = 0.3
"""What a stir costs to a piece that no goal speaks of, for each metre."""
_LATER: Final = 0.1
"""What pieces of later goals count against those of the first open one: goals are met one after the other, and later
ones earn nothing before. At 1, four strewn piles of 10 left the first goal open after 20 strokes in 5 of 5."""
_EFFORT: Final = 0.004
"""What a stroke must gain, metres of all pieces together."""
_ACROSS: Final = 0.02
_EDGE: Final = 0.035
"""Strokes lie this near to one another, and pass the outermost piece by this much, metres."""
_DEPTHS: Final = (0.0, 0.012, 0.026, 0.045)
"""How far into a place the blade may go, metres."""
_PATIENCE: Final = 7
"""Strokes in a row that bring nothing, after which it gives up."""
_TRIED: Final = 60
_PAIRS, _FEWEST = 1_000_000, 200
"""Pieces times places times strokes that are weighed for one decision, and the fewest strokes all the same."""
_AIMS: Final = 6
"""Places that strokes aim at, of many: those still empty, spread out."""


@dataclass(frozen=True)
class Place:
    """Where the centre of a piece belongs: a turned rectangle, full extents ``size`` (2,), metres."""

    center: FloatArray
    size: FloatArray
    yaw: float

    def distance_outside(self, points: FloatArray) -> FloatArray:
        """How far (...) points (..., 2) are outside, metres; 0 inside."""
        local = np.abs((points - self.center) @ rotation_matrix_2d(self.yaw)) - self.size / 2
        return np.linalg.norm(np.maximum(local, 0.0), axis=-1)

    def ray_entry_and_exit(self, start_points: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far along rays (R, 2) enter and leave it (R,), metres; infinite where they miss."""
        origin, way = (start_points - self.center) @ rotation_matrix_2d(self.yaw), along @ rotation_matrix_2d(self.yaw)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-self.size / 2 - origin) / way, (self.size / 2 - origin) / way
        enter, leave = np.fmin(first, second).max(axis=1), np.fmax(first, second).min(axis=1)
        return np.where(enter <= leave, enter, np.inf), np.where(enter <= leave, leave, np.inf)


class PushOracle(Oracle):
    """Solves tasks whose primitive pushes; see `Oracle`."""

    def __init__(self, task: ScoredTask, table: Tabletop) -> None:
        super().__init__(task, table)
        self._tried: list[FloatArray] = []
        self._least, self._vain, self._open = np.inf, 0, 0

    def _reset_episode_memory(self) -> None:
        super()._reset_episode_memory()
        self._tried, self._least, self._vain, self._open = [], np.inf, 0, 0

    def _plan_for_unmet_goals(self, view: SceneView) -> Action | Stop:
        scene = _Scene(self.task, view)
        if not scene.places:
            return Stop("error", "no goal says where things are to be pushed to: state 'zone', 'pose' or in_zone")
        cost = float(scene.placement_cost(scene.pieces.places[None])[0])
        if len(self.task.goals) != self._open:  # another goal counts most now: costs compare with none before
            self._open, self._least = len(self.task.goals), np.inf
        self._vain = 0 if cost < self._least - _EFFORT else self._vain + 1
        self._least = min(self._least, cost)
        if cost == 0:
            return self._make_nothing_to_move_stop()
        strokes, gain = scene.propose_strokes_with_gain()
        best = next(self._rank_feasible_strokes(strokes, gain, scene), None) if self._vain < _PATIENCE else None
        if best is None:
            return scene.make_no_useful_stroke_stop()
        start, end = strokes.start_points[best], strokes.end_points[best]
        self._tried = [*self._tried[-_TRIED:], np.hstack([start, end])]
        back = strokes.unit_directions[best] * BLADE_THICKNESS / 2
        first, last = action_points_for_stroke(start - back, end - back)
        return {"pose0": (first, transforms.IDENTITY), "pose1": (last, transforms.IDENTITY)}

    def _rank_feasible_strokes(self, strokes: Strokes, gain: FloatArray, scene: "_Scene") -> Iterator[int]:
        """Strokes worth their effort, best first, that the arm can make and that were not made already."""
        for index in np.argsort(-gain, kind="stable"):
            if gain[index] < _EFFORT:
                return
            end_points = np.array([strokes.start_points[index], strokes.end_points[index]])
            known = any(float(np.abs(done - end_points.ravel()).max()) < 0.004 for done in self._tried)
            tips = np.column_stack([end_points, [HEIGHT, HEIGHT]])
            if not known and self.table.arm.reachable_mask(tips).all() and not scene.is_stroke_obstructed(*end_points):
                yield int(index)


class _Scene:
    """What is where, and where goals want it."""

    def __init__(self, task: ScoredTask, view: SceneView) -> None:
        self.view = view
        ids = tuple(number for number in view.object_ids if view.may_robot_move(number))
        outlines = [view.object_prism(number).outline for number in ids]
        areas = np.array([0.5 * abs(_twice_signed_area(outline)) for outline in outlines])
        centers = np.array([view.object_pose(number)[0][:2] for number in ids]).reshape(-1, 2)
        self.pieces = Pieces(ids, centers, np.sqrt(areas) / 2)
        self.places = self._places_of_goals(task, outlines)
        self._groups = self._group_pieces_by_places()
        later = {number for goal in task.goals[1:] for number in goal.objects} - set(task.goals[0].objects)
        self._weights = [_LATER if all(ids[row] in later for row in rows.tolist()) else 1.0 for rows, _ in self._groups]

    def _places_of_goals(self, task: ScoredTask, outlines: Sequence[FloatArray]) -> dict[int, list[Place]]:
        """Where goals want pieces, by id: the first open one that speaks of a piece, else one that is met."""
        places: dict[int, list[Place]] = {}
        ids, centers, view = self.pieces.ids, self.pieces.places, self.view
        met = [goal for goal in view.stated_goals if all(goal is not other for other in task.goals)]
        for goal in (*task.goals, *met):
            for row, number in enumerate(goal.objects):
                if number in ids and number not in places:
                    spread = np.linalg.norm(outlines[ids.index(number)] - centers[ids.index(number)], axis=1).max()
                    if wanted := _goal_places_for_object(goal, row, float(spread), task.pos_eps, view):
                        places[number] = wanted
        return places

    def _group_pieces_by_places(self) -> list[tuple[npt.NDArray[np.intp], list[Place]]]:
        """Rows of pieces that share their places, as all grains of a pile do."""
        groups: list[tuple[list[int], list[Place]]] = []
        for row, number in enumerate(self.pieces.ids):
            places = self.places.get(number)
            if places is None:
                continue
            same = [rows for rows, known in groups if _are_same_places(known, places)]
            if same:
                same[0].append(row)
            else:
                groups.append(([row], places))
        return [(np.array(rows), places) for rows, places in groups]

    def placement_cost(self, places: FloatArray) -> FloatArray:
        """How far (S,) pieces at ``places`` (S, N, 2) are from where they belong, all together, metres."""
        total = np.zeros(len(places))
        for (rows, wanted), weight in zip(self._groups, self._weights, strict=True):
            away = np.min([place.distance_outside(places[:, rows]) for place in wanted], axis=0)
            total += weight * (away + _ASTRAY * np.minimum(1.0, away / 0.004)).sum(axis=1)
        others = [row for row, number in enumerate(self.pieces.ids) if number not in self.places]
        if others:
            total += _SIDE * np.linalg.norm(places[:, others] - self.pieces.places[others], axis=2).sum(axis=1)
        return total

    def propose_strokes_with_gain(self) -> tuple[Strokes, FloatArray]:
        """Strokes worth a thought, and what each is expected to gain (S,)."""
        parts = [
            part
            for rows, wanted in self._groups
            for place in _choose_emptiest_places(wanted, self.pieces.places)
            for part in self._strokes_towards_place(place, rows[place.distance_outside(self.pieces.places[rows]) > 0])
        ]
        if not parts:
            return Strokes(np.zeros((0, 2)), np.zeros((0, 2))), np.zeros(0)
        strokes = Strokes(
            np.vstack([part.start_points for part in parts]), np.vstack([part.end_points for part in parts])
        )
        strokes = strokes.select_by_mask(find_clear_stroke_starts(strokes, self.pieces))
        pairs = sum(len(rows) * len(wanted) for rows, wanted in self._groups)
        count, most = len(strokes.start_points), max(_FEWEST, _PAIRS // max(1, pairs))
        if count > most:
            chosen = np.zeros(count, dtype=np.bool_)
            chosen[np.linspace(0, count - 1, most).astype(np.intp)] = True
            strokes = strokes.select_by_mask(chosen)
        now = self.placement_cost(self.pieces.places[None])[0]
        return strokes, now - self.placement_cost(predict_piece_positions(strokes, self.pieces))

    def _strokes_towards_place(self, place: Place, astray: npt.NDArray[np.intp]) -> Iterator[Strokes]:
        """Strokes from behind astray pieces (rows) into a place, in many directions side by side."""
        points, radius = self.pieces.places[astray], float(self.pieces.radii[astray].max(initial=0.0))
        for index in range(_DIRECTIONS if len(points) else 0):
            angle = place.yaw + 2 * np.pi * index / _DIRECTIONS
            along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            aside, ahead = (points - place.center) @ across, (points - place.center) @ along
            lanes = np.arange(aside.min() - _EDGE, aside.max() + _EDGE, _ACROSS)
            near = np.abs(aside[None] - lanes[:, None]) < BLADE_WIDTH / 2 - 0.3 * radius
            first = np.where(near, ahead[None], np.inf).min(axis=1) - 1.5 * radius - 0.004
            lanes, first = lanes[near.any(axis=1)], first[near.any(axis=1)]
            start_points = place.center + lanes[:, None] * across + first[:, None] * along
            enter, leave = place.ray_entry_and_exit(start_points, np.broadcast_to(along, start_points.shape))
            lengths = [np.where(enter + depth <= leave, enter + depth, np.nan) for depth in _DEPTHS]
            abreast = (place.center - start_points) @ along
            for length in [*lengths, 0.5 * abreast, np.where(np.isfinite(enter), np.nan, abreast)]:
                good = np.isfinite(length) & (length - radius > 0.008)
                if good.any():
                    yield Strokes(start_points[good], start_points[good] + (length[good, None] - radius) * along)

    def is_stroke_obstructed(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the blade would meet something that is fixed, or must stay, between two points (2,)."""
        way = end - start
        middle, length = (start + end) / 2, float(np.linalg.norm(way)) + 0.02
        area = rectangle_outline(
            (float(middle[0]), float(middle[1])), (length, BLADE_WIDTH), float(np.arctan2(way[1], way[0]))
        )
        return any(
            signed_outline_gaps(area, prism.outline, np.zeros((1, 2)))[0] < 0
            for prism in self.view.prisms
            if not self.view.may_robot_move(prism.owner)
        )

    def make_no_useful_stroke_stop(self) -> Stop:
        """No stroke is worth its effort: what is still astray."""
        places = self.pieces.places
        astray: list[int] = []
        for rows, wanted in self._groups:
            away = np.min([place.distance_outside(places[rows]) for place in wanted], axis=0)
            astray += [self.pieces.ids[int(row)] for row in rows[away > 0]]
        far = [
            number
            for number in astray
            if not self.view.arm.can_reach_point((*self.view.object_pose(number)[0][:2], HEIGHT))
        ]
        if far:
            detail = f"{len(far)} of {len(astray)} objects astray are out of the arm's reach: {self._join_labels(far)}"
            return make_oracle_stop("unreachable", detail, self.view, *far)
        detail = f"no stroke brings the last {len(astray)} objects nearer to their targets: {self._join_labels(astray)}"
        return make_oracle_stop("partial", detail, self.view, *astray)

    def _join_labels(self, numbers: Sequence[int]) -> str:
        return ", ".join(map(self.view.object_label, numbers[:5])) + (", ..." if len(numbers) > 5 else "")


def _goal_places_for_object(goal: Goal, row: int, spread: float, pos_eps: float, view: SceneView) -> list[Place]:
    """Where the centre of an object of a goal may be; ``spread``: from its centre to its farthest corner, metres."""
    zones = goal.zones
    if goal.relation_kind == "in_zone":
        zones = (object_footprint_as_zone(goal.reference_id, view),)
    if zones:
        return [
            Place(
                np.asarray(zone.pose[0][:2]),
                np.maximum(np.asarray(zone.size[:2]) - 2 * spread - 0.002, 0.004),
                transforms.yaw_of_quaternion(zone.pose[1]),
            )
            for zone in zones
        ]
    targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
    side = np.full(2, 1.2 * pos_eps)
    return [Place(np.asarray(target[0][:2]), side, transforms.yaw_of_quaternion(target[1])) for target in targets]


def _choose_emptiest_places(places: list[Place], points: FloatArray) -> list[Place]:
    """At most ``_AIMS`` of the places: far from all points (N, 2) and from one another."""
    if len(places) <= _AIMS:
        return places
    centers = np.array([place.center for place in places])
    room = np.linalg.norm(centers[:, None] - points, axis=2).min(axis=1)
    chosen: list[Place] = []
    while len(chosen) < _AIMS:
        index = int(np.argmax(room))
        chosen.append(places[index])
        room = np.minimum(room, np.linalg.norm(centers - centers[index], axis=1))
    return chosen


def _are_same_places(first: list[Place], second: list[Place]) -> bool:
    return len(first) == len(second) and all(
        a.yaw == b.yaw and np.allclose(a.center, b.center) and np.allclose(a.size, b.size, atol=0.004)
        for a, b in zip(first, second, strict=True)
    )


def _twice_signed_area(outline: FloatArray) -> float:
    x, y = outline[:, 0], outline[:, 1]
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
