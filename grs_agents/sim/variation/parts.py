"""What of a scene moves as one: what stands on or in another thing, what is tied, and the places of goals there.

So the words of a task stay true: a container keeps its contents and the targets inside it, a zone the mark that shows
it, two objects that change places are each still wanted where the other one stands.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.library.library import Library
from grs_agents.sim.goals.scene_view import SceneView, enclosing_object_ids, supporting_object_ids
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.variation.places import (
    OwnedPlaces,
    Place,
    bounding_box_area,
    find_owned_places,
    prisms_of_objects,
)
from grs_agents.sim.world.footprints import Prism

_LEANING: Final = 0.3
"""A contact whose normal rises more steeply than this (sine of the angle) carries something."""
_FLOATING: Final = 0.01


@dataclass(frozen=True)
class Part:
    """Objects that keep their places to one another, with the targets and zones of goals that belong to them."""

    objects: frozenset[int]
    targets: frozenset[Place] = frozenset()
    zones: frozenset[Place] = frozenset()
    pivot: tuple[float, float] = (0.0, 0.0)  # what it turns about, metres
    turns: bool = True  # False: a goal's words tell a side of it, as "left of" does


def find_parts(instance: TaskInstance, library: Library, view: SceneView, ids: Mapping[int, int]) -> tuple[Part, ...]:
    """The parts of an instance that may move.

    ``view`` is its scene at rest, ``ids`` the instance's ids by those of that scene. What hangs in the air, held there
    because the photo shows it so, is in no part.
    """
    prisms = prisms_of_objects(instance, library)
    places = find_owned_places(instance, library, prisms)
    groups = _Groups(item.id for item in instance.objects)
    for tie in instance.ties:
        groups.join_groups_of(tie.parent, tie.child)
    for one, other in [*_supported_or_enclosed_pairs(view), *_leaning_pairs(view)]:
        groups.join_groups_of(ids[one], ids[other])
    for one, other in places.between:
        groups.join_groups_of(one, other)
    held = {
        item.id
        for item in instance.objects
        if item.role == "bystander"
        and item.category == "fixed"
        and prisms[item.id].low > _FLOATING
        and len(groups.group_of(item.id)) == 1
    }
    return tuple(
        _make_part(members, instance, prisms, places)
        for members in groups.all_groups()
        if not held.intersection(members)
    )


class _Groups:
    """Ids, joined into groups."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self._group = {number: [number] for number in numbers}

    def join_groups_of(self, one: int, other: int) -> None:
        """Make the groups of two ids one."""
        first, second = self._group[one], self._group[other]
        if first is not second:
            first.extend(second)
            self._group.update(dict.fromkeys(second, first))

    def group_of(self, number: int) -> list[int]:
        """The group of an id."""
        return self._group[number]

    def all_groups(self) -> list[list[int]]:
        """Every group once."""
        return list({id(group): group for group in self._group.values()}.values())


def _supported_or_enclosed_pairs(view: SceneView) -> list[tuple[int, int]]:
    """Pairs of objects of which one stands on the other, or in it."""
    solid = [number for number in view.object_ids if view.object_model(number).colliders]
    return [
        (number, other)
        for number in solid
        for other in supporting_object_ids(number, view) | enclosing_object_ids(number, view)
    ]


def _leaning_pairs(view: SceneView) -> list[tuple[int, int]]:
    """Pairs of objects at rest of which one leans on the other."""
    physics = view.physics
    contacts = physics.data.contact
    owners = physics.world.owner_of_geom[contacts.geom].reshape(-1, 2)
    steep = np.abs(np.asarray(contacts.frame).reshape(-1, 9)[:, 2]) > _LEANING
    rows = owners[steep & (owners >= 0).all(axis=1) & (owners[:, 0] != owners[:, 1])]
    return [(int(one), int(other)) for one, other in rows]


def _make_part(members: list[int], instance: TaskInstance, prisms: Mapping[int, Prism], places: OwnedPlaces) -> Part:
    own = frozenset(members)
    lowest = min(prisms[number].low for number in own)
    base = max(
        (number for number in own if prisms[number].low < lowest + _FLOATING),
        key=lambda number: (bounding_box_area(prisms[number]), -number),
    )
    x, y, _ = next(item.pose[0] for item in instance.objects if item.id == base)
    return Part(
        objects=own,
        targets=frozenset(place for place, owner in places.targets.items() if owner in own),
        zones=frozenset(place for place, owner in places.zones.items() if owner in own),
        pivot=(x, y),
        turns=not own & places.beside,
    )
