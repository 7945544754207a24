"""Where a thing ends, against where the words put it."""

import math
from collections.abc import Callable, Sequence
from itertools import product

from grs_agents.models.offline.judging.reading import OTHERS, Phrase, Request, make_singular
from grs_agents.models.offline.judging.scene import Scene, Thing, distance_between
from grs_agents.models.offline.prompt_text import split_words

_BESIDE, _BESIDE_SMALL = 0.12, 0.05
"""Metres between two things that people call beside each other, at most, and where one of them is small."""
_ASIDE = 0.02
"""And how far one lies to a side of the other, at least."""

Places = tuple[Thing | None, ...]
"""What the phrases after a request's prepositions mean; None where they may mean any of several."""


class Unclear(Exception):
    """The words are not understood."""


class Differs(Exception):
    """What the words ask for does not happen, or no goal asks for it."""


def list_place_combinations(request: Request, scene: Scene) -> list[Places]:
    """All that the places of a request may be.

    Raises:
        Differs: there is no such place, or something is in what the words call empty.
        Unclear: words for one place mean several.
    """
    for_each = bool(request.orders & {"own", "owncolor"})
    spoken = [(how, phrase) for how, phrases in request.relations for phrase in phrases]
    return list(product(*(_list_places_for_phrase(how, phrase, for_each, scene) for how, phrase in spoken)))


def _list_places_for_phrase(how: str, phrase: Phrase, for_each: bool, scene: Scene) -> Sequence[Thing | None]:
    """What one phrase may be."""
    if phrase.is_bare_table:
        return [None]
    found = _find_places(phrase, scene)
    if phrase.vacant:
        _require_place_is_free(phrase, found, scene)
    one = phrase.article == "the" and not phrase.plural and not for_each
    if not (found and one):
        return [None]
    return narrow_to_things_meant(phrase, prefer_hollow_things(found) if how in ("in", "outof") else found)


def _find_places(phrase: Phrase, scene: Scene) -> list[Thing]:
    found = scene.find(phrase)
    if not found and not phrase.pronoun:
        raise Differs(f"there is no such thing as {phrase.text}")
    require_several(phrase, found)
    if phrase.pronoun in OTHERS and phrase.nouns and not phrase.plural and phrase.article != "all":
        raise Unclear(f"which is the other {phrase.nouns[-1]} is not understood")
    return found


def require_several(phrase: Phrase, found: Sequence[Thing]) -> None:
    """Raises ``Differs`` where words in the plural fit one thing alone that nobody calls so."""
    if len(found) == 1 and not found[0].plural_names.issuperset(phrase.plurals):
        raise Differs(f"there is but one of {phrase.text}, the words say several")


def prefer_hollow_things(found: list[Thing]) -> list[Thing]:
    """Of what a phrase fits those that things can be put in or on, where there are some."""
    return [thing for thing in found if thing.hollow] or found


def narrow_to_things_meant(phrase: Phrase, found: Sequence[Thing]) -> list[Thing]:
    """What words may mean of what they fit: of several the one that is called just so, if there is one.

    Raises:
        Unclear: they mean one thing and fit several.
    """
    single = phrase.article in ("the", "") and not phrase.plural and phrase.number in (None, 1) and not phrase.pronoun
    if not single or len(found) < 2 or not phrase.nouns:
        return list(found)
    spoken = {*phrase.colors, *phrase.nouns}
    called = [thing for thing in found if {make_singular(word) for word in split_words(thing.called)} == spoken]
    if len(called) != 1:
        raise Unclear(f"{phrase.text} may be {' or '.join(thing.label for thing in found[:4])}")
    return called


def _require_place_is_free(phrase: Phrase, found: Sequence[Thing], scene: Scene) -> None:
    for thing in scene.things.values():
        if thing.is_initially_in_any({place.id for place in found}):
            raise Differs(f"{thing.label} stands there at the start, the words call {phrase.text} free")


def explain_misplacement(thing: Thing, request: Request, places: Places, scene: Scene) -> str:
    """What is wrong with where a thing ends, empty where nothing is."""
    chosen, own_color = iter(places), "owncolor" in request.orders
    for how, phrases in request.relations:
        named = [_list_reference_things(phrase, next(chosen), scene) for phrase in phrases]
        options = [[one for one in row if one.color == thing.color] for row in named] if own_color else named
        if any(phrase.is_bare_table for phrase in phrases):
            there = how in ("on", "at") and not request.has_carrier  # and not: in the box on the table
            fault = _explain_not_on_table(thing, request, scene) if there else ""
        else:
            fault = _explain_unmet_relation(thing, how, phrases, options, scene)
        if fault:
            return fault
    return ""


def _explain_unmet_relation(
    thing: Thing, how: str, phrases: Sequence[Phrase], options: Sequence[Sequence[Thing]], scene: Scene
) -> str:
    """What is wrong with one relation of a request; ``options`` are the things that each of its phrases may mean."""
    ways = [options]
    if how in _SIDES and any(phrase.means_all for phrase in phrases):
        ways = [[[place]] for row in options for place in row if place is not thing]
    met = all(_is_relation_met(how, thing, way, scene) for way in ways)
    return "" if met else f"{thing.label} is not asked to end {_format_relation_as_words(how, phrases)}"


def _explain_not_on_table(thing: Thing, request: Request, scene: Scene) -> str:
    """What is wrong with where a thing ends that the words put on the table; a place under itself is not free."""
    if thing.ends:
        return f"{thing.label} does not end on the bare table"
    if not thing.stood and thing.moved < thing.measure(0):
        return f"{thing.label} ends {100 * thing.moved:.0f} cm from its start, partly where it stood"
    taken = [other for other in scene.things.values() if other is not thing and not other.fixed]
    taken = [other for other in taken if distance_between(thing, thing.end, other, other.start) <= 0]
    if taken and "freeplace" in request.orders:
        return f"{thing.label} ends where {taken[0].label} stands at the start, which is not free"
    return ""


def _list_reference_things(phrase: Phrase, chosen: Thing | None, scene: Scene) -> list[Thing]:
    return [chosen] if chosen is not None else scene.find(phrase)


def _format_relation_as_words(how: str, phrases: Sequence[Phrase]) -> str:
    spoken = {"leftof": "left of", "rightof": "right of", "infront": "in front of", "outof": "out of"}
    return f"{spoken.get(how, how)} {' and '.join(phrase.text for phrase in phrases)}"


def _is_relation_met(how: str, thing: Thing, options: Sequence[Sequence[Thing]], scene: Scene) -> bool:
    places = [place for row in options for place in row if place is not thing]
    if how in ("in", "on", "at"):
        return scene.lies(thing, how, places)
    if how == "between":
        options = [*options, *options] if len(options) == 1 else options
        pairs = list(product(*options)) if len(options) == 2 else []
        return _holds_wherever_asked(thing, lambda moved: any(_is_between(moved, *pair) for pair in pairs))
    return any(_HOLDS.get(how, _is_to_the_side)(how, thing, place, scene) for place in places)


def _holds_wherever_asked(thing: Thing, holds: Callable[[Thing], bool]) -> bool:
    """Whether something holds at each spot that the goal of a thing allows; never where it leaves the spot open."""
    return thing.is_pinned and all(holds(moved) for moved in (thing, *thing.list_asked_ends()))


def _is_between(thing: Thing, one: Thing, other: Thing) -> bool:
    """Whether the middle of a thing lies in the strip that leads from one to the other, as wide as they are."""
    if thing.id in (one.id, other.id) or one is other:
        return False
    (x, y), (x0, y0), (x1, y1) = thing.end[:2], one.end[:2], other.end[:2]
    length = math.hypot(x1 - x0, y1 - y0)
    if length == 0:
        return False
    gone = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length**2
    aside = abs((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)) / length
    return 0 < gone < 1 and aside <= ((1 - gone) * one.measure(1) + gone * other.measure(1)) / 2


def _is_to_the_side(how: str, thing: Thing, place: Thing, scene: Scene) -> bool:
    if not _is_outside_of_place(thing, place, scene):
        return False
    return _holds_wherever_asked(thing, lambda moved: _is_seen_to_the_side(how, moved, place, scene))


def _is_seen_to_the_side(how: str, thing: Thing, place: Thing, scene: Scene) -> bool:
    """Whether a thing ends rather to that side of another one than to the next side, and in line with no nearer one."""
    along, across = _offset_to_side(how, thing, place)
    in_line = across <= place.measure(1) / 2
    if along <= _ASIDE or not (in_line or across <= along):
        return False
    return in_line or not any(
        _ASIDE < nearer < along and off <= other.measure(1) / 2
        for other in scene.things.values()
        if other.id not in (thing.id, place.id)
        for nearer, off in [_offset_to_side(how, thing, other)]
    )


def _offset_to_side(how: str, thing: Thing, place: Thing) -> tuple[float, float]:
    """How far (m) a thing ends to a side of another one, and how far beside the line there."""
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


def reach_beside(one: Thing, other: Thing) -> float:
    """Metres that two things beside each other may be apart: the width of the smaller one."""
    return min(_BESIDE, max(_BESIDE_SMALL, min(one.measure(1), other.measure(1))))


def _is_outside_of_place(thing: Thing, place: Thing, scene: Scene) -> bool:
    """Whether a thing ends neither in nor on another one, and not anywhere that its goal leaves open."""
    if any(how == "beside" for goal in thing.goals for references in goal for how, _ in references):
        return False
    return place.id not in {number for _, number in scene.trace_supports(thing.ends)}


def _is_taken_out_of_place(how: str, thing: Thing, place: Thing, scene: Scene) -> bool:
    del how
    stood = {number for _, number in scene.trace_supports(thing.stood, at_start=True)}
    return place.id in stood - {number for _, number in scene.trace_supports(thing.ends)}


_HOLDS: dict[str, Callable[[str, Thing, Thing, Scene], bool]] = {
    "beside": _is_next_to_place,
    "around": _is_next_to_place,
    "outof": _is_taken_out_of_place,
}
_SIDES = {"leftof": (1, 1), "rightof": (1, -1), "behind": (0, 1), "infront": (0, -1)}
"""Axis and sign of each side, as the robot sees it: x away from it, y to its left."""
