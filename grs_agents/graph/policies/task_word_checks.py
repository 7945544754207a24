"""What a task's words say of objects ("put the can into the box"), held against where the robot left them.

Only plain phrases are understood: objects, a preposition, a place, each named by words of its asset. What is not
understood is not judged.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

from grs_agents.agents.types import TaskDefinition
from grs_agents.sim.instance.episode import ObjectMotion

_CLAUSE_ENDS = re.compile(r"[.;!?]|\bthen\b")
_PHRASE_ENDS = re.compile(r"[,:]|\b(?:and|so|where|with|from|while|which|that|next|beside|in this order)\b")
_PREPOSITIONS = re.compile(r"\b(?:(?P<on>on top of|onto|upon|on)|(?P<inside>into|inside|in))\b")
_LISTING = re.compile(r"[,:&]|\band\b")
_EXEMPTING = re.compile(r"\b(?:leave|leaving|keep|keeping|without|not|never|untouched|except)\b")
_BOTTOM_UP = re.compile(r"\bfrom (?:the )?bottom to (?:the )?top\b")
_ALSO_CALLED: Mapping[str, tuple[str, ...]] = {
    "block": ("cube",),
    "can": ("tin",),
    "container": ("box", "basket", "bin", "tray", "crate"),
    "zone": ("mark", "area", "mat", "square", "pad", "strip", "patch", "region"),
}
_UNKNOWN_REACH = 0.25
"""Farthest (m) that an object put into or onto something of unknown size can be from its middle."""


@dataclass(frozen=True)
class WordedRelation:
    """One thing that the words ask for."""

    movers: tuple[str, ...]  # asset names, in the order of the words
    kind: Literal["on", "inside"]
    place: str  # asset name
    bottom_up: bool = False  # whether the movers are stacked in the order of the words


@dataclass(frozen=True)
class WordedTask:
    """What could be understood of a task's words."""

    relations: tuple[WordedRelation, ...]
    half_widths: Mapping[str, float]  # of assets of the photo, metres

    def find_violations(self, motions: Sequence[ObjectMotion]) -> list[str]:
        """A clause for each thing that the words ask for and that did not come about."""
        unmet = dict.fromkeys(clause for relation in self.relations for clause in self._find_unmet(relation, motions))
        return list(unmet) or list(self._find_mixed_groups(motions))

    def _find_unmet(self, relation: WordedRelation, motions: Sequence[ObjectMotion]) -> Iterator[str]:
        instances = [_select_motions_of_asset(name, motions) for name in relation.movers]
        movers = [found[0] for found in instances if len(found) == 1]
        places = _select_motions_of_asset(relation.place, motions)
        for mover in movers if places else ():
            yield from self._explain_unmet_placement(mover, relation, places)
        for lower, upper in pairwise(movers):
            if relation.bottom_up and upper.end[2] <= lower.end[2]:
                yield f"{upper.asset} belongs above {lower.asset}, it ended below it"

    def _explain_unmet_placement(
        self, mover: ObjectMotion, relation: WordedRelation, places: Sequence[ObjectMotion]
    ) -> Iterator[str]:
        """How an object misses every one of its ``places``, if it does."""
        away = min(_measure_distance(mover, place) for place in places)
        if not mover.moved:
            yield f"the words move {mover.asset}, which stayed where it was"
        elif away > self.half_widths.get(relation.place, _UNKNOWN_REACH):
            yield f"{mover.asset} belongs {relation.kind} {relation.place}, it ended {away:.2f} m from its middle"
        elif relation.kind == "on" and all(mover.end[2] < place.end[2] for place in places):
            yield f"{mover.asset} belongs on {relation.place}, it ended below it"

    def _find_mixed_groups(self, motions: Sequence[ObjectMotion]) -> Iterator[str]:
        """Where several places are of one asset: those that the words put together are together, others are not."""
        taken: dict[int, int] = {}
        for number, relation in enumerate(self.relations):
            places = _select_motions_of_asset(relation.place, motions)
            movers = [motion for motion in motions if motion.asset in relation.movers]
            if len(places) < 2 or len({mover.asset for mover in movers}) != len(movers):
                continue
            for mover in movers:
                place = min(places, key=lambda place: _measure_distance(mover, place)).object
                if taken.setdefault(place, number) != number:
                    yield f"{mover.asset} ended with objects that the words put elsewhere"


def read_task_words(task: TaskDefinition, scene: str) -> WordedTask:
    """What the description asks for, as far as it is understood; ``scene`` is the scene's JSON, which names objects."""
    objects: list[dict[str, Any]] = json.loads(scene or "{}").get("objects", [])
    words = {asset: _collect_asset_words(asset, objects) for asset in task.assets}
    half_widths = {str(item["asset"]): _half_width_with_margin(item) for item in objects if "size" in item}
    description = task.description.lower()
    bottom_up = bool(_BOTTOM_UP.search(description))
    relations = [
        relation
        for clause in _CLAUSE_ENDS.split(description)
        if not _EXEMPTING.search(clause)
        for relation in _parse_worded_relations(clause, words, bottom_up)
    ]
    return WordedTask(tuple(relations), half_widths)


def _parse_worded_relations(clause: str, words: Mapping[str, set[str]], bottom_up: bool) -> Iterator[WordedRelation]:
    begin = 0
    for preposition in _PREPOSITIONS.finditer(clause):
        end = _PHRASE_ENDS.search(clause, preposition.end())
        place = _find_assets_meant(clause[preposition.end() : end.start() if end else len(clause)], words)
        if len(place) != 1 or preposition.start() < begin:
            continue
        phrases = _LISTING.split(clause[begin : preposition.start()])
        movers = [name for phrase in phrases for name in _find_assets_meant(phrase, words) if name != place[0]]
        begin = end.start() if end else len(clause)
        if movers:
            kind = "on" if preposition["on"] else "inside"
            yield WordedRelation(tuple(dict.fromkeys(movers)), kind, place[0], bottom_up)


def _find_assets_meant(phrase: str, words: Mapping[str, set[str]]) -> list[str]:
    """The assets that a phrase names; none where it fits several alike and is no plural."""
    spoken = re.findall(r"[a-z]+", phrase)
    plain = [_make_singular(word) for word in spoken]
    last = {*spoken[-1:], *plain[-1:]}
    scores = {asset: len(known & {*spoken, *plain}) for asset, known in words.items()}
    scores = {asset: score for asset, score in scores.items() if words[asset] & last} or scores
    best = max(scores.values(), default=0)
    meant = [asset for asset, score in scores.items() if score == best > 0]
    return meant if len(meant) == 1 or len(last) == 2 else []


def _collect_asset_words(asset: str, objects: Sequence[Mapping[str, Any]]) -> set[str]:
    """The words by which people may call an asset: those of its name, its kind and its colour."""
    said = re.sub(r"([a-z])([A-Z])", r"\1 \2", asset.removesuffix(".urdf"))
    seen = [item for item in objects if item.get("asset") == asset]
    for item in seen:
        said += f" {item.get('name', '')} {item.get('category', '')} {item.get('color', '')}"
    words = {word for word in re.findall(r"[a-z]+", said.lower()) if word not in ("hope", "template", "urdf")}
    words |= {_make_singular(word) for word in words}
    return words | {name for word in words for name in _ALSO_CALLED.get(word, ())}


def _make_singular(word: str) -> str:
    if word.endswith(("ches", "shes", "xes", "sses")):
        return word[:-2]
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def _select_motions_of_asset(asset: str, motions: Sequence[ObjectMotion]) -> list[ObjectMotion]:
    return [motion for motion in motions if motion.asset == asset]


def _half_width_with_margin(item: Mapping[str, Any]) -> float:
    return max(float(extent) for extent in item["size"][:2]) / 2 + 0.01


def _measure_distance(one: ObjectMotion, other: ObjectMotion) -> float:
    return math.dist(one.end[:2], other.end[:2])
