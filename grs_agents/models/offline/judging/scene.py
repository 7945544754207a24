"""Objects on the table, parsed from the judge's prompt: names, goals and motion."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, cast

from grs_agents.models.offline.judging.reading import GENERIC, KNOWN, OTHERS, PREPOSITIONS, Phrase, make_singular
from grs_agents.models.offline.prompt_text import COLORS, Json, split_words

Reference = tuple[str, int]
"""Relation to a second object (``in``, ``on``, ``beside``, or ``where`` for its initial place), and its id."""
MOVED = 0.02
"""Least distance (m) of a moved object, as in the episodes' reports."""
_ALSO_CALLED: Mapping[str, tuple[str, ...]] = {
    "cube": ("block",),
    "block": ("cube",),
    "can": ("tin",),
    "container": ("box", "basket", "bin", "tray", "crate"),
    "zone": ("mark", "area", "mat", "square", "pad", "strip", "patch", "region", "spot", "target"),
    "plate": ("dish",),
    "bowl": ("dish",),
    "mug": ("cup",),
    "tub": ("cup", "pot"),
    "kit": ("board",),
    "mark": ("outline",),
}
_FILLING = KNOWN.union(
    PREPOSITIONS,
    split_words("a an the of and with on in to for from that is at by or as no some about shaped cm x wide high other"),
    split_words("without any be given one each"),
)
"""Words of descriptions that name no object."""
_FLAT = {"zone", "plate", "pallet", "tray", "kit", "stand", "mark", "square", "line"}
"""Objects with both "in" and "on" as their preposition."""
_GOAL = re.compile(r"\d+\. (?P<who>.*?#\d+) ends? (?P<places>.*)")
_HOW = re.compile(r"\b(in|on|beside|where) the\b")
_REACH = re.compile(r"\bat most (\d+) cm from it")
_SPOT = re.compile(r"\bat \((-?\d+), (-?\d+)\)")

Spots = tuple[tuple[float, float] | None, ...]
"""x and y (m) of each allowed place; None for any spot there."""


@dataclass(frozen=True)
class Thing:
    """An object on the table."""

    id: int
    called: str
    category: str
    color: str
    names: frozenset[str]  # everyday names in the singular
    words: frozenset[str]  # the names and the words of its description
    # words, in the singular, that name it only in the plural, as raisins name a box of raisins
    plural_names: frozenset[str]
    colors: frozenset[str]  # visible colours
    size: tuple[float, float, float]
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    stood: tuple[Reference, ...]
    ends: tuple[Reference, ...]
    moved: float
    turned: float  # degrees
    fixed: bool
    bystander: bool
    hollow: bool  # objects can be put in or on it
    actions: tuple[int, ...]  # numbers of the robot's actions that moved it
    goals: tuple[tuple[tuple[Reference, ...], ...], ...]  # allowed places of each of its goals
    asked_by: tuple[int, ...]  # the numbers of these goals
    spots: Spots  # of its last goal, which counts
    lined: bool  # a goal asks for a line with others, and for the distance in it
    reach: float  # metres, the largest distance of a goal that ends beside an object
    tipped: float  # degrees by which it leans at the end against how it stood

    @property
    def has_moved(self) -> bool:
        """True if it has visibly moved."""
        return self.moved >= MOVED

    @property
    def label(self) -> str:
        """Its name with its id."""
        return f"the {self.called} #{self.id}"

    @property
    def is_pinned(self) -> bool:
        """True if its goal asks for exact spots only."""
        return bool(self.spots) and None not in self.spots

    def list_asked_ends(self) -> Iterator["Thing"]:
        """The object at each exact spot that its goal allows."""
        for spot in self.spots:
            if spot is not None:
                yield replace(self, end=(*spot, self.end[2]))

    def is_initially_in_any(self, areas: Set[int]) -> bool:
        """True if it starts in or on any of ``areas``."""
        return any(number in areas for _, number in self.stood)

    def measure(self, kind: int) -> float:
        """A measure by index: least width, greatest width, height, volume (m), or y at the start (m, positive to the
        left)."""
        x, y, z = self.size
        return (min(x, y), max(x, y), z, x * y * z, self.start[1])[kind]


@dataclass(frozen=True)
class Scene:
    """All objects on the table."""

    things: Mapping[int, Thing]
    pushes: bool  # the robot pushes instead of picking

    @property
    def nouns(self) -> set[str]:
        """Words that name an object."""
        return {word for thing in self.things.values() for word in thing.words}

    @property
    def moved(self) -> set[int]:
        """Ids of the objects that move."""
        return {thing.id for thing in self.things.values() if thing.has_moved and not thing.fixed}

    def is_called(self, phrase: Phrase) -> bool:
        """True if the phrase fits the name of an object, not only its description."""
        return any(_matches_phrase(thing, phrase, True) for thing in self.things.values())

    def find(self, phrase: Phrase, movable: bool = False) -> list[Thing]:
        """Objects that a phrase may mean; only loose objects if ``movable``."""
        things = self.things.values()
        # descriptions count if no name fits
        fitting = [thing for thing in things if _matches_phrase(thing, phrase, True)]
        fitting = fitting or [thing for thing in things if _matches_phrase(thing, phrase, False)]
        if movable:
            fitting = [
                thing for thing in fitting if not thing.fixed and not (phrase.pronoun in OTHERS and thing.has_moved)
            ]
        for measure, sign, greatest in phrase.sizes if fitting else ():
            # The extreme size; without a superlative, sizes above or below the mean
            sizes = [thing.measure(measure) for thing in fitting]
            bound = max(sizes) if sign > 0 else min(sizes)
            if not greatest:
                bound = sum(sizes) / len(sizes)
            slack = 0.002 if measure < 3 else 0.05 * abs(bound)
            fitting = [thing for thing, size in zip(fitting, sizes, strict=True) if sign * (size - bound) >= -slack]
        return fitting

    def trace_supports(self, references: Sequence[Reference], at_start: bool = False) -> set[Reference]:
        """The references, and recursively the supports' references, at the end or at the start."""
        traced, waiting = set[Reference](), list(references)
        while waiting:
            reference = waiting.pop()
            if reference not in traced:
                traced.add(reference)
                carrier = self.things[reference[1]]
                waiting += (carrier.stood if at_start else carrier.ends) if reference[0] == "on" else ()
        return traced

    def lies(self, thing: Thing, how: str, places: Sequence[Thing]) -> bool:
        """True if an object ends in or on any of ``places``, as a goal asks."""
        wanted = {
            (word, place.id)
            for place in places
            for word in (("in", "on") if how == "at" or place.category in _FLAT else (how,))
        }
        if not wanted & self.trace_supports(thing.ends):
            return False
        return any(
            bool(goal) and all(wanted & self.trace_supports(references) for references in goal) for goal in thing.goals
        )


def distance_between(
    first: Thing, at: Sequence[float], second: Thing, there: Sequence[float], widest: bool = False
) -> float:
    """Bound of the distance (m) from above between the boxes of two objects at two places.

    The yaw of the boxes is unknown: an upper bound, or a lower bound if ``widest``.
    """
    kind = 1 if widest else 0
    sides = [abs(at[axis] - there[axis]) - (first.measure(kind) + second.measure(kind)) / 2 for axis in (0, 1)]
    return math.hypot(*(max(0.0, side) for side in sides))


def _matches_phrase(thing: Thing, phrase: Phrase, closely: bool) -> bool:
    if phrase.nouns and phrase.nouns[-1] in thing.plural_names.difference(phrase.plurals):
        return False  # a raisin is no box of raisins
    words, seen = (thing.names, {thing.color}) if closely else (thing.words, thing.colors)
    nouns = {noun for noun in phrase.nouns if noun not in GENERIC}
    colors = {*phrase.colors, *(noun for noun in nouns if noun in COLORS and noun not in words)}
    return not phrase.unknown and nouns - colors <= words and colors <= seen


@dataclass(frozen=True)
class _AskedPlace:
    """Places that a goal asks for an object."""

    goal: int  # its number
    places: tuple[tuple[Reference, ...], ...] = ((),)  # alternatives; empty if none is given
    spots: Spots = (None,)  # of each of them
    lined: bool = False
    reach: float = 0.0  # metres, the largest distance from the reference


def parse_scene(rows: Sequence[Json], goals: str) -> Scene:
    """Parse the objects of the prompt's rows, with the places of its goal sentences."""
    wanted: dict[int, list[_AskedPlace]] = {}
    for line in goals.splitlines():
        form = _GOAL.match(line)
        if form is None:
            continue
        goal = int(line.partition(".")[0])
        numbers = [int(number) for number in re.findall(r"#(\d+)", form["who"])]
        if form["places"].startswith("stacked"):
            for index, number in enumerate(numbers):
                below: tuple[Reference, ...] = (("on", numbers[index - 1]),) if index else ()
                wanted.setdefault(number, []).append(_AskedPlace(goal, (below,)))
            continue
        texts = form["places"].split("; or ")
        places: list[tuple[Reference, ...]] = []
        for text in texts:
            parts = re.split(r"#(\d+)", text)
            relations = [
                (words[-1], int(number))
                for before, number in zip(parts[::2], parts[1::2], strict=False)
                if (words := _HOW.findall(before))
            ]
            places.append(tuple(relations))
        spots = tuple(
            None if spot is None else (int(spot[1]) / 100, int(spot[2]) / 100) for spot in map(_SPOT.search, texts)
        )
        reach = max((int(distance) / 100 for distance in _REACH.findall(form["places"])), default=0.0)
        place = _AskedPlace(goal, tuple(places), spots, "on one line, " in form["places"], reach)
        for number in numbers:
            wanted.setdefault(number, []).append(place)
    things = [_parse_table_thing(row, wanted.get(int(row["id"]), [])) for row in rows]
    return Scene({thing.id: thing for thing in things}, "pushes things" in goals)


def _parse_table_thing(row: Json, wanted: Sequence[_AskedPlace]) -> Thing:
    described = split_words(str(row.get("description", "")))
    spoken = split_words(f"{row.get('called', '')} {row.get('category', '')}")
    names = {make_singular(word) for word in spoken}
    names |= {synonym for word in spoken for synonym in _ALSO_CALLED.get(word, ())}
    if max(row["size"]) < 1.1 * min(row["size"]) and "box" in names:
        names.add("cube")
    words = names | {make_singular(word) for word in described} - _FILLING
    color = str(row.get("color", ""))
    start = row.get("start", (0, 0, 0))
    plural_names = {make_singular(word) for word in (*spoken, *described)} - {*spoken, *described}
    return Thing(
        id=int(row["id"]),
        called=str(row["called"]),
        category=str(row.get("category", "")),
        color=color,
        names=frozenset(names),
        words=frozenset(words),
        plural_names=frozenset(plural_names),
        colors=frozenset({color, *(word for word in described if word in COLORS)}),
        size=cast(Any, tuple(row["size"])),
        start=cast(Any, tuple(start)),
        end=cast(Any, tuple(row.get("end", start))),
        stood=tuple(_parse_plain_references(row.get("stood", ()))),
        ends=tuple(_parse_plain_references(row.get("ends", ()))),
        moved=float(row.get("moved", 0)),
        turned=float(row.get("turned", 0)),
        fixed=bool(row.get("fixed")),
        bystander=bool(row.get("bystander")),
        hollow=bool(row.get("hollow")),
        actions=tuple(row.get("actions", ())),
        goals=tuple(place.places for place in wanted),
        asked_by=tuple(place.goal for place in wanted),
        spots=wanted[-1].spots if wanted else (),
        lined=any(place.lined for place in wanted),
        reach=max((place.reach for place in wanted), default=0.0),
        tipped=float(row.get("tipped", 0)),
    )


def _parse_plain_references(texts: Sequence[str]) -> Iterator[Reference]:
    """Parse references such as ``in #5``."""
    for text in texts:
        how, _, number = text.partition(" #")
        yield how, int(number)
