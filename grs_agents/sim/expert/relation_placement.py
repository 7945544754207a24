"""Where the oracle puts the objects of typed goals: spots at which the goal's own definition says that it holds."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.geometry import transforms
from grs_agents.sim.expert.zone_packing import explain_no_spot, pack_zone, region_of, turns_to_try
from grs_agents.sim.goals import SceneView, ScoredTask, shortfall, shortfalls, zone_covered_by
from grs_agents.sim.instance import Goal, Stop
from grs_agents.sim.motion import (
    Blocked,
    FloatArray,
    ReachTest,
    Region,
    Spot,
    Target,
    find_spot,
    point_text,
    reach_note,
    turned_outline,
    wrap_angle,
)
from grs_agents.sim.world import Prism, rest_heights, signed_gaps

_GAPS: Final = (0.015, 0.006, 0.003)
_MARGIN: Final = 0.3
"""Share of the distance of a ``near`` goal that is kept in hand."""
_BESIDE: Final = 0.03
"""Free space between the objects of a line without a spacing of its own, metres."""
_ARRIVED: Final = 0.005
Offsets = npt.NDArray[np.bool_]


class RelationPlanner:
    """Chooses spots for typed goals; remembers the places of a line."""

    def __init__(self) -> None:
        self._lines: dict[Goal, dict[int, tuple[float, float]]] = {}

    def target(self, goal: Goal, row: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
        """Where the object of one row of a typed goal should go, or why nowhere; arguments as `Planner` takes them."""
        number = goal.objects[row]
        if goal.kind == "upright":
            return _cannot_right(number, view)
        if goal.kind == "stacked":
            return _on_top(goal.objects[goal.objects.index(number) - 1], goal, number, task, view, lift)
        if goal.kind == "aligned":
            return self._in_line(goal, number, task, view, lift)
        if goal.kind == "near":
            return _first_valid_spot(_spots_beside(goal, number, view, lift), goal, number, task, view, lift)
        return _spot_on_reference(goal, number, task, view, lift)

    def rows(self, goal: Goal, view: SceneView) -> list[int]:
        """Rows of a ``stacked`` or ``aligned`` goal whose objects must move, in the order in which they must."""
        if goal.kind == "stacked":
            levels = range(1, len(goal.objects))
            return [level for level in levels if shortfall(goal, goal.objects[level], view)]
        planned = self._lines.get(goal, {})
        return [
            row
            for row, number in enumerate(goal.objects)
            if number not in planned or math.dist(planned[number], view.pose(number)[0][:2]) > _ARRIVED
        ]

    def _in_line(self, goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
        plan = self._lines.get(goal) or _plan_line(goal, view, lift)
        if plan is None:
            name = view.name(number)
            return Stop("no_free_space", f"no free line within reach for {len(goal.objects)} objects", (name,))
        self._lines[goal] = plan
        spot = _lower_at(plan[number], 0.0, number, view)
        blocker = _in_the_way(spot, number, view)
        if blocker is not None:
            return Blocked(blocker, (_outline_at(number, spot, view),))
        placed = {other: _pose_at(Spot(plan[other], 0.0, 0.0), other, view) for other in goal.objects}
        if any(shortfalls(goal, view.supposing(placed), task.rot_eps)):
            return _no_spot(goal, number, view)
        return spot if _reached(spot, view, lift) else _too_far(number, spot, view, lift)


def view_after_placing(spot: Spot, number: int, view: SceneView) -> SceneView:
    """The scene once an object has been put at a spot."""
    return view.supposing({number: _pose_at(spot, number, view)})


def _pose_at(spot: Spot, number: int, view: SceneView) -> Pose:
    (_, _, z), rotation = view.pose(number)
    about = ((0.0, 0.0, 0.0), transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, spot.turn)))
    turned_by = transforms.multiply(about, ((0.0, 0.0, 0.0), rotation))[1]
    return (spot.center[0], spot.center[1], spot.height + z - view.outline(number).low), transforms.quat(turned_by)


def _first_valid_spot(
    spots: Iterator[Spot], goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float
) -> Spot | Stop:
    """The first spot within reach at which the goal's definition holds."""
    far: Spot | None = None
    for spot in spots:
        if not _reached(spot, view, lift):
            far = far or spot
        elif not shortfall(goal, number, view_after_placing(spot, number, view), task.rot_eps):
            return spot
    return _too_far(number, far, view, lift) if far else _no_spot(goal, number, view)


def _reached(spot: Spot, view: SceneView, lift: float) -> bool:
    return bool(ReachTest(lift, view.arm)(np.array([spot.center]), np.array([spot.height]))[0])


def _too_far(number: int, spot: Spot, view: SceneView, lift: float) -> Stop:
    tip = (*spot.center, spot.height + lift)
    return Stop(
        "unreachable",
        f"target of {view.name(number)} at {point_text(tip)} {reach_note(tip, view.arm)}",
        (view.name(number),),
    )


def _no_spot(goal: Goal, number: int, view: SceneView) -> Stop:
    other = "".join(f" {view.name(other)}" for other in goal.named[len(goal.objects) :])
    words = f"no spot at which {view.name(number)} would be {str(goal.kind).replace('_', ' ')}{other} is free"
    return Stop("target_occupied", words, (view.name(number),))


def _outline_at(number: int, spot: Spot, view: SceneView) -> Prism:
    return view.supposing({number: _pose_at(spot, number, view)}).outline(number)


def _lower_at(center: tuple[float, float], turn: float, number: int, view: SceneView) -> Spot:
    """Where an object comes to rest that is lowered at a point."""
    shape = turned_outline(view.outline(number), np.asarray(view.pose(number)[0][:2]), turn)
    height = rest_heights(shape, view.others(number), np.array([center]), -0.0005)
    return Spot(center, turn, float(height[0]))


def _cannot_right(number: int, view: SceneView) -> Stop:
    name, tilt = view.name(number), np.rad2deg(view.tilt(number))
    return Stop(
        "toppled", f"{name} lies on its side (tilt {tilt:.0f} deg): a tool that points down cannot right it", (name,)
    )


def _on_top(below: int, goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
    """Centred on what is below it, turned along with it; what stands there goes first."""
    center = (view.pose(below)[0][0], view.pose(below)[0][1])
    turn = wrap_angle(view.yaw(below) - view.yaw(number), np.pi / 2)
    spots = [_lower_at(center, angle, number, view) for angle in (turn, 0.0)]
    target = _first_valid_spot(iter(spots), goal, number, task, view, lift)
    if isinstance(target, Spot) or target.outcome == "unreachable":
        return target
    blocker = _in_the_way(spots[0], number, view, below)
    return Blocked(blocker, (_outline_at(number, spots[0], view),)) if blocker is not None else target


def _in_the_way(spot: Spot, number: int, view: SceneView, below: int = -1) -> int | None:
    """A movable object, other than the one ``below``, that holds an object up at a spot."""
    shape = turned_outline(view.outline(number), np.asarray(view.pose(number)[0][:2]), spot.turn)
    owners = [
        prism.owner
        for prism in view.others(number, below)
        if prism.high > spot.height - 0.003
        and view.is_free(prism.owner)
        and signed_gaps(shape.outline, prism.outline, np.array([spot.center]))[0] < -0.0005
    ]
    return owners[0] if owners and spot.height > 0.003 else None


def _spot_on_reference(goal: Goal, number: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
    """In a container, on a support or in a zone: packed with its fellows, as clear of one another as fits."""
    zone = zone_covered_by(goal.reference, view)
    members = [number, *(other for other in _unplaced_fellows(goal, task, view) if other != number)]
    plan = pack_zone(zone, members, view, lift)
    candidates = [plan[number]] if number in plan else []
    target = _first_valid_spot(_candidate_spots(candidates, goal, number, view, lift), goal, number, task, view, lift)
    if isinstance(target, Spot):
        return target
    reason = explain_no_spot(zone, number, members, view, lift)
    if isinstance(reason, Spot):
        return _first_valid_spot(iter([reason]), goal, number, task, view, lift)
    return reason


def _unplaced_fellows(goal: Goal, task: ScoredTask, view: SceneView) -> list[int]:
    """Objects that goals still want there too, and are not there yet."""
    members: list[int] = []
    for other in task.goals:
        if other.same_relation(goal):
            members += [number for number in other.objects if shortfall(other, number, view, task.rot_eps)]
    return list(dict.fromkeys(members))


def _candidate_spots(first: Sequence[Spot], goal: Goal, number: int, view: SceneView, lift: float) -> Iterator[Spot]:
    """Spots by preference: as packed; clear in the middle; centred, however it rests there."""
    yield from first
    region = region_of(zone_covered_by(goal.reference, view))
    body, center = view.outline(number), view.pose(number)[0]
    turns = turns_to_try(number, region, view)
    for gap in _GAPS:
        spot = find_spot(body, center, turns, region, view.others(number), gap, ReachTest(lift, view.arm), spread=True)
        if spot is not None:
            yield spot
    if goal.kind != "inside":
        for turn in turns:
            yield _lower_at(region.center, turn, number, view)


def _spots_beside(goal: Goal, number: int, view: SceneView, lift: float) -> Iterator[Spot]:
    """Free spots around the other object, at no more than the distance asked for."""
    other, bound = view.outline(goal.reference), goal.distance or 0.0
    body, center = view.outline(number), view.pose(number)[0]
    x0, y0, x1, y1 = other.box
    for turn in (0.0, wrap_angle(view.yaw(goal.reference) - view.yaw(number), np.pi / 2), np.pi / 2):
        shape = turned_outline(body, np.asarray(center[:2]), turn)
        reach = 2 * (float(np.abs(shape.outline).max()) + bound)
        region = Region(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0 + 2 * reach, y1 - y0 + 2 * reach), 0.0)
        for share in (_MARGIN, 0.1):
            suits = _near_enough(shape.outline, other.outline, (1 - share) * bound, ReachTest(lift, view.arm))
            for gap in (0.01, 0.004):
                clear = min(gap, 0.5 * bound)
                spot = find_spot(
                    body, center, [turn], region, view.others(number), clear, suits, spread=True, near=center
                )
                if spot is not None:
                    yield spot


def _near_enough(
    shape: FloatArray, other: FloatArray, bound: float, suits: Callable[[FloatArray, FloatArray], Offsets]
) -> Callable[[FloatArray, FloatArray], Offsets]:
    def around(offsets: FloatArray, heights: FloatArray) -> Offsets:
        return (signed_gaps(shape, other, offsets) < bound) & suits(offsets, heights)

    return around


def _plan_line(goal: Goal, view: SceneView, lift: float) -> dict[int, tuple[float, float]] | None:
    """Free places for all objects on a line across the table, in the order in which they lie across it."""
    objects = sorted(goal.objects, key=lambda number: view.pose(number)[0][1])
    widths = [max(view.outline(number).box[3] - view.outline(number).box[1], 0.01) for number in objects]
    least = max((first + second) / 2 for first, second in pairwise(widths)) + _BESIDE
    step = goal.distance or least
    places = (np.arange(len(objects)) - (len(objects) - 1) / 2) * step
    obstacles = view.others(*objects)
    bounds = view.bounds
    middle = np.mean([view.pose(number)[0][:2] for number in objects], axis=0)
    xs, ys = np.arange(bounds[0, 0], bounds[0, 1], 0.02), np.arange(bounds[1, 0], bounds[1, 1], 0.02)
    centers = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    for axis in ((0.0, 1.0), (1.0, 0.0)):
        good = np.ones(len(centers), dtype=bool)
        for number, place in zip(objects, places, strict=True):
            shape = turned_outline(view.outline(number), np.asarray(view.pose(number)[0][:2]), 0.0)
            offsets = centers + place * np.asarray(axis)
            heights = rest_heights(shape, obstacles, offsets, 0.01)
            inside = ((offsets >= bounds[:2, 0]) & (offsets <= bounds[:2, 1])).all(axis=1)
            good &= inside & (heights < 0.002) & ReachTest(lift, view.arm)(offsets, heights)
        if good.any():
            best = centers[good][np.linalg.norm(centers[good] - middle, axis=1).argmin()]
            spots = best + places[:, None] * np.asarray(axis)
            return {number: (float(x), float(y)) for number, (x, y) in zip(objects, spots, strict=True)}
    return None
