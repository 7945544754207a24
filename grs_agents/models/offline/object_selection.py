"""Which things of a scene a task uses: those in reach that stand free, and as few surprises as possible."""

import math
from collections.abc import Sequence

import numpy as np

from grs_agents.models.offline.plan import Family, Plan, Table, apart, in_reach, pickable, steady
from grs_agents.models.offline.prompt_text import Thing
from grs_agents.models.offline.task_families import FAMILIES, Wish

MOST = 6
"""The most objects one task moves."""
_ENOUGH: dict[Family, tuple[int, int]] = {
    "pack": (3, MOST),
    "stack": (2, 3),
    "sort": (3, MOST),
    "line": (3, 5),
    "clear": (2, 4),
    "match": (2, 4),
    "place": (2, 4),
}
"""How many objects a family takes, at least where there are so many, and at most."""


def pool(things: Sequence[Thing]) -> list[Thing]:
    """The things a task can move, standing where the photo shows them.

    Where fewer than two of them stand free within reach, others are put on a free part of the table, even such as
    cannot be picked with certainty.
    """
    ready = [thing.on_table() for thing in things if pickable(thing) and in_reach(thing) and thing.standing]
    good = [thing for thing in ready if steady(thing)]
    if len(apart(good, MOST)) >= 2:
        return good
    if len(apart(ready, MOST)) >= 2:
        return ready
    kept = apart(ready, MOST)
    rest = [thing for thing in things if thing.name not in {other.name for other in kept}]
    rest.sort(key=lambda thing: (not pickable(thing), not thing.reachable, not steady(thing), _size(thing)))
    return settled([*kept, *rest[: 2 - len(kept)]])


def _size(thing: Thing) -> float:
    return max(thing.size[:2]) + 0.5 * thing.size[2]


def settled(things: Sequence[Thing]) -> list[Thing]:
    """The things with those that overlap another, float or are out of reach put on a free part of the table."""
    kept: list[Thing] = []
    for thing in things:
        if in_reach(thing) and thing.standing and len(apart([*kept, thing], len(kept) + 1)) == len(kept) + 1:
            kept.append(thing.on_table())
    table = Table([thing.rect for thing in kept])
    for thing in things:
        if thing.name not in {other.name for other in kept}:
            spot = table.place(thing.size[0] + 0.02, thing.size[1] + 0.02)
            if spot is not None:
                kept.append(thing.at(*spot))
    order = {thing.name: index for index, thing in enumerate(things)}
    return sorted(kept, key=lambda thing: order[thing.name])


def choose(family: Family, things: Sequence[Thing], rng: np.random.Generator) -> list[list[Thing]]:
    """Selections of things for a family, the most interesting first; each is worth a try."""
    shuffled = [things[int(index)] for index in rng.permutation(len(things))]
    if family in ("pack", "stack"):
        shuffled = [thing for thing in shuffled if not thing.hollow]
    least, most = _ENOUGH[family]
    if family == "stack":
        chains = _chains(shuffled)
        order = [chains[int(index)] for index in rng.permutation(len(chains))]
        return [chain[:count] for chain in order for count in (most, least)]
    if family == "clear":
        return [chosen for chosen in (_cluster(shuffled, seed, most) for seed in shuffled) if len(chosen) >= 2]
    if family == "sort":
        return [apart(group, most) for group in _few_groups(shuffled)]
    count = int(rng.integers(least, most + 1))
    free = apart(shuffled, count)
    return [free[:size] for size in range(len(free), 0, -1)]


def plan_for(
    family: Family, things: Sequence[Thing], wish: Wish, rng: np.random.Generator, least: int = 2
) -> Plan | None:
    """The first selection of ``things`` that ``family`` can use and that moves at least ``least`` of them."""
    for chosen in choose(family, things, rng):
        plan = FAMILIES[family](chosen, wish) if len(chosen) >= least else None
        if plan is not None:
            return plan
    return None


def _chains(things: Sequence[Thing]) -> list[list[Thing]]:
    order = sorted(things, key=lambda thing: -thing.size[0] * thing.size[1])
    chains: list[list[Thing]] = []
    for start in range(len(order)):
        chain: list[Thing] = []
        for thing in order[start:]:
            fits = not chain or all(b >= a - 0.004 for a, b in zip(thing.size[:2], chain[-1].size[:2], strict=True))
            low = thing.size[2] <= 2.0 * min(thing.size[:2])
            if fits and low and len(apart([*chain, thing], len(chain) + 1)) > len(chain):
                chain.append(thing)
        if len(chain) >= 2 and all(thing.flat_topped for thing in chain[:-1]):
            chains.append(chain)
    return chains


def _cluster(things: Sequence[Thing], seed: Thing, most: int) -> list[Thing]:
    near = sorted(things, key=lambda thing: math.dist(thing.position[:2], seed.position[:2]))
    return apart([thing for thing in near if math.dist(thing.position[:2], seed.position[:2]) < 0.28], most)


def _few_groups(things: Sequence[Thing]) -> list[list[Thing]]:
    selections: list[list[Thing]] = []
    for labels in ([thing.category for thing in things], [thing.color for thing in things]):
        names = list(dict.fromkeys(labels))
        for count in (3, 2):
            pairs = zip(things, labels, strict=True)
            selections.append([thing for thing, label in pairs if label in names[:count]])
    return selections
