"""The pushing oracle: picks the candidate stroke predicted to bring most pieces to their targets.

The prediction is a quick model: pieces in the blade's way queue up ahead of it, lane by lane.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.expert.oracle import Action, Oracle
from grs_agents.sim.goals.planning_scene import PlanningScene, make_oracle_stop
from grs_agents.sim.goals.relation_rules import object_footprint_as_zone
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.hands.spatula import BLADE_THICKNESS, BLADE_WIDTH
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.motion.push import HEIGHT, action_points_for_stroke
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.world.footprints import rectangle_outline, rotation_matrix_2d, signed_outline_gaps

BoolArray = npt.NDArray[np.bool_]
_LANES: Final = 11
"""Lanes across the blade's width in which pieces queue up."""


@dataclass(frozen=True)
class Pieces:
    """Pieces that may be pushed, seen from above."""

    ids: tuple[int, ...]
    places: FloatArray  # (N, 2) their centres, metres
    radii: FloatArray  # (N,) half of their mean widths, metres


@dataclass(frozen=True)
class Strokes:
    """S straight strokes of the blade's front, start and end points (S, 2) apart, metres."""

    start_points: FloatArray
    end_points: FloatArray

    @property
    def unit_directions(self) -> FloatArray:
        """Unit vectors (S, 2)."""
        step = self.end_points - self.start_points
        return step / np.linalg.norm(step, axis=1, keepdims=True)

    def select_by_mask(self, chosen: BoolArray) -> "Strokes":
        """The strokes of a mask (S,)."""
        return Strokes(self.start_points[chosen], self.end_points[chosen])


def _project_onto_strokes(strokes: Strokes, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coordinates (S, N) of places (N, 2) along each stroke from its start, and across it."""
    along = strokes.unit_directions
    offset = places[None] - strokes.start_points[:, None]
    ahead = offset[..., 0] * along[:, :1] + offset[..., 1] * along[:, 1:]
    aside = offset[..., 1] * along[:, :1] - offset[..., 0] * along[:, 1:]
    return ahead, aside


def find_clear_stroke_starts(strokes: Strokes, pieces: Pieces, margin: float = 0.003) -> BoolArray:
    """Mask (S,) of the strokes whose start is clear of pieces, so that the blade comes down on none."""
    ahead, aside = _project_onto_strokes(strokes, pieces.places)
    reach = pieces.radii * 1.3 + margin
    under = (ahead > -BLADE_THICKNESS - reach) & (ahead < reach) & (np.abs(aside) < BLADE_WIDTH / 2 + reach)
    return np.logical_not(under.any(axis=1))


def predict_piece_positions(strokes: Strokes, pieces: Pieces) -> FloatArray:
    """Predicted positions (S, N, 2) of the pieces after each stroke alone."""
    ahead, aside = _project_onto_strokes(strokes, pieces.places)
    length = np.linalg.norm(strokes.end_points - strokes.start_points, axis=1)[:, None]
    half = BLADE_WIDTH / 2
    swept = (np.abs(aside) < half) & (ahead > 0)
    lane = np.clip(((aside + half) * (_LANES / BLADE_WIDTH)).astype(int), 0, _LANES - 1)
    width = BLADE_WIDTH / _LANES
    order = np.argsort(np.where(swept, ahead, np.inf), axis=1)
    front = np.repeat(length, _LANES, axis=1)  # end of the queue in each lane, from the start
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
"""Extra cost of a piece outside its target area, metres, so that the last pieces count."""
_SIDE: Final = 0.3
"""Cost of moving a piece that no goal names, per metre."""
_LATER: Final = 0.1
"""Weight of pieces of later goals against those of the first open goal: goals are met in order, and later goals earn
nothing before. At 1, four strewn piles of 10 left the first goal open after 20 strokes in 5 of 5."""
_EFFORT: Final = 0.004
"""Least gain of a stroke, metres summed over all pieces."""
_ACROSS: Final = 0.02
_EDGE: Final = 0.035
"""Spacing of parallel strokes, and their margin beyond the outermost piece, metres."""
_DEPTHS: Final = (0.0, 0.012, 0.026, 0.045)
"""Depths of the blade within a target area at the end of a stroke, metres."""
_PATIENCE: Final = 7
"""Consecutive strokes without gain before giving up."""
_TRIED: Final = 60
_PAIRS, _FEWEST = 1_000_000, 200
"""Pieces times areas times strokes evaluated for a decision, and the least number of strokes."""
_AIMS: Final = 6
"""Most target areas that strokes aim at; of more, those farthest from all pieces and from each other."""


@dataclass(frozen=True)
class TargetArea:
    """Area for the centre of a piece: a turned rectangle, full extents ``size`` (2,), metres."""

    center: FloatArray
    size: FloatArray
    yaw: float

    def distance_outside(self, points: FloatArray) -> FloatArray:
        """Distances (...) of points (..., 2) from the area, metres; 0 inside."""
        local = np.abs((points - self.center) @ rotation_matrix_2d(self.yaw)) - self.size / 2
        return np.linalg.norm(np.maximum(local, 0.0), axis=-1)

    def ray_entry_and_exit(self, start_points: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances (R,) along rays (R, 2) to their entry and exit, metres; infinite for rays that miss."""
        origin, way = (start_points - self.center) @ rotation_matrix_2d(self.yaw), along @ rotation_matrix_2d(self.yaw)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-self.size / 2 - origin) / way, (self.size / 2 - origin) / way
        enter, leave = np.fmin(first, second).max(axis=1), np.fmax(first, second).min(axis=1)
        return np.where(enter <= leave, enter, np.inf), np.where(enter <= leave, leave, np.inf)


class PushOracle(Oracle):
    """Solves tasks whose primitive pushes; see `Oracle`."""

    def __init__(self, task: ScoredTask, table: TabletopSim) -> None:
        super().__init__(task, table)
        self._tried: list[FloatArray] = []
        self._least, self._vain, self._open = np.inf, 0, 0

    def _reset_episode_memory(self) -> None:
        super()._reset_episode_memory()
        self._tried, self._least, self._vain, self._open = [], np.inf, 0, 0  # strokes; least cost; gainless; open goals

    def _plan_for_unmet_goals(self, scene: PlanningScene) -> Action | Stop:
        problem = _PushProblem(self.task, scene)
        if not problem.targets:
            return Stop("error", "no goal says where things are to be pushed to: state 'zone', 'pose' or in_zone")
        cost = float(problem.placement_cost(problem.pieces.places[None])[0])
        if len(self.task.goals) != self._open:  # the weights changed: costs do not compare with earlier ones
            self._open, self._least = len(self.task.goals), np.inf
        self._vain = 0 if cost < self._least - _EFFORT else self._vain + 1
        self._least = min(self._least, cost)
        if cost == 0:
            return self._make_nothing_to_move_stop()
        strokes, gain = problem.propose_strokes_with_gain()
        best = None
        for index in np.argsort(-gain, kind="stable") if self._vain < _PATIENCE else ():
            if gain[index] < _EFFORT:
                break
            ends = np.array([strokes.start_points[index], strokes.end_points[index]])
            known = any(float(np.abs(done - ends.ravel()).max()) < 0.004 for done in self._tried)
            tips = np.column_stack([ends, [HEIGHT, HEIGHT]])
            if not known and self.table.arm.reachable_mask(tips).all() and not problem.is_stroke_obstructed(*ends):
                best = int(index)
                break
        if best is None:
            return problem.make_no_useful_stroke_stop()
        start, end = strokes.start_points[best], strokes.end_points[best]
        self._tried = [*self._tried[-_TRIED:], np.hstack([start, end])]
        back = strokes.unit_directions[best] * BLADE_THICKNESS / 2
        first, last = action_points_for_stroke(start - back, end - back)
        return {"pose0": (first, transforms.IDENTITY), "pose1": (last, transforms.IDENTITY)}


class _PushProblem:
    """Pieces, and the target areas of the goals for them."""

    def __init__(self, task: ScoredTask, scene: PlanningScene) -> None:
        self.scene = scene
        ids = tuple(number for number in scene.object_ids if scene.may_robot_move(number))
        outlines = [scene.object_prism(number).outline for number in ids]
        # the shoelace formula
        doubled = [np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)) for x, y in (line.T for line in outlines)]
        areas = np.array([0.5 * abs(float(area)) for area in doubled])
        centers = np.array([scene.object_pose(number)[0][:2] for number in ids]).reshape(-1, 2)
        self.pieces = Pieces(ids, centers, np.sqrt(areas) / 2)
        # by piece: the areas of the first open goal that names it, else of a met goal
        self.targets: dict[int, list[TargetArea]] = {}
        met = [goal for goal in scene.stated_goals if all(goal is not waiting for waiting in task.goals)]
        for goal in (*task.goals, *met):
            for row, number in enumerate(goal.objects):
                if number in ids and number not in self.targets:
                    spread = np.linalg.norm(outlines[ids.index(number)] - centers[ids.index(number)], axis=1).max()
                    if wanted := _goal_places_for_object(goal, row, float(spread), task.pos_eps, scene):
                        self.targets[number] = wanted
        groups: list[
            tuple[list[int], list[TargetArea]]
        ] = []  # rows of pieces with equal areas, as the grains of a pile
        for row, number in enumerate(ids):
            if number not in self.targets:
                continue
            wanted = self.targets[number]
            same = [
                rows
                for rows, known in groups
                if len(known) == len(wanted)
                and all(
                    a.yaw == b.yaw and np.allclose(a.center, b.center) and np.allclose(a.size, b.size, atol=0.004)
                    for a, b in zip(known, wanted, strict=True)
                )
            ]
            if same:
                same[0].append(row)
            else:
                groups.append(([row], wanted))
        self._groups = [(np.array(rows), wanted) for rows, wanted in groups]
        later = {number for goal in task.goals[1:] for number in goal.objects} - set(task.goals[0].objects)
        self._weights = [_LATER if all(ids[row] in later for row in rows.tolist()) else 1.0 for rows, _ in self._groups]

    def placement_cost(self, places: FloatArray) -> FloatArray:
        """Summed distance (S,) of pieces at ``places`` (S, N, 2) from their target areas, metres."""
        total = np.zeros(len(places))
        for (rows, wanted), weight in zip(self._groups, self._weights, strict=True):
            away = np.min([place.distance_outside(places[:, rows]) for place in wanted], axis=0)
            total += weight * (away + _ASTRAY * np.minimum(1.0, away / 0.004)).sum(axis=1)
        others = [row for row, number in enumerate(self.pieces.ids) if number not in self.targets]
        if others:
            total += _SIDE * np.linalg.norm(places[:, others] - self.pieces.places[others], axis=2).sum(axis=1)
        return total

    def propose_strokes_with_gain(self) -> tuple[Strokes, FloatArray]:
        """Candidate strokes, and the predicted gain of each (S,)."""
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

    def _strokes_towards_place(self, place: TargetArea, astray: npt.NDArray[np.intp]) -> Iterator[Strokes]:
        """Strokes from behind astray pieces (rows) into an area, in many directions side by side."""
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
        """Whether the blade would hit an immovable object between two points (2,)."""
        way = end - start
        middle, length = (start + end) / 2, float(np.linalg.norm(way)) + 0.02
        area = rectangle_outline(
            (float(middle[0]), float(middle[1])), (length, BLADE_WIDTH), float(np.arctan2(way[1], way[0]))
        )
        return any(
            signed_outline_gaps(area, prism.outline, np.zeros((1, 2)))[0] < 0
            for prism in self.scene.prisms
            if not self.scene.may_robot_move(prism.owner)
        )

    def make_no_useful_stroke_stop(self) -> Stop:
        """The stop when no stroke is worth its effort; it names the pieces still astray."""
        places = self.pieces.places
        astray: list[int] = []
        for rows, wanted in self._groups:
            away = np.min([place.distance_outside(places[rows]) for place in wanted], axis=0)
            astray += [self.pieces.ids[int(row)] for row in rows[away > 0]]
        far = [
            number
            for number in astray
            if not self.scene.arm.can_reach_point((*self.scene.object_pose(number)[0][:2], HEIGHT))
        ]
        if far:
            detail = f"{len(far)} of {len(astray)} objects astray are out of the arm's reach: {self._join_labels(far)}"
            return make_oracle_stop("unreachable", detail, self.scene, *far)
        detail = f"no stroke brings the last {len(astray)} objects nearer to their targets: {self._join_labels(astray)}"
        return make_oracle_stop("partial", detail, self.scene, *astray)

    def _join_labels(self, numbers: Sequence[int]) -> str:
        return ", ".join(map(self.scene.object_label, numbers[:5])) + (", ..." if len(numbers) > 5 else "")


def _goal_places_for_object(
    goal: Goal, row: int, spread: float, pos_eps: float, scene: PlanningScene
) -> list[TargetArea]:
    """Areas for the centre of an object of a goal; ``spread``: from its centre to its farthest corner, metres."""
    zones = goal.zones
    if goal.relation_kind == "in_zone":
        zones = (object_footprint_as_zone(goal.reference_id, scene),)
    if zones:
        return [
            TargetArea(
                np.asarray(zone.pose[0][:2]),
                np.maximum(np.asarray(zone.size[:2]) - 2 * spread - 0.002, 0.004),
                transforms.yaw_of_quaternion(zone.pose[1]),
            )
            for zone in zones
        ]
    targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
    side = np.full(2, 1.2 * pos_eps)
    return [TargetArea(np.asarray(target[0][:2]), side, transforms.yaw_of_quaternion(target[1])) for target in targets]


def _choose_emptiest_places(places: list[TargetArea], points: FloatArray) -> list[TargetArea]:
    """At most ``_AIMS`` of the areas, by farthest-point sampling: far from all points (N, 2) and from each other."""
    if len(places) <= _AIMS:
        return places
    centers = np.array([place.center for place in places])
    room = np.linalg.norm(centers[:, None] - points, axis=2).min(axis=1)
    chosen: list[TargetArea] = []
    while len(chosen) < _AIMS:
        index = int(np.argmax(room))
        chosen.append(places[index])
        room = np.minimum(room, np.linalg.norm(centers - centers[index], axis=1))
    return chosen
