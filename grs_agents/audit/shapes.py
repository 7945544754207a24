"""Do an instance's objects have the shapes that their names promise?"""

import math
from collections.abc import Sequence

from grs_agents.library import Library, ObjectModel
from grs_agents.sim import InstanceObject, TaskInstance

TOLERANCE = 0.002
"""Filled templates are named to four digits: sizes may differ by this share, places by as many metres."""


def library_name(thing: InstanceObject) -> str:
    """The library's name of an instance's object; a filled template is named ``template#values``."""
    return thing.asset.partition("#")[0]


def forged(instances: Sequence[TaskInstance], library: Library) -> list[str]:
    """The assets whose shapes are not the library's, each named once."""
    found = {thing.asset for one in instances for thing in one.objects if not _honest(thing, library)}
    return sorted(found)


def _honest(thing: InstanceObject, library: Library) -> bool:
    name = library_name(thing)
    if name not in library:
        return False
    if thing.shapes is None:
        return "#" not in thing.asset
    return name in library.templates() and _alike(thing.shapes, library.filled(name, _values(thing.asset)))


def _values(asset: str) -> dict[str, tuple[float, ...]]:
    """The values in a filled template's name, e.g. ``#COLOR=1x0.3x0.3,DIM=0.1x0.2x0.002``."""
    label = asset.partition("#")[2]
    values: dict[str, tuple[float, ...]] = {}
    for part in filter(None, label.split(",")):
        stem, _, numbers = part.partition("=")
        try:
            values[stem] = tuple(float(number) for number in numbers.split("x"))
        except ValueError:
            return {}
    return values


def _alike(one: ObjectModel, other: ObjectModel) -> bool:
    """The same colliders (and, for marks without any, visuals), weight and friction, to ``TOLERANCE``."""
    mine, theirs = one.colliders or one.visuals, other.colliders or other.visuals
    if len(mine) != len(theirs) or [shape.kind for shape in mine] != [shape.kind for shape in theirs]:
        return False
    pairs = [(one.mass, other.mass), (one.friction, other.friction)]
    for a, b in zip(mine, theirs, strict=True):
        pairs += [*zip(a.size, b.size, strict=True), *zip(a.position, b.position, strict=True)]
        pairs += [*zip(a.quaternion, b.quaternion, strict=True)]
    pairs += [pair for a, b in zip(one.bounds, other.bounds, strict=True) for pair in zip(a, b, strict=True)]
    return all(math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=TOLERANCE) for a, b in pairs)
