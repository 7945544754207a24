"""Which objects of a scene a task uses: those in reach that stand free, and as few surprises as possible."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from grs_agents.models.offline.plan import (
    Family,
    Plan,
    Table,
    is_hard_to_topple,
    is_pickable_object,
    is_reachable_object,
    select_objects_without_overlap,
)
from grs_agents.models.offline.prompt_text import CUP_ROOM, SceneObject
from grs_agents.models.offline.task_families import FAMILIES, TaskRequest

MAX_OBJECTS = 6
"""The most objects one task moves."""
_OBJECT_COUNTS: dict[Family, tuple[int, int]] = {
    "pack": (3, MAX_OBJECTS),
    "stack": (2, 3),
    "sort": (3, MAX_OBJECTS),
    "line": (3, 5),
    "clear": (2, 4),
    "match": (2, 4),
    "place": (2, 4),
}
"""How many objects a family takes, at least where there are so many, and at most."""


_GAPS = (CUP_ROOM, 0.012, 0.004)
"""Free space around an object (m), the most first; with the least of it nothing touches."""
_LEVEL = 0.003
"""Undersides that differ by less are at one height (m): coordinates are rounded, and what rests sinks in a little."""


def rank_movable_objects(objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    """Choices of the objects that a task can move, the freest first, each of those that are at least so free.

    First come those without objects that are called as others of the scene are, since words cannot tell them apart.
    What carries others is in none of them. Where fewer than two objects can be picked where they stand, those that are
    the easiest to pick are put on a free part of the table, before all those whose name no other has.
    """
    called = count_called(objects)
    ranked = _list_groups_easiest_first(objects)
    return [*([obj for obj in group if called[obj.label] == 1] for group in ranked), *ranked]


def count_called(objects: Sequence[SceneObject]) -> Counter[str]:
    """How many of the objects each name fits: "the brown box" fits the tallest brown box too."""
    return Counter(name for obj in objects for name in {obj.label, obj.kind})


def _list_groups_easiest_first(objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    loose = [obj for obj in objects if is_uncovered_object(obj, objects)]
    usable = [obj for obj in filter(is_pickable_object, loose) if is_reachable_object(obj)]
    if len(usable) < 2:
        called = count_called(objects)
        rest = [obj for obj in loose if obj not in usable]
        others = sorted(rest, key=lambda obj: (called[obj.label] > 1, _rate_difficulty(obj)))
        return [relocate_unreachable_objects([*usable, *others][:2], objects), usable]
    sure = [obj for obj in usable if is_hard_to_topple(obj) and obj.is_flat_topped]
    return [*_group_by_clearance_gap(sure, objects), *_group_by_clearance_gap(usable, objects), usable]


def _group_by_clearance_gap(group: Sequence[SceneObject], objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    return [[obj for obj in group if is_clear_of_others(obj, objects, gap)] for gap in _GAPS]


def _rate_difficulty(obj: SceneObject) -> tuple[bool, bool, bool, float]:
    size = max(obj.size[:2]) + 0.5 * obj.size[2]
    return not is_pickable_object(obj), not obj.reachable, not is_hard_to_topple(obj), size


def is_uncovered_object(obj: SceneObject, objects: Sequence[SceneObject]) -> bool:
    """Whether nothing rests on it, as far as the boxes of ``objects`` tell."""
    return not any(
        other is not obj and other.low > obj.low + _LEVEL and obj.footprint_rect.overlaps(other.footprint_rect, -0.01)
        for other in objects
    )


def is_clear_of_others(obj: SceneObject, objects: Sequence[SceneObject], gap: float) -> bool:
    """Whether none of ``objects`` comes closer to it than ``gap`` (m), seen from above."""
    return not any(other is not obj and obj.footprint_rect.overlaps(other.footprint_rect, gap) for other in objects)


def relocate_unreachable_objects(objects: Sequence[SceneObject], scene: Sequence[SceneObject]) -> list[SceneObject]:
    """``objects`` of ``scene``, those that are held or out of reach put on a free part of the table if there is one."""
    table = Table([obj.footprint_rect for obj in scene])
    placed: list[SceneObject] = []
    for obj in objects:
        if is_reachable_object(obj):
            placed.append(obj)
        elif spot := table.reserve_free_place(*obj.room[:2]):
            placed.append(obj.relocate_to(*spot))
    return placed


def list_candidate_object_sets(
    family: Family, objects: Sequence[SceneObject], rng: np.random.Generator
) -> list[list[SceneObject]]:
    """Selections of objects for a family, the most interesting first; each is worth a try."""
    shuffled = [objects[int(index)] for index in rng.permutation(len(objects))]
    if family in ("pack", "stack"):
        shuffled = [obj for obj in shuffled if not obj.hollow]
    least, most = _OBJECT_COUNTS[family]
    if family == "stack":
        chains = _find_stackable_chains(shuffled)
        return [chains[int(index)][:count] for index in rng.permutation(len(chains)) for count in (most, least)]
    if family == "clear":
        return _find_object_clusters(shuffled, most)
    if family == "sort":
        return [select_objects_without_overlap(group, most) for group in _list_objects_of_few_kinds(shuffled)]
    return _list_small_object_groups(shuffled, int(rng.integers(least, most + 1)))


def _list_small_object_groups(objects: Sequence[SceneObject], count: int) -> list[list[SceneObject]]:
    """The first ``count`` of the objects and fewer of them, then any two, the smallest first, then one."""
    free = select_objects_without_overlap(objects, count)
    pairs = sorted(combinations(objects, 2), key=lambda pair: sum(obj.size[0] * obj.size[1] for obj in pair))
    return [*(free[:size] for size in range(len(free), 1, -1)), *map(list, pairs), free[:1]]


def find_plan_for_family(
    family: Family,
    objects: Sequence[SceneObject],
    request: TaskRequest,
    rng: np.random.Generator,
    least: int = 2,
    called: Mapping[str, int] | None = None,
) -> Plan | None:
    """The first selection of ``objects`` that ``family`` can use and that moves at least ``least`` of them.

    ``called`` counts the things on the table by what they are called: of those called alike, all are moved or none.
    """
    for chosen in list_candidate_object_sets(family, objects, rng):
        apart = called is None or _can_be_told_apart(family, chosen, called)
        plan = FAMILIES[family](chosen, request) if apart and len(chosen) >= least else None
        if plan is not None:
            return plan
    return None


def _can_be_told_apart(family: Family, chosen: Sequence[SceneObject], called: Mapping[str, int]) -> bool:
    """Whether words tell the objects from the others on the table: "the 2 gray cans" where there are no more."""
    labels = Counter(obj.label for obj in chosen)
    counted = family in ("pack", "place", "clear")
    return all(called[label] == count and (counted or count == 1) for label, count in labels.items())


def _find_stackable_chains(objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    order = sorted(objects, key=lambda obj: -obj.size[0] * obj.size[1])
    chains: list[list[SceneObject]] = []
    for start in range(len(order)):
        chain: list[SceneObject] = []
        for obj in order[start:]:
            fits = not chain or all(b >= a - 0.004 for a, b in zip(obj.size[:2], chain[-1].size[:2], strict=True))
            low = obj.size[2] <= 2.0 * min(obj.size[:2])
            if fits and low and len(select_objects_without_overlap([*chain, obj], len(chain) + 1)) > len(chain):
                chain.append(obj)
        if len(chain) >= 2 and all(obj.is_flat_topped for obj in chain[:-1]):
            chains.append(chain)
    return chains


def _find_object_clusters(objects: Sequence[SceneObject], most: int) -> list[list[SceneObject]]:
    """For each object those within 28 cm of it, the nearest first, where there are at least two."""
    clusters: list[list[SceneObject]] = []
    for seed in objects:
        pairs = [(math.dist(obj.position[:2], seed.position[:2]), obj) for obj in objects]
        near = [obj for distance, obj in sorted(pairs, key=lambda pair: pair[0]) if distance < 0.28]
        clusters.append(select_objects_without_overlap(near, most))
    return [cluster for cluster in clusters if len(cluster) >= 2]


def _list_objects_of_few_kinds(objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    selections: list[list[SceneObject]] = []
    for labels in ([obj.category for obj in objects], [obj.color for obj in objects]):
        names = list(dict.fromkeys(labels))
        for count in (3, 2):
            pairs = zip(objects, labels, strict=True)
            selections.append([obj for obj, label in pairs if label in names[:count]])
    return selections
