"""Which object each place that a goal names moves with: a container, a mark, what the words tell a side of."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.world.footprints import (
    Prism,
    margins_inside_outline,
    object_prism_at_pose,
    rectangle_outline,
    signed_outline_gaps,
)
from grs_agents.sim.world.spec import load_object_model

Place = tuple[int, int]
"""A target or a zone of a goal: the number of the goal, and its own in that goal."""
_POINT: Final = np.zeros((1, 2))
_SLACK: Final = 0.02
"""A zone that reaches no farther than this (m) over the outline of a thing is that thing's."""
_BESIDE: Final = 0.12
"""Metres from a thing within which a place may be told by where that is."""
_SAME_GROUP: Final = 0.03
"""Targets closer than this (m) to one that moves belong to one arrangement with it."""
_FLAT: Final = 0.005
"""What is no higher than this (m) is a mark: a target there belongs to what stands over the mark, if anything does."""
_SIDE = re.compile(
    r"\b(left|right|front|behind|before|next to|besides?|near|nearby|close|between|around|alongside|opposite)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class OwnedPlaces:
    """The places that move, each with the object that it moves with; the others stay."""

    targets: dict[Place, int] = field(default_factory=dict[Place, int])
    zones: dict[Place, int] = field(default_factory=dict[Place, int])
    beside: frozenset[int] = frozenset()  # objects that a goal's words tell a side of
    between: tuple[tuple[int, int], ...] = ()  # pairs of such, which a place lies between


def outline_of_zone(zone: Zone) -> FloatArray:
    """A zone seen from above (4, 2)."""
    (x, y, _), turn = zone.pose
    return rectangle_outline((x, y), zone.size[:2], transforms.yaw_of_quaternion(turn))


def prisms_of_objects(instance: TaskInstance, library: Library) -> dict[int, Prism]:
    """The prism around each object where the instance puts it."""
    return {
        item.id: object_prism_at_pose(load_object_model(item, library), item.pose, item.id) for item in instance.objects
    }


def bounding_box_area(prism: Prism) -> float:
    """The area of the box around an outline, m^2."""
    x0, y0, x1, y1 = prism.bounding_box_xy
    return (x1 - x0) * (y1 - y0)


def find_owned_places(instance: TaskInstance, library: Library, prisms: Mapping[int, Prism]) -> OwnedPlaces:
    """Which objects the targets and zones of an instance's goals move with."""
    places = OwnedPlaces()
    for number, goal in enumerate(instance.goals):
        zones = {(number, index): _owner_of_zone(zone, prisms) for index, zone in enumerate(goal.zones)}
        places.zones.update(_drop_places_without_owner(zones))
        targets = {
            (number, index): _object_that_carries_target(goal, number, target[0][:2], prisms, places.zones)
            for index, target in enumerate(goal.targets)
        }
        places.targets.update(_drop_places_without_owner(targets))
    told = [*_assign_places_named_in_goal(instance, library, prisms, places)]
    _assign_touching_targets(instance, places.targets, prisms)
    between = tuple((named[0], other) for named in told for other in named[1:])
    return OwnedPlaces(places.targets, places.zones, frozenset(one for named in told for one in named), between)


def _drop_places_without_owner(owners: Mapping[Place, int | None]) -> dict[Place, int]:
    return {place: owner for place, owner in owners.items() if owner is not None}


def _owner_of_zone(zone: Zone, prisms: Mapping[int, Prism]) -> int | None:
    """The smallest object that a zone lies over, or is shown by."""
    outline = outline_of_zone(zone)
    around = [
        (bounding_box_area(prism), number)
        for number, prism in prisms.items()
        if len(prism.outline) > 2 and margins_inside_outline(outline, prism.outline, _POINT)[0] >= -_SLACK
    ]
    return min(around)[1] if around else None


def _object_that_carries_target(
    goal: Goal, number: int, point: Sequence[float], prisms: Mapping[int, Prism], zones: Mapping[Place, int]
) -> int | None:
    """What a target moves with: the owner of the zone that it lies in, else what it lies over, else nothing."""
    middle = np.array([point])
    if goal.zones:
        outlines = map(outline_of_zone, goal.zones)
        margins = [margins_inside_outline(_POINT, outline, middle)[0] for outline in outlines]
        return zones.get((number, int(np.argmax(margins))))
    over = [
        (prism.high > prism.low + _FLAT, float(margins_inside_outline(_POINT, prism.outline, middle)[0]), owner)
        for owner, prism in prisms.items()
        if len(prism.outline) > 2
    ]
    best = max((one for one in over if one[1] >= 0), default=None)
    return None if best is None else best[2]


def _assign_places_named_in_goal(
    instance: TaskInstance, library: Library, prisms: Mapping[int, Prism], places: OwnedPlaces
) -> Iterator[list[int]]:
    """Give places that lie on or in nothing to what a goal's words tell a side of; yields the ids of these."""
    for number, goal in enumerate(instance.goals):
        zones = [(number, index) for index in range(len(goal.zones)) if (number, index) not in places.zones]
        targets = [(number, index) for index in range(len(goal.targets)) if (number, index) not in places.targets]
        named = _find_objects_named_in_goal(instance, goal, library, prisms) if zones or targets else []
        if named:
            places.zones.update(dict.fromkeys(zones, named[0]))
            places.targets.update(dict.fromkeys(targets, named[0]))
            yield named


def _find_objects_named_in_goal(
    instance: TaskInstance, goal: Goal, library: Library, prisms: Mapping[int, Prism]
) -> list[int]:
    """Ids of the objects beside the goal's places that its words name, nearest first; empty without a word of side."""
    if not _SIDE.search(goal.language):
        return []
    words = set(re.findall(r"[a-z]+", goal.language.lower()))
    outlines = [np.array([target[0][:2]]) for target in goal.targets] + [outline_of_zone(zone) for zone in goal.zones]
    largest = max(bounding_box_area(prisms[number]) ** 0.5 / 2 for number in goal.objects)
    found: list[tuple[float, int]] = []
    for item in instance.objects:
        if item.id not in goal.objects and _is_asset_kind_in_words(item, words, library):
            gap = min((_gap_between_outlines(outline, prisms[item.id].outline) for outline in outlines), default=np.inf)
            if gap <= _BESIDE + largest:
                found.append((gap, item.id))
    return [number for _, number in sorted(found)]


def _is_asset_kind_in_words(item: InstanceObject, words: set[str], library: Library) -> bool:
    kind = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+", library.asset(item.asset).kind)}
    return bool(kind) and kind <= words


def _gap_between_outlines(first: FloatArray, second: FloatArray) -> float:
    """Between two outlines, of which the first may be a point, metres; about, and never too much."""
    if len(second) < 3:
        return float("inf")
    if len(first) == 1:
        return -float(margins_inside_outline(_POINT, second, first)[0])
    return float(signed_outline_gaps(first, second, _POINT)[0])


def _assign_touching_targets(instance: TaskInstance, targets: dict[Place, int], prisms: Mapping[int, Prism]) -> None:
    """Targets of pose goals that touch one that moves go with it: they are levels of a stack, or a row."""
    outlines = dict(_outlines_at_targets(instance, prisms))
    waiting = [place for place in outlines if place not in targets]
    found = True
    while found:
        near = {place: _nearest_owner(outlines[place], outlines, targets) for place in waiting}
        found = bool(_drop_places_without_owner(near))
        targets.update(_drop_places_without_owner(near))
        waiting = [place for place in waiting if place not in targets]


def _nearest_owner(
    outline: FloatArray, outlines: Mapping[Place, FloatArray], targets: Mapping[Place, int]
) -> int | None:
    gaps = [
        (_gap_between_outlines(outline, outlines[other]), owner)
        for other, owner in targets.items()
        if other in outlines
    ]
    gap, owner = min(gaps, default=(np.inf, -1))
    return owner if gap < _SAME_GROUP else None


def _outlines_at_targets(instance: TaskInstance, prisms: Mapping[int, Prism]) -> Iterator[tuple[Place, FloatArray]]:
    """Each target of a pose goal with the outline of the first object that is wanted there."""
    poses = {item.id: item.pose for item in instance.objects}
    for number, goal in enumerate(instance.goals):
        for index, target in enumerate(goal.targets if goal.metric == "pose" else ()):
            row = next((row for row, match in enumerate(goal.matches) if match[index]), 0)
            own = goal.objects[row]
            yield (number, index), prisms[own].outline + np.subtract(target[0][:2], poses[own][0][:2])
