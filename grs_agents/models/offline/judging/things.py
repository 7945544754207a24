"""Objects on the table, as the judge's evidence lists them, and the objects that a noun phrase means."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

from grs_agents.models.offline.judging.grammar import GENERIC, NotUnderstood, NounPhrase, make_singular
from grs_agents.models.offline.prompt_text import COLORS, Json, split_words

MOVE: Final = 0.05
"""Least displacement (m) of a move; less is a nudge."""
_TURNED: Final = 10
"""Least turn (degrees) that people see."""
_SYNONYMS: Final[Mapping[str, tuple[str, ...]]] = {
    "cube": ("block",),
    "block": ("cube",),
    "can": ("tin",),
    "container": ("box", "basket", "bin", "tray"),
    "box": ("container",),
    "zone": ("mark", "area", "mat", "square", "pad", "strip", "spot", "place"),
    "bowl": ("dish",),
    "plate": ("dish",),
    "mug": ("cup",),
}
_FLAT: Final = {"zone", "plate", "pallet", "tray", "kit", "stand", "mark", "square"}
"""Categories with both "in" and "on" as their preposition."""
_SIZES: Final = set(split_words("small little big large tall short high low long wide narrow thin thick flat"))
Relation = tuple[str, int]
"""A relation (``in``, ``on``, ``beside``, ``where``) to an object by id."""


class Differs(Exception):
    """The words are understood, and the episode or its goals are not as they say."""


@dataclass(frozen=True)
class Thing:
    """An object on the table."""

    id: int
    called: str
    heads: frozenset[str]  # nouns of its kind, singular
    label: tuple[str, ...]  # words of its name, as they are written
    adjectives: frozenset[str]  # words of its description
    named_by_photo: bool  # its colour is that of a camera; such labels are numbered: brown_bottle_1
    color: str
    category: str
    size: tuple[float, float, float]
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    stood: tuple[Relation, ...]
    ends: tuple[Relation, ...]
    moved: float  # metres
    turned: float  # degrees
    fixed: bool
    actions: tuple[int, ...]
    goal: int  # number of its last goal; 0 without a goal
    asked: tuple[tuple[Relation, ...], ...]  # places that this goal allows
    spots: tuple[tuple[float, float], ...]  # x and y of those places; empty unless all are exact
    within: float  # largest gap of a goal beside an object, metres
    lined: bool  # its goal asks for a line

    @property
    def name(self) -> str:
        """Its name with its id."""
        return f"the {self.called} #{self.id}"

    @property
    def is_moved(self) -> bool:
        """True if people see that it was moved or turned."""
        return not self.fixed and (self.moved > 0.01 or self.turned > _TURNED)

    @property
    def height(self) -> float:
        """Extent along its own vertical axis, m."""
        return self.size[2]


def parse_things(rows: Sequence[Json]) -> dict[int, Thing]:
    """Each object of the evidence by id."""
    return {int(row["id"]): _parse_thing(row) for row in rows}


def _parse_thing(row: Json) -> Thing:
    called, category = str(row["called"]), str(row.get("category", ""))
    last = called.rpartition(" ")[2]
    heads = {last, category, *_SYNONYMS.get(last, ()), *_SYNONYMS.get(category, ())} - {""}
    if max(row["size"]) < 1.1 * min(row["size"]) and "box" in heads:
        heads |= {"cube", "block"}
    relations: list[list[str]] = row.get("asked", [])
    spots = [tuple(map(float, text.split()[1:])) for place in relations for text in place if text.startswith("at ")]
    gaps = [float(text.split()[1]) for place in relations for text in place if text.startswith("within ")]
    start = row.get("start", (0.0, 0.0, 0.0))
    return Thing(
        id=int(row["id"]),
        called=called,
        heads=frozenset(heads),
        label=tuple(split_words(str(row.get("label", "")))) or tuple(called.split()),
        adjectives=frozenset(split_words(str(row.get("description", "")))),
        named_by_photo=str(row.get("label", ""))[-1:].isdigit(),
        color=str(row.get("color", "")),
        category=category,
        size=cast(Any, tuple(row["size"])),
        start=cast(Any, tuple(start)),
        end=cast(Any, tuple(row.get("end", start))),
        stood=_parse_relations(row.get("stood", ())),
        ends=_parse_relations(row.get("ends", ())),
        moved=float(row.get("moved", 0)),
        turned=float(row.get("turned", 0)),
        fixed=bool(row.get("fixed")),
        actions=tuple(row.get("actions", ())),
        goal=int(row.get("goal", 0)),
        asked=tuple(_parse_relations(place) for place in relations),
        spots=cast(Any, tuple(spots)) if len(spots) == len(relations) else (),
        within=max(gaps, default=0.0),
        lined=any("aligned" in place for place in relations),
    )


def _parse_relations(texts: Sequence[str]) -> tuple[Relation, ...]:
    parts = [text.split(" #") for text in texts if " #" in text]
    return tuple((how, int(number)) for how, number in parts)


@dataclass(frozen=True)
class Things:
    """All objects on the table."""

    by_id: Mapping[int, Thing]

    @property
    def nouns(self) -> set[str]:
        """Nouns that name an object: heads in the singular, labels as they are written, pairs of label words."""
        words: set[str] = set()
        for thing in self.by_id.values():
            words |= {*thing.heads, *thing.label, *thing.called.split()}
            words |= {" ".join(pair) for pair in zip(thing.label, thing.label[1:], strict=False)}
        return words - set(COLORS) | {word for word in words if " " in word} | self._colors_in_names

    @property
    def adjectives(self) -> set[str]:
        """Words of descriptions, without sizes, which compare."""
        return {word for thing in self.by_id.values() for word in thing.adjectives} - _SIZES - self.nouns

    @property
    def _colors_in_names(self) -> set[str]:
        """Colours that begin a label of an everyday thing: the orange of orange juice."""
        return {
            thing.label[0]
            for thing in self.by_id.values()
            if len(thing.label) > 1 and thing.label[0] in COLORS and not {*thing.label[1:]} & thing.heads
        }

    def find(self, phrase: NounPhrase) -> list[Thing]:
        """The objects that a phrase fits; none only if all of its kind are told by another colour.

        Raises:
            NotUnderstood: nothing has such a name, or a colour fits none of several that a camera may see otherwise.
        """
        nouns = [noun for noun in phrase.nouns if make_singular(noun) not in GENERIC]
        if not nouns and not phrase.colors:
            return [thing for thing in self.by_id.values() if not thing.fixed] if phrase.is_generic else []
        named = [
            thing
            for thing in self.by_id.values()
            if _is_named(thing, nouns) and set(phrase.adjectives) <= thing.adjectives
        ]
        if not named:
            raise NotUnderstood(f"unclear: which thing is {phrase.text}")
        fitting = [thing for thing in named if set(phrase.colors) <= _colors(thing)]
        if (
            named
            and not fitting
            and any(thing.named_by_photo or not set(thing.called.split()) & set(COLORS) for thing in named)
        ):
            raise NotUnderstood(f"unclear: which thing is {phrase.text}; colours are those of a camera")
        return fitting

    def find_one(self, phrase: NounPhrase) -> Thing:
        """The only object that a phrase in the singular means.

        Raises:
            Differs: there is none.
            NotUnderstood: there are several.
        """
        fitting = self.find(phrase)
        if not fitting:
            raise Differs(f"there is no such thing as {phrase.text}")
        exact = [
            thing for thing in fitting if {*phrase.colors, *map(make_singular, phrase.nouns)} == {*thing.called.split()}
        ]
        if len(fitting) > 1 and len(exact) == 1:
            return exact[0]
        if len(fitting) > 1:
            raise NotUnderstood(f"unclear: {phrase.text} may be {' or '.join(thing.name for thing in fitting[:4])}")
        return fitting[0]

    def trace(self, relations: Sequence[Relation]) -> set[Relation]:
        """The relations, and those of the supports below."""
        traced, waiting = set[Relation](), list(relations)
        while waiting:
            relation = waiting.pop()
            if relation not in traced:
                traced.add(relation)
                waiting += self.by_id[relation[1]].ends if relation[0] == "on" else ()
        return traced

    def is_at(self, thing: Thing, how: str, place: Thing) -> bool:
        """True if an object ends in or on another one, and its goal allows nothing else."""
        wanted = {(word, place.id) for word in (("in", "on") if place.category in _FLAT else (how,))}
        ends = bool(wanted & self.trace(thing.ends))
        return ends and bool(thing.asked) and all(wanted & self.trace(relations) for relations in thing.asked)


def _is_named(thing: Thing, nouns: Sequence[str]) -> bool:
    """True if nouns name a thing: its kind with any words of its name, or words of its label as they are written."""
    if not nouns:
        return True
    words = {*thing.label, *map(make_singular, thing.label), *thing.called.split(), *thing.heads}
    if any(make_singular(noun) in thing.heads for noun in nouns):
        return all(noun in words or make_singular(noun) in words for noun in nouns)
    return set(nouns) <= set(thing.label)


def _colors(thing: Thing) -> set[str]:
    said = set(thing.called.split()) & set(COLORS)
    return said if said and not said <= set(thing.label) else {thing.color, *said}


def gap_between(first: Thing, at: Sequence[float], second: Thing, there: Sequence[float]) -> float:
    """Upper bound of the gap (m), seen from above, between two objects of unknown turn at two places."""
    sides = [abs(at[axis] - there[axis]) - (min(first.size[:2]) + min(second.size[:2])) / 2 for axis in (0, 1)]
    return math.hypot(*(max(0.0, side) for side in sides))
