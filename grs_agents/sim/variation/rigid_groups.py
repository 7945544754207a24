"""Rigid groups of a scene: objects in contact or tied, and the places of goals on them, which move together.

So a task's words stay true: a container keeps its contents and the targets inside it, a zone the mark that shows it,
and objects that swap places are still wanted at each other's position.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.goals.planning_scene import PlanningScene, enclosing_object_ids, supporting_object_ids
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.world.footprints import (
    Prism,
    margins_inside_outline,
    object_prism_at_pose,
    outline_of_zone,
    signed_outline_gaps,
)
from grs_agents.sim.world.spec import load_object_model

Place = tuple[int, int]
"""A target or a zone of a goal: the index of the goal, and its index within that goal."""
_POINT: Final = np.zeros((1, 2))
_SLACK: Final = 0.02
"""Overhang up to which a zone belongs to the object below it, metres."""
_BESIDE: Final = 0.12
"""Distance from an object up to which a place may be described relative to it, metres."""
_SAME_GROUP: Final = 0.03
"""Gap to a moving target below which a target belongs to the same arrangement, metres."""
_FLAT: Final = 0.005
"""Height up to which an object is a mark, metres: a target there belongs to the object on the mark, if there is any."""
_SIDE = re.compile(
    r"\b(left|right|front|behind|before|next to|besides?|near|nearby|close|between|around|alongside|opposite)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class OwnedPlaces:
    """Places that move, each with the object that it moves with; the others stay."""

    targets: dict[Place, int] = field(default_factory=dict[Place, int])
    zones: dict[Place, int] = field(default_factory=dict[Place, int])
    beside: frozenset[int] = frozenset()  # objects to whose side a goal's words refer
    between: tuple[tuple[int, int], ...] = ()  # pairs of such objects with a place between them


def prisms_of_objects(instance: TaskInstance, library: Library) -> dict[int, Prism]:
    """The prism around each object at its pose in the instance."""
    return {
        item.id: object_prism_at_pose(load_object_model(item, library), item.pose, item.id) for item in instance.objects
    }


def bounding_box_area(prism: Prism) -> float:
    """Area of the bounding box of an outline, m^2."""
    x0, y0, x1, y1 = prism.bounding_box_xy
    return (x1 - x0) * (y1 - y0)


def find_owned_places(instance: TaskInstance, library: Library, prisms: Mapping[int, Prism]) -> OwnedPlaces:
    """The owners of the targets and zones of an instance's goals: the objects that they move with."""
    places = OwnedPlaces()
    for number, goal in enumerate(instance.goals):
        for index, zone in enumerate(goal.zones):  # the smallest object below
            outline = outline_of_zone(zone)
            around = [
                (bounding_box_area(prism), owner)
                for owner, prism in prisms.items()
                if len(prism.outline) > 2 and margins_inside_outline(outline, prism.outline, _POINT)[0] >= -_SLACK
            ]
            if around:
                places.zones[number, index] = min(around)[1]
        for index, target in enumerate(goal.targets):
            owner = _object_that_carries_target(goal, number, target[0][:2], prisms, places.zones)
            if owner is not None:
                places.targets[number, index] = owner
    references: list[list[int]] = []
    for number, goal in enumerate(instance.goals):  # places on no object go with those that the words refer to
        zones = [(number, index) for index in range(len(goal.zones)) if (number, index) not in places.zones]
        targets = [(number, index) for index in range(len(goal.targets)) if (number, index) not in places.targets]
        named = _find_objects_named_in_goal(instance, goal, library, prisms) if zones or targets else []
        if named:
            places.zones.update(dict.fromkeys(zones, named[0]))
            places.targets.update(dict.fromkeys(targets, named[0]))
            references.append(named)
    _assign_touching_targets(instance, places.targets, prisms)
    between = tuple((named[0], other) for named in references for other in named[1:])
    return OwnedPlaces(places.targets, places.zones, frozenset(chain.from_iterable(references)), between)


def _object_that_carries_target(
    goal: Goal, number: int, point: Sequence[float], prisms: Mapping[int, Prism], zones: Mapping[Place, int]
) -> int | None:
    """Owner of a target: that of the zone around it, else the object below it, else None."""
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
    return max((candidate for candidate in over if candidate[1] >= 0), default=(False, 0.0, None))[2]


def _find_objects_named_in_goal(
    instance: TaskInstance, goal: Goal, library: Library, prisms: Mapping[int, Prism]
) -> list[int]:
    """Ids of the objects beside a goal's places that its words of side refer to, nearest first."""
    if not _SIDE.search(goal.language):
        return []
    words = set(re.findall(r"[a-z]+", goal.language.lower()))
    outlines = [np.array([target[0][:2]]) for target in goal.targets] + [outline_of_zone(zone) for zone in goal.zones]
    largest = max(bounding_box_area(prisms[number]) ** 0.5 / 2 for number in goal.objects)
    named: list[tuple[float, int]] = []
    for item in instance.objects:
        kind = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+", library.asset(item.asset).kind)}
        if item.id not in goal.objects and kind and kind <= words:
            gap = min((_gap_between_outlines(outline, prisms[item.id].outline) for outline in outlines), default=np.inf)
            if gap <= _BESIDE + largest:
                named.append((gap, item.id))
    return [number for _, number in sorted(named)]


def _gap_between_outlines(first: FloatArray, second: FloatArray) -> float:
    """Lower bound of the gap between two outlines, of which the first may be a point, metres."""
    if len(second) < 3:
        return float("inf")
    if len(first) == 1:
        return -float(margins_inside_outline(_POINT, second, first)[0])
    return float(signed_outline_gaps(first, second, _POINT)[0])


def _assign_touching_targets(instance: TaskInstance, targets: dict[Place, int], prisms: Mapping[int, Prism]) -> None:
    """Let targets of pose goals that touch a moving target move with it: levels of a stack, or of a row."""
    poses = {item.id: item.pose for item in instance.objects}
    outlines: dict[Place, FloatArray] = {}  # at each target, of the first object wanted there
    for number, goal in enumerate(instance.goals):
        for index, target in enumerate(goal.targets if goal.metric == "pose" else ()):
            row = next((row for row, match in enumerate(goal.matches) if match[index]), 0)
            member = goal.objects[row]
            shift = np.subtract(target[0][:2], poses[member][0][:2])
            outlines[number, index] = prisms[member].outline + shift
    waiting = [place for place in outlines if place not in targets]
    while waiting:
        moving = [(outlines[place], owner) for place, owner in targets.items() if place in outlines]
        touching: dict[Place, int] = {}
        for place in waiting:
            gaps = [(_gap_between_outlines(outlines[place], outline), owner) for outline, owner in moving]
            gap, owner = min(gaps, default=(np.inf, -1))
            if gap < _SAME_GROUP:
                touching[place] = owner
        if not touching:
            break
        targets.update(touching)
        waiting = [place for place in waiting if place not in targets]


_LEANING: Final = 0.3
"""Least slope of a contact normal that carries (sine of the angle)."""
_FLOATING: Final = 0.01


@dataclass(frozen=True)
class RigidGroup:
    """Objects that keep their relative poses, with the targets and zones of goals that belong to them."""

    objects: frozenset[int]
    targets: frozenset[Place] = frozenset()
    zones: frozenset[Place] = frozenset()
    pivot: tuple[float, float] = (0.0, 0.0)  # centre of rotation, metres
    turns: bool = True  # False: a goal's words refer to a side of it, as "left of" does


def find_rigid_groups(
    instance: TaskInstance, library: Library, scene: PlanningScene, ids: Mapping[int, int]
) -> tuple[RigidGroup, ...]:
    """The groups of an instance that may move.

    Args:
        scene: the instance at rest.
        ids: ids of the instance by those of ``scene``.

    Objects in mid-air, held there because the photo shows them so, are in no group.
    """
    prisms = prisms_of_objects(instance, library)
    places = find_owned_places(instance, library, prisms)
    solid = [number for number in scene.object_ids if scene.object_model(number).colliders]
    standing = [
        (number, support)
        for number in solid
        for support in supporting_object_ids(number, scene) | enclosing_object_ids(number, scene)
    ]
    physics, contacts = scene.physics, scene.physics.data.contact
    owners = physics.world.owner_of_geom[contacts.geom].reshape(-1, 2)
    steep = np.abs(np.asarray(contacts.frame).reshape(-1, 9)[:, 2]) > _LEANING
    leaning = owners[steep & (owners >= 0).all(axis=1) & (owners[:, 0] != owners[:, 1])].tolist()
    groups = _Groups(item.id for item in instance.objects)
    for tie in instance.ties:
        groups.join_groups_of(tie.parent, tie.child)
    for first, second in [*standing, *leaning]:
        groups.join_groups_of(ids[first], ids[second])
    for first, second in places.between:
        groups.join_groups_of(first, second)
    held = {
        item.id
        for item in instance.objects
        if item.role == "bystander"
        and item.category == "fixed"
        and prisms[item.id].low > _FLOATING
        and len(groups.group_of(item.id)) == 1
    }
    rigid: list[RigidGroup] = []
    for members in groups.all_groups():
        if held.intersection(members):
            continue
        lowest = min(prisms[number].low for number in members)
        base = max(
            (number for number in members if prisms[number].low < lowest + _FLOATING),
            key=lambda number: (bounding_box_area(prisms[number]), -number),
        )
        x, y, _ = next(item.pose[0] for item in instance.objects if item.id == base)
        rigid.append(
            RigidGroup(
                objects=frozenset(members),
                targets=frozenset(place for place, owner in places.targets.items() if owner in members),
                zones=frozenset(place for place, owner in places.zones.items() if owner in members),
                pivot=(x, y),
                turns=not places.beside.intersection(members),
            )
        )
    return tuple(rigid)


class _Groups:
    """Disjoint sets of ids."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self._group = {number: [number] for number in numbers}

    def join_groups_of(self, a: int, b: int) -> None:
        """Merge the groups of two ids."""
        first, second = self._group[a], self._group[b]
        if first is not second:
            first.extend(second)
            self._group.update(dict.fromkeys(second, first))

    def group_of(self, number: int) -> list[int]:
        """The group of an id."""
        return self._group[number]

    def all_groups(self) -> list[list[int]]:
        """Every group, without repetitions."""
        return list({id(group): group for group in self._group.values()}.values())
