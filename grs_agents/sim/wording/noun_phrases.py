"""Noun phrases for the objects of a table: distinct, counted, joined."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

from grs_agents.sim.wording.table_state import TableState

NUMBERS: Final = (
    "no",
    "one",
    "two",
    "three",
    "four",
    "five",
    "six",
    "seven",
    "eight",
    "nine",
    "ten",
    "eleven",
    "twelve",
)
_ORDINALS: Final = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
_TALLER: Final = 0.015
"""Difference in height (m) that tells two equally named objects apart at a glance."""
_APART: Final = 0.04
"""Distance (m) along a side that tells two equally named objects apart by their places."""


def pluralize(noun: str) -> str:
    """``red box`` as ``red boxes``."""
    if noun.endswith(("x", "s", "ch", "sh")):
        return f"{noun}es"
    return f"{noun[:-1]}ies" if noun.endswith("y") and noun[-2:-1] not in "aeiou" else f"{noun}s"


def count_in_words(number: int) -> str:
    """``three``; figures beyond twelve."""
    return NUMBERS[number] if number < len(NUMBERS) else str(number)


def join_with_and(texts: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} {last} {texts[-1]}"


@dataclass(frozen=True)
class NounPhrases:
    """Phrases that name each object of a table unambiguously, with the definite article."""

    table: TableState

    @cached_property
    def namesakes(self) -> dict[str, list[int]]:
        """Ids of the objects that share a name, by name."""
        alike: dict[str, list[int]] = {}
        for number, name in self.table.names.items():
            alike.setdefault(name, []).append(number)
        return alike

    def name(self, number: int) -> str:
        """``the red block``; of several equal objects with a word that selects it, by height or place at the start."""
        name = self.table.names[number]
        alike = self.namesakes[name]
        if len(alike) == 1:
            return f"the {name}"
        words = self._select_by_height(number, alike) or self._select_by_place(number, alike)
        return words.replace("*", name)

    def list_names(self, numbers: Sequence[int], last: str = "and") -> str:
        """Names of several objects in their order."""
        return join_with_and([self.name(number) for number in numbers], last)

    def count_together(self, numbers: Sequence[int]) -> list[str]:
        """Names of several objects in any order; all objects of a name together: ``both red blocks``."""
        phrases: list[str] = []
        waiting = dict.fromkeys(numbers)
        for number in numbers:
            alike = self.namesakes[self.table.names[number]]
            if number not in waiting:
                continue
            if len(alike) > 1 and waiting.keys() >= set(alike):
                plural = pluralize(self.table.names[number])
                phrases.append(f"both {plural}" if len(alike) == 2 else f"all {count_in_words(len(alike))} {plural}")
                for member in alike:
                    del waiting[member]
            else:
                phrases.append(self.name(number))
                del waiting[number]
        return phrases

    def _select_by_height(self, number: int, alike: Sequence[int]) -> str:
        """``the taller *``; empty if the heights do not tell the objects apart."""
        heights = {
            one: self.table.start[one].high - self.table.start[one].low for one in alike if one in self.table.start
        }
        ranked = sorted(heights, key=lambda one: heights[one])
        if len(ranked) < len(alike) or len(ranked) > 3:
            return ""
        if any(heights[b] - heights[a] < _TALLER for a, b in pairwise(ranked)):
            return ""
        words = (
            ("the shorter *", "the taller *")
            if len(ranked) == 2
            else ("the shortest *", "the * of middle height", "the tallest *")
        )
        return words[ranked.index(number)]

    def _select_by_place(self, number: int, alike: Sequence[int]) -> str:
        """``the left *``, ``the second * from the left``: places at the start."""
        places = {one: (self.table.initial.get(one) or self.table.items[one].pose)[0] for one in alike}
        spans = [max(axis) - min(axis) for axis in zip(*(place[:2] for place in places.values()), strict=True)]
        axis = 1 if spans[1] >= min(spans[0], _APART) else 0  # along the robot's left if that is clear enough
        ranked = sorted(alike, key=lambda one: (-places[one][1], places[one][0]) if axis else (places[one][0], one))
        rank, last = ranked.index(number), len(ranked) - 1
        ends = ("left", "right") if axis else ("near", "far")
        if last == 1:
            return f"the {ends[rank]} *"
        if rank in (0, last):
            most = ("leftmost", "rightmost") if axis else ("nearest", "farthest")
            return f"the {most[rank == last]} *"
        if last == 2:
            return "the middle *"
        ordinal = _ORDINALS[rank] if rank < len(_ORDINALS) else f"{rank + 1}th"
        return f"the {ordinal} * from {'the left' if axis else 'the robot'}"
