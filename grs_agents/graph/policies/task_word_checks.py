"""Relations of objects in a task's words ("put the can into the box"), compared with the objects' final positions.

Only plain phrases are understood: objects, a preposition, a place, each named by words of its asset. Other phrases are
not judged.
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
_MARGIN = 0.01
"""Tolerance (m) on the half width of a place within which an object belongs to it."""
_UNKNOWN_REACH = 0.25
"""Farthest (m) that an object put into or onto something of unknown size can be from its middle."""


@dataclass(frozen=True)
class WordedRelation:
    """A relation that the words ask for."""

    movers: tuple[str, ...]  # asset names, in the order of the words
    kind: Literal["on", "inside"]
    place: str  # asset name
    bottom_up: bool = False  # whether the movers are stacked in the order of the words


@dataclass(frozen=True)
class WordedTask:
    """The relations that were understood of a task's words."""

    relations: tuple[WordedRelation, ...]
    half_widths: Mapping[str, float]  # of assets of the photo, metres

    def find_violations(self, motions: Sequence[ObjectMotion]) -> list[str]:
        """A clause for each relation that the words ask for and that does not hold."""
        unmet: list[str] = []
        for relation in self.relations:
            instances = [_select_motions_of_asset(name, motions) for name in relation.movers]
            movers = [same[0] for same in instances if len(same) == 1]
            places = _select_motions_of_asset(relation.place, motions)
            for mover in movers if places else ():
                away = min(_measure_distance(mover, place) for place in places)
                belongs = f"{mover.asset} belongs {relation.kind} {relation.place}, it ended"
                if not mover.moved:
                    unmet.append(f"the words move {mover.asset}, which stayed where it was")
                elif away > self.half_widths.get(relation.place, _UNKNOWN_REACH):
                    unmet.append(f"{belongs} {away:.2f} m from its middle")
                elif relation.kind == "on" and all(mover.end[2] < place.end[2] for place in places):
                    unmet.append(f"{belongs} below it")
            for lower, upper in pairwise(movers):
                if relation.bottom_up and upper.end[2] <= lower.end[2]:
                    unmet.append(f"{upper.asset} belongs above {lower.asset}, it ended below it")
        if unmet:
            return list(dict.fromkeys(unmet))
        taken: dict[int, int] = {}  # places of the same asset, with the relation whose objects ended there
        for number, relation in enumerate(self.relations):
            places = _select_motions_of_asset(relation.place, motions)
            movers = [motion for motion in motions if motion.asset in relation.movers]
            if len(places) < 2 or len({mover.asset for mover in movers}) != len(movers):
                continue
            for mover in movers:
                place = min(places, key=lambda place: _measure_distance(mover, place)).object
                if taken.setdefault(place, number) != number:
                    unmet.append(f"{mover.asset} ended with objects that the words put elsewhere")
        return unmet


def read_task_words(task: TaskDefinition, scene: str) -> WordedTask:
    """Parse the relations in a task's description; ``scene`` is the scene's JSON, which names objects."""
    objects: list[dict[str, Any]] = json.loads(scene or "{}").get("objects", [])
    words: dict[str, set[str]] = {}  # names, kinds and colours by which people may call an asset
    for asset in task.assets:
        spoken = re.sub(r"([a-z])([A-Z])", r"\1 \2", asset.removesuffix(".urdf"))
        for item in objects:
            if item.get("asset") == asset:
                spoken += f" {item.get('name', '')} {item.get('category', '')} {item.get('color', '')}"
        plain = {word for word in re.findall(r"[a-z]+", spoken.lower()) if word not in ("hope", "template", "urdf")}
        plain |= {_make_singular(word) for word in plain}
        words[asset] = plain | {name for word in plain for name in _ALSO_CALLED.get(word, ())}
    half_widths = {
        str(item["asset"]): max(float(extent) for extent in item["size"][:2]) / 2 + _MARGIN
        for item in objects
        if "size" in item
    }
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
    """The assets that a phrase names; none if it fits several equally and is no plural."""
    spoken = re.findall(r"[a-z]+", phrase)
    plain = [_make_singular(word) for word in spoken]
    last = {*spoken[-1:], *plain[-1:]}
    scores = {asset: len(known & {*spoken, *plain}) for asset, known in words.items()}
    scores = {asset: score for asset, score in scores.items() if words[asset] & last} or scores
    best = max(scores.values(), default=0)
    meant = [asset for asset, score in scores.items() if score == best > 0]
    return meant if len(meant) == 1 or len(last) == 2 else []


def _make_singular(word: str) -> str:
    if word.endswith(("ches", "shes", "xes", "sses")):
        return word[:-2]
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def _select_motions_of_asset(asset: str, motions: Sequence[ObjectMotion]) -> list[ObjectMotion]:
    return [motion for motion in motions if motion.asset == asset]


def _measure_distance(first: ObjectMotion, second: ObjectMotion) -> float:
    return math.dist(first.end[:2], second.end[:2])
