"""Checks of the final place of an object against its place in the words."""

import math
from collections.abc import Callable, Sequence
from itertools import product

from grs_agents.models.offline.judging.reading import OTHERS, Phrase, Request, make_singular
from grs_agents.models.offline.judging.scene import Scene, Thing, distance_between
from grs_agents.models.offline.prompt_text import split_words

_BESIDE, _BESIDE_SMALL = 0.12, 0.05
"""Largest distance (m) of two large objects, and of a small object and any object, beside each other."""
_ASIDE = 0.02
"""Least offset (m) to a side."""

Places = tuple[Thing | None, ...]
"""Objects meant by the phrases after a request's prepositions; None for any of several."""


class Unclear(Exception):
    """The words are not understood."""


class Differs(Exception):
    """The episode does not do as the words ask, or no goal asks for it."""


def list_place_combinations(request: Request, scene: Scene) -> list[Places]:
    """All interpretations of a request's places.

    Raises:
        Differs: there is no such place, or an object is in a place that the words call empty.
        Unclear: words for a single place fit several.
    """
    for_each = bool(request.orders & {"own", "owncolor"})
    interpretations: list[Sequence[Thing | None]] = []  # of each phrase
    for how, phrase in ((how, phrase) for how, phrases in request.relations for phrase in phrases):
        if phrase.is_bare_table:
            interpretations.append([None])
            continue
        meant = scene.find(phrase)
        if not meant and not phrase.pronoun:
            raise Differs(f"there is no such thing as {phrase.text}")
        require_several(phrase, meant)
        if phrase.pronoun in OTHERS and phrase.nouns and not phrase.plural and phrase.article != "all":
            raise Unclear(f"which is the other {phrase.nouns[-1]} is not understood")
        if phrase.vacant:
            for thing in scene.things.values():
                if thing.is_initially_in_any({place.id for place in meant}):
                    raise Differs(f"{thing.label} stands there at the start, the words call {phrase.text} free")
        if meant and phrase.article == "the" and not phrase.plural and not for_each:
            narrowed = prefer_hollow_things(meant) if how in ("in", "outof") else meant
            interpretations.append(narrow_to_things_meant(phrase, narrowed))
        else:
            interpretations.append([None])
    return list(product(*interpretations))


def require_several(phrase: Phrase, fitting: Sequence[Thing]) -> None:
    """Raises ``Differs`` if words in the plural fit a single object that has no such plural name."""
    if len(fitting) == 1 and not fitting[0].plural_names.issuperset(phrase.plurals):
        raise Differs(f"there is but one of {phrase.text}, the words say several")


def prefer_hollow_things(fitting: list[Thing]) -> list[Thing]:
    """Hollow objects, if there are any, else all."""
    return [thing for thing in fitting if thing.hollow] or fitting


def narrow_to_things_meant(phrase: Phrase, fitting: Sequence[Thing]) -> list[Thing]:
    """Objects that a phrase means, out of ``fitting``: of several, the object whose name matches exactly, if unique.

    Raises:
        Unclear: they mean a single object and fit several.
    """
    single = phrase.article in ("the", "") and not phrase.plural and phrase.number in (None, 1) and not phrase.pronoun
    if not single or len(fitting) < 2 or not phrase.nouns:
        return list(fitting)
    spoken = {*phrase.colors, *phrase.nouns}
    called = [thing for thing in fitting if {make_singular(word) for word in split_words(thing.called)} == spoken]
    if len(called) != 1:
        raise Unclear(f"{phrase.text} may be {' or '.join(thing.label for thing in fitting[:4])}")
    return called


def explain_misplacement(thing: Thing, request: Request, places: Places, scene: Scene) -> str:
    """Fault of an object's final place; empty if there is none."""
    chosen = iter(places)
    for how, phrases in request.relations:
        options = [
            scene.find(phrase) if place is None else [place] for phrase, place in zip(phrases, chosen, strict=False)
        ]
        if "owncolor" in request.orders:
            options = [[candidate for candidate in row if candidate.color == thing.color] for row in options]
        if any(phrase.is_bare_table for phrase in phrases):
            there = how in ("on", "at") and not request.has_carrier  # unlike "in the box on the table"
            fault = _explain_not_on_table(thing, request, scene) if there else ""
        else:
            ways = [options]
            if how in _SIDES and any(phrase.means_all for phrase in phrases):
                ways = [[[place]] for row in options for place in row if place is not thing]
            met = all(_is_relation_met(how, thing, way, scene) for way in ways)
            relation = f"{_SPOKEN.get(how, how)} {' and '.join(phrase.text for phrase in phrases)}"
            fault = "" if met else f"{thing.label} is not asked to end {relation}"
        if fault:
            return fault
    return ""


def _explain_not_on_table(thing: Thing, request: Request, scene: Scene) -> str:
    """Fault of the final place of an object that the words put on the table; its initial place is not free."""
    if thing.ends:
        return f"{thing.label} does not end on the bare table"
    if not thing.stood and thing.moved < thing.measure(0):
        return f"{thing.label} ends {100 * thing.moved:.0f} cm from its start, partly where it stood"
    taken = [neighbor for neighbor in scene.things.values() if neighbor is not thing and not neighbor.fixed]
    taken = [neighbor for neighbor in taken if distance_between(thing, thing.end, neighbor, neighbor.start) <= 0]
    if taken and "freeplace" in request.orders:
        return f"{thing.label} ends where {taken[0].label} stands at the start, which is not free"
    return ""


def _is_relation_met(how: str, thing: Thing, options: Sequence[Sequence[Thing]], scene: Scene) -> bool:
    places = [place for row in options for place in row if place is not thing]
    if how in ("in", "on", "at"):
        return scene.lies(thing, how, places)
    if how == "between":
        options = [*options, *options] if len(options) == 1 else options
        pairs = list(product(*options)) if len(options) == 2 else []
        return _holds_wherever_asked(thing, lambda moved: any(_is_between(moved, *pair) for pair in pairs))
    if how == "outof":
        stood = {number for _, number in scene.trace_supports(thing.stood, at_start=True)}
        left = stood - {number for _, number in scene.trace_supports(thing.ends)}
        return any(place.id in left for place in places)
    holds = _is_next_to_place if how in ("beside", "around") else _is_to_the_side
    return any(holds(how, thing, place, scene) for place in places)


def _holds_wherever_asked(thing: Thing, holds: Callable[[Thing], bool]) -> bool:
    """True if a condition holds at each spot that an object's goal allows; False if the goal leaves the spot open."""
    return thing.is_pinned and all(holds(moved) for moved in (thing, *thing.list_asked_ends()))


def _is_between(thing: Thing, first: Thing, second: Thing) -> bool:
    """True if the centre of an object lies in the strip between two objects, as wide as they are."""
    if thing.id in (first.id, second.id) or first is second:
        return False
    (x, y), (x0, y0), (x1, y1) = thing.end[:2], first.end[:2], second.end[:2]
    length = math.hypot(x1 - x0, y1 - y0)
    if length == 0:
        return False
    along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length**2
    aside = abs((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)) / length
    return 0 < along < 1 and aside <= ((1 - along) * first.measure(1) + along * second.measure(1)) / 2


def _is_to_the_side(how: str, thing: Thing, place: Thing, scene: Scene) -> bool:
    """True if an object ends to this side of ``place``, not the next side, without a nearer object in line."""

    def is_seen_to_the_side(moved: Thing) -> bool:
        along, across = _offset_to_side(how, moved, place)
        in_line = across <= place.measure(1) / 2
        if along <= _ASIDE or not (in_line or across <= along):
            return False
        return in_line or not any(
            _ASIDE < nearer < along and off <= neighbor.measure(1) / 2
            for neighbor in scene.things.values()
            if neighbor.id not in (moved.id, place.id)
            for nearer, off in [_offset_to_side(how, moved, neighbor)]
        )

    return _is_outside_of_place(thing, place, scene) and _holds_wherever_asked(thing, is_seen_to_the_side)


def _offset_to_side(how: str, thing: Thing, place: Thing) -> tuple[float, float]:
    """Offset (m) of an object to a side of another object, and its deviation from the line there."""
    axis, sign = _SIDES[how]
    return sign * (thing.end[axis] - place.end[axis]), abs(thing.end[1 - axis] - place.end[1 - axis])


def _is_next_to_place(how: str, thing: Thing, place: Thing, scene: Scene) -> bool:
    bound = reach_beside(thing, place) * (2 if how == "around" else 1)
    if any(("beside", place.id) in references for goal in thing.goals for references in goal):
        return distance_between(thing, thing.end, place, place.end) <= bound and thing.reach <= _BESIDE
    outside = _is_outside_of_place(thing, place, scene)
    return outside and _holds_wherever_asked(
        thing, lambda moved: distance_between(moved, moved.end, place, place.end) <= bound
    )


def reach_beside(first: Thing, second: Thing) -> float:
    """Largest distance (m) of two objects beside each other: the width of the smaller."""
    return min(_BESIDE, max(_BESIDE_SMALL, min(first.measure(1), second.measure(1))))


def _is_outside_of_place(thing: Thing, place: Thing, scene: Scene) -> bool:
    """True if an object ends neither in nor on ``place``, at a place that its goal fixes."""
    if any(how == "beside" for goal in thing.goals for references in goal for how, _ in references):
        return False
    return place.id not in {number for _, number in scene.trace_supports(thing.ends)}


_SPOKEN = {"leftof": "left of", "rightof": "right of", "infront": "in front of", "outof": "out of"}
_SIDES = {"leftof": (1, 1), "rightof": (1, -1), "behind": (0, 1), "infront": (0, -1)}
"""Axis and sign of each side, as the robot sees it: x away from it, y to its left."""
