"""Which objects of a scene a task uses: those in reach that stand free, and as few surprises as possible."""

import math
from collections.abc import Sequence

import numpy as np

from grs_agents.models.offline.plan import (
    Family,
    Plan,
    Table,
    is_pickable_object,
    is_reachable_object,
    is_steady_object,
    select_non_overlapping,
)
from grs_agents.models.offline.prompt_text import SceneObject
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


def select_movable_objects(objects: Sequence[SceneObject]) -> list[SceneObject]:
    """The objects a task can move, standing where the photo shows them.

    Where fewer than two of them stand free within reach, others are put on a free part of the table, even such as
    cannot be picked with certainty.
    """
    ready = [
        obj.snap_to_table()
        for obj in objects
        if is_pickable_object(obj) and is_reachable_object(obj) and obj.stands_on_table
    ]
    good = [obj for obj in ready if is_steady_object(obj)]
    if len(select_non_overlapping(good, MAX_OBJECTS)) >= 2:
        return good
    if len(select_non_overlapping(ready, MAX_OBJECTS)) >= 2:
        return ready
    kept = select_non_overlapping(ready, MAX_OBJECTS)
    rest = [obj for obj in objects if obj.name not in {other.name for other in kept}]
    rest.sort(
        key=lambda obj: (
            not is_pickable_object(obj),
            not obj.reachable,
            not is_steady_object(obj),
            _object_size_score(obj),
        )
    )
    return relocate_misplaced_objects([*kept, *rest[: 2 - len(kept)]])


def _object_size_score(obj: SceneObject) -> float:
    return max(obj.size[:2]) + 0.5 * obj.size[2]


def relocate_misplaced_objects(objects: Sequence[SceneObject]) -> list[SceneObject]:
    """The objects with those that overlap another, float or are out of reach put on a free part of the table."""
    kept: list[SceneObject] = []
    for obj in objects:
        free = len(select_non_overlapping([*kept, obj], len(kept) + 1)) == len(kept) + 1
        if free and is_reachable_object(obj) and obj.stands_on_table:
            kept.append(obj.snap_to_table())
    table = Table([obj.footprint_rect for obj in kept])
    for obj in objects:
        if obj.name not in {other.name for other in kept}:
            spot = table.reserve_free_place(obj.size[0] + 0.02, obj.size[1] + 0.02)
            if spot is not None:
                kept.append(obj.relocate_to(*spot))
    order = {obj.name: index for index, obj in enumerate(objects)}
    return sorted(kept, key=lambda obj: order[obj.name])


def candidate_object_sets(
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
        return [select_non_overlapping(group, most) for group in _select_kinds_or_colors(shuffled)]
    count = int(rng.integers(least, most + 1))
    free = select_non_overlapping(shuffled, count)
    return [free[:size] for size in range(len(free), 0, -1)]


def find_plan_for_family(
    family: Family, objects: Sequence[SceneObject], request: TaskRequest, rng: np.random.Generator, least: int = 2
) -> Plan | None:
    """The first selection of ``objects`` that ``family`` can use and that moves at least ``least`` of them."""
    for chosen in candidate_object_sets(family, objects, rng):
        plan = FAMILIES[family](chosen, request) if len(chosen) >= least else None
        if plan is not None:
            return plan
    return None


def _find_stackable_chains(objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    order = sorted(objects, key=lambda obj: -obj.size[0] * obj.size[1])
    chains: list[list[SceneObject]] = []
    for start in range(len(order)):
        chain: list[SceneObject] = []
        for obj in order[start:]:
            fits = not chain or all(b >= a - 0.004 for a, b in zip(obj.size[:2], chain[-1].size[:2], strict=True))
            low = obj.size[2] <= 2.0 * min(obj.size[:2])
            if fits and low and len(select_non_overlapping([*chain, obj], len(chain) + 1)) > len(chain):
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
        clusters.append(select_non_overlapping(near, most))
    return [cluster for cluster in clusters if len(cluster) >= 2]


def _select_kinds_or_colors(objects: Sequence[SceneObject]) -> list[list[SceneObject]]:
    selections: list[list[SceneObject]] = []
    for labels in ([obj.category for obj in objects], [obj.color for obj in objects]):
        names = list(dict.fromkeys(labels))
        for count in (3, 2):
            pairs = zip(objects, labels, strict=True)
            selections.append([obj for obj, label in pairs if label in names[:count]])
    return selections
