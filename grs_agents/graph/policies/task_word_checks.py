"""Relations of objects in a task's words ("put the can into the box"), compared with the objects' final positions.

Only plain phrases are understood: objects, a preposition, a place, each named by words of its asset, places of the same
asset by their colours too. Other phrases are not judged.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final, Literal, cast

from grs_agents.agents.types import TaskDefinition
from grs_agents.models.offline.judging.grammar import make_singular
from grs_agents.sim.instance.episode import ActionRecord, ObjectMotion
from grs_agents.sim.world.colors import COLORS

_CLAUSE_ENDS = re.compile(r"[.;!?]|\bthen\b")
_PHRASE_ENDS = re.compile(r"[,:]|\b(?:and|so|where|with|from|while|which|that|next|beside|in this order)\b")
_PREPOSITIONS = re.compile(
    r"\b(?:(?:to|on|at) the (?:(?P<left>left)|(?P<right>right))(?:-hand)?(?: side)? of"
    r"|(?P<front>in front of)|(?P<behind>behind)|(?P<on>on top of|onto|upon|on)|(?P<inside>into|inside|in))\b"
)
_SIDES: Mapping[str, tuple[int, int]] = {"left": (1, 1), "right": (1, -1), "behind": (0, 1), "front": (0, -1)}
"""Axis and direction of the sides, as the robot sees them."""
_OTHER_VIEW = re.compile(r"\b(?:photo|picture|image|camera|viewer|your|you|mirrored)\b")
_ROW = re.compile(
    r"\b(?P<first>shortest|lowest|tallest|highest)(?: one)?,? (?:on|at) the (?P<side>left|right)\b(?! \w+ of\b)"
)
_ROWS = re.compile(r"\b(?:row|line|lined? up|side by side)\b")
_EVENLY = re.compile(r"\b(?:evenly|equally) spaced\b")
_UNEVEN = 0.04
"""Least difference (m) of the distances of centres in an uneven row: even gaps differ less where sizes do."""
_LISTING = re.compile(r"[,:&]|\band\b")
_EXEMPTING = re.compile(r"\b(?:leave|leaving|keep|keeping|without|not|never|untouched|except)\b")
_EXCEPT = re.compile(r"\b(?:except|other than)\b[\w, ]*?(?=\b(?:in|into|inside|on|onto)\b|[.;!?]|$)")
_ALL = re.compile(r"\b(?:all|every|everything|each)\b")
_BOTTOM_UP = re.compile(r"\b(?:in this order )?from (?:the )?bottom to (?:the )?top\b")
_IN_TIME = re.compile(r"\b(?:then|first|finally|last(?:ly)?)\b")
_HEIGHT = r"(?:the )?(?:shortest|lowest|tallest|highest)\b"
_BY_HEIGHT = re.compile(rf"(?:\bside by side,? )?\bfrom {_HEIGHT} to {_HEIGHT}")
_STAYING = re.compile(r"[\s,]*\bwhere (?:it|the [\w ]+?) (?:stands|is|lies)\b")
_ELSEWHERE = re.compile(
    r"\b(?:front|back|left|right|side|edge|corner|end|half|middle|cent(?:er|re)|between|near|behind|above|below|under)\b"
)
"""Words of a place that is at an object, not in or on it."""
_DESCRIBING = re.compile(
    r"\b(?:that|which|is|are|stands?|standing|lies|lying|from|off|behind|beside|near|next to|front)\b"
)
"""Words of a phrase that tells an object's place at the start."""
_APART = re.compile(r"\b(?:apart|away) from (?:all |all of )?(?:the |its )?(?:others?|rest)\b[\w ]*?(?=\bby\b|$)")
"""Words that set an object apart by the place that follows."""
_MEANS = re.compile(r"^.*\bby \w+ing\b(?! (?:it|them|both|all|each|everything)\b(?! of))")
"""An aim, before the action that reaches it: ``clear the left side by moving``."""
_OUTCOME = re.compile(r"\b(?:so|such) that\b([^.;!?]*)")
_ENDING = re.compile(r"\b(?:are|is|ends?(?: up)?|lies?|sits?|stands?|rests?)\b")
"""Verbs of an object's place at the end, in a clause of the outcome."""
_AFTERWARDS = re.compile(r"\b(?:once|when|after) (?:that|this|it) (?:is|has been) done\b")
_LEVEL = re.compile(
    r"\b(?:as|at|in|on|for|forming) (?:the |its )?(?:very )?(?P<level>base|bottom|middle|cent(?:er|re)|top)\b(?! of\b)"
)
_LEVELS: Mapping[str, int] = {"base": 0, "bottom": 0, "middle": 1, "center": 1, "centre": 1, "top": 2}
_TOWER = re.compile(r"\b(?:tower|stack|pile)\b")
_OWN_COLOR = re.compile(r"\b(?:its|their|the same|matching)(?: own)? colou?r\b|\bof that colou?r\b")
_SORTED = re.compile(r"\bline up\b|\bsort\b[\w ]*\bby (?:colou?r|kind|category|type)\s*:|\bon a \w+ of its own\s*:")
"""Announcements of the relations that follow."""
# fmt: off
_PLAIN_WORDS: Final = {
    "a", "all", "an", "and", "are", "at", "belong", "belongs", "big", "both", "each", "every", "everything",
    "finally", "first", "in", "inside", "into", "it", "its", "large", "last", "lastly", "lay", "let", "little",
    "long", "low", "move", "object", "objects", "of", "on", "onto", "other", "pick", "place", "put", "set",
    "short", "small", "stack", "tall", "the", "them", "then", "thing", "things", "to", "top", "up", "upon",
}
# fmt: on
"""Words that ask for nothing beside the relations."""
_ALSO_CALLED: Mapping[str, tuple[str, ...]] = {
    "block": ("cube",),
    "can": ("tin",),
    "container": ("box", "basket", "bin", "tray", "crate"),
    "zone": ("mark", "area", "mat", "square", "pad", "strip", "patch", "region"),
}
_MARGIN = 0.01
"""Tolerance (m) on the half width of a place within which an object belongs to it."""
_SAME_HEIGHT = 0.004
"""Difference (m) up to which two heights count as equal: the accuracy of sizes that were measured in a photo."""
_UNKNOWN_REACH = 0.25
"""Farthest (m) that an object put into or onto something of unknown size can be from its middle."""


@dataclass(frozen=True)
class WordedRelation:
    """A relation that the words ask for."""

    movers: tuple[str, ...]  # asset names, in the order of the words
    kind: Literal["on", "inside", "left", "right", "front", "behind"]
    place: str  # asset name
    bottom_up: bool = False  # whether the movers are stacked in the order of the words
    color: str = ""  # of the place, if the words give it beside the name
    stays: bool = False  # whether the words leave the place where it stands
    by_height: bool = False  # whether the movers stand in a row in the order of their heights

    def select_places(self, motions: Sequence[ObjectMotion]) -> list[ObjectMotion]:
        """The objects that may be the place: those of its colour, if there are any."""
        places = _select_motions_of_asset(self.place, motions)
        return [place for place in places if self.color and place.color == self.color] or places


@dataclass(frozen=True)
class WordedTask:
    """The relations that were understood of a task's words."""

    relations: tuple[WordedRelation, ...]
    half_widths: Mapping[str, float]  # of assets of the photo, metres
    heights: Mapping[str, float]  # of assets of the photo, metres
    unread: tuple[str, ...] = ()  # words that may ask for more, and assets that no relation names
    in_time: bool = False  # whether the relations are to be made one after the other
    row: tuple[str, ...] = ()  # assets that stand in a row, from the lowest to the tallest
    row_begins: Literal["left", "right", ""] = ""  # side of the lowest
    evenly: bool = False  # whether they are evenly spaced

    def find_violations(self, motions: Sequence[ObjectMotion]) -> list[str]:
        """A clause for each relation that the words ask for and that does not hold."""
        unmet = self._find_row_violations(motions)
        for relation in self.relations:
            instances = [_select_motions_of_asset(name, motions) for name in relation.movers]
            movers = [same[0] for same in instances if len(same) == 1]
            places = relation.select_places(motions)
            place_name = f"the {relation.color} {relation.place}" if places[:1] and places[0].color else relation.place
            if relation.stays and len(places) == 1 and places[0].moved:
                unmet.append(f"the words leave {relation.place} where it stands, it was moved")
            for mover in movers if places else ():
                away = min(_measure_distance(mover, place) for place in places)
                belongs = f"{mover.asset} belongs {relation.kind} {place_name}, it ended"
                if not mover.moved:
                    unmet.append(f"the words move {mover.asset}, which stayed where it was")
                elif relation.kind in _SIDES:
                    axis, sign = _SIDES[relation.kind]
                    if all(sign * (mover.end[axis] - place.end[axis]) < -_MARGIN for place in places):
                        unmet.append(f"{belongs} on its other side")
                elif not any(self._is_within(mover, place) for place in places):
                    unmet.append(f"{belongs} {away:.2f} m from its middle")
                elif relation.kind == "on" and all(mover.end[2] < place.end[2] for place in places):
                    unmet.append(f"{belongs} below it")
            for lower, upper in pairwise(movers):
                if relation.bottom_up and upper.end[2] <= lower.end[2]:
                    unmet.append(f"{upper.asset} belongs above {lower.asset}, it ended below it")
            if relation.by_height and len(movers) > 1 and not self._are_in_order_of_height(movers):
                unmet.append(f"{', '.join(mover.asset for mover in movers)} do not stand in the order of their heights")
        if unmet:
            return list(dict.fromkeys(unmet))
        taken: dict[int, int] = {}  # places of the same asset, with the relation whose objects ended there
        for number, relation in enumerate(self.relations):
            places = relation.select_places(motions)
            movers = [motion for motion in motions if motion.asset in relation.movers]
            if len(places) < 2 or len({mover.asset for mover in movers}) != len(movers):
                continue
            for mover in movers:
                place = min(places, key=lambda place: _measure_distance(mover, place)).object
                if taken.setdefault(place, number) != number:
                    unmet.append(f"{mover.asset} ended with objects that the words put elsewhere")
        return unmet

    def _find_row_violations(self, motions: Sequence[ObjectMotion]) -> list[str]:
        instances = [_select_motions_of_asset(name, motions) for name in self.row]
        if len(instances) < 2 or any(len(same) != 1 for same in instances):
            return []
        ends = [same[0].end for same in instances]
        steps = [math.dist(first[:2], second[:2]) for first, second in pairwise(ends)]
        names, sign = ", ".join(self.row), 1 if self.row_begins == "left" else -1
        unmet: list[str] = []
        if self.row_begins and any(sign * (first[1] - second[1]) <= 0 for first, second in pairwise(ends)):
            unmet.append(f"{names} do not stand from the lowest at the {self.row_begins} to the tallest")
        if self.evenly and max(steps) - min(steps) > _UNEVEN:
            unmet.append(f"{names} are {', '.join(f'{100 * step:.0f}' for step in steps)} cm apart, not evenly spaced")
        return unmet

    def settles(self, motions: Sequence[ObjectMotion]) -> bool:
        """Whether all words were understood, and each of their objects and places is one object of the scene."""
        counts = [len(_select_motions_of_asset(name, motions)) for pair in self.relations for name in pair.movers]
        counts += [len(relation.select_places(motions)) for relation in self.relations]
        return bool(counts) and set(counts) == {1} and not self.unread and not self.find_other_colors(motions)

    def find_untimely_actions(self, actions: Sequence[ActionRecord]) -> list[str]:
        """A clause for each object that moves before the objects that the words move earlier."""
        last = {action.asset: number for number, action in enumerate(actions)}
        relations = [relation.movers for relation in self.relations] if self.in_time else []
        return [
            f"the words move {earlier} before {later}, the robot moves it after that"
            for before, after in pairwise(relations)
            for earlier in before
            for later in after
            if last.get(earlier, -1) > last.get(later, len(actions))
        ]

    def find_other_colors(self, motions: Sequence[ObjectMotion]) -> list[str]:
        """A clause for each place that is painted in another colour than the words say."""
        return [
            f"the words name a {relation.color} place, {place.asset} is {place.color}"
            for relation in self.relations
            for place in relation.select_places(motions)
            if relation.color and place.color not in ("", relation.color)
        ]

    def _are_in_order_of_height(self, movers: Sequence[ObjectMotion]) -> bool:
        """Whether objects in a row rise from an end of it to the other."""
        spread = [
            max(mover.end[axis] for mover in movers) - min(mover.end[axis] for mover in movers) for axis in (0, 1)
        ]
        axis = spread.index(max(spread))
        row = [self.heights.get(mover.asset, 0.0) for mover in sorted(movers, key=lambda mover: mover.end[axis])]
        rises = [higher - lower for lower, higher in pairwise(row)]
        return all(rise > -_SAME_HEIGHT for rise in rises) or all(rise < _SAME_HEIGHT for rise in rises)

    def _is_within(self, mover: ObjectMotion, place: ObjectMotion) -> bool:
        """Whether the middle of an object is over a place: its box, or a circle where its extent is unknown."""
        if not all(place.extent):
            return _measure_distance(mover, place) <= self.half_widths.get(place.asset, _UNKNOWN_REACH)
        offsets = (abs(at - middle) for at, middle in zip(mover.end[:2], place.end[:2], strict=True))
        return all(offset <= extent / 2 + _MARGIN for offset, extent in zip(offsets, place.extent, strict=True))


def read_task_words(task: TaskDefinition, scene: str) -> WordedTask:
    """Parse the relations in a task's description; ``scene`` is the scene's JSON, which names objects."""
    objects: list[dict[str, Any]] = json.loads(scene or "{}").get("objects", [])
    words: dict[str, set[str]] = {}  # names, kinds and colours by which people may call an asset
    colors: dict[str, str] = {}  # of assets of the photo
    for asset in task.assets:
        spoken = re.sub(r"([a-z])([A-Z])", r"\1 \2", asset.removesuffix(".urdf"))
        for item in objects:
            if item.get("asset") == asset:
                spoken += f" {item.get('name', '')} {item.get('category', '')} {item.get('color', '')}"
                colors[asset] = str(item.get("color", ""))
        plain = {word for word in re.findall(r"[a-z]+", spoken.lower()) if word not in ("hope", "template", "urdf")}
        plain |= {make_singular(word) for word in plain}
        words[asset] = plain | {name for word in plain for name in _ALSO_CALLED.get(word, ())}
    half_widths = {
        str(item["asset"]): max(float(extent) for extent in item["size"][:2]) / 2 + _MARGIN
        for item in objects
        if "size" in item
    }
    heights = {str(item["asset"]): float(item["size"][2]) for item in objects if "size" in item}
    description = _SORTED.sub(" ", task.description.lower())
    excepted = _EXCEPT.findall(description)
    description = _EXCEPT.sub(" ", description)
    bottom_up, by_height = bool(_BOTTOM_UP.search(description)), bool(_BY_HEIGHT.search(description))
    description = _OUTCOME.sub(lambda outcome: _ENDING.sub(" ", outcome[1]), _AFTERWARDS.sub(" then ", description))
    seen_otherwise = bool(_OTHER_VIEW.search(description))
    tower, levelled = _parse_tower(description, words)
    relations: list[WordedRelation] = [tower] if tower else []
    unread: list[str] = [*excepted]
    for clause in _CLAUSE_ENDS.split(_BY_HEIGHT.sub(" ", _BOTTOM_UP.sub(" ", levelled))):
        parsed = [] if _EXEMPTING.search(clause) else list(_parse_worded_relations(clause, words, colors))
        read = [
            item if isinstance(item, str) else replace(item, bottom_up=bottom_up, by_height=by_height)
            for item in parsed
        ]
        relations += [relation for relation in read if isinstance(relation, WordedRelation)]
        unread += [phrase for phrase in read if isinstance(phrase, str)]
        unread += [] if read or not clause.strip() else [clause.strip()]
    # "all of the groceries": what the task uses of the photo and puts nothing into, if the words name no more
    things = tuple(str(item["asset"]) for item in objects if item["asset"] in task.assets and not item.get("hollow"))
    if len(relations) == 1 and not relations[0].movers:
        movers = tuple(dict.fromkeys(name for name in things if name != relations[0].place))
        relations = [replace(relations[0], movers=movers)]
    left = {name for text in excepted for phrase in _LISTING.split(text) for name in _find_assets_meant(phrase, words)}
    relations = [replace(item, movers=tuple(name for name in item.movers if name not in left)) for item in relations]
    relations = [relation for relation in relations if relation.movers]
    named = {name for relation in relations for name in (*relation.movers, relation.place)}
    known = {*_PLAIN_WORDS, *COLORS}.union(*(words[name] for name in named))
    plain = description
    for said in (_BOTTOM_UP, _BY_HEIGHT, _STAYING, _OWN_COLOR):
        plain = said.sub(" ", plain)
    unread += sorted({word for word in re.findall(r"[a-z]+", plain) if not {word, make_singular(word)} & known})
    in_time, unread = bool(_IN_TIME.search(description)), [*unread, *sorted(set(task.assets) - named)]
    row: tuple[str, ...] = ()
    begins, evenly = _ROW.search(description), bool(_EVENLY.search(description))
    low_first = begins is not None and begins["first"] in ("shortest", "lowest")
    no_row = begins is None or seen_otherwise or not _ROWS.search(description)
    side = "" if begins is None or no_row else "left" if low_first == (begins["side"] == "left") else "right"
    if side and len(named & {*things}) in (0, len(things)):
        row = tuple(sorted(dict.fromkeys(things), key=lambda name: heights.get(name, 0.0)))
    return WordedTask(tuple(relations), half_widths, heights, tuple(unread), in_time, row, side, evenly)


def _parse_worded_relations(
    clause: str, words: Mapping[str, set[str]], colors: Mapping[str, str]
) -> Iterator[WordedRelation | str]:
    """The relations of a clause, and as text the phrases that may say another one.

    A relation without movers speaks of all things.
    """
    begin, last_place = 0, list[str]()
    for preposition in _PREPOSITIONS.finditer(clause):
        if preposition.start() < begin:
            continue
        end = _PHRASE_ENDS.search(clause, preposition.end())
        place_text = clause[preposition.end() : end.start() if end else len(clause)]
        moved_text = _MEANS.sub(" ", _APART.sub(" ", clause[begin : preposition.start()]))
        kind = cast('Literal["on", "inside", "left", "right", "front", "behind"]', preposition.lastgroup)
        place = _find_assets_meant(place_text, words)
        if place_text.strip() == "it" and last_place:
            place = last_place
        if kind in _SIDES:
            yield preposition[0] + place_text  # how far is left open
            if _PREPOSITIONS.search(place_text) or _OTHER_VIEW.search(clause):
                continue
        if len(place) != 1 or _ELSEWHERE.search(place_text) or _DESCRIBING.search(moved_text):
            yield preposition[0] + place_text
            continue
        spoken = set(re.findall(r"[a-z]+", place_text)) - words[place[0]]
        phrases = _LISTING.split(moved_text)
        movers = [name for phrase in phrases for name in _find_assets_meant(phrase, words) if name != place[0]]
        begin, last_place = end.start() if end else len(clause), place
        if not movers:
            yield preposition[0] + place_text
            if not _ALL.search(moved_text):
                continue
        relation = WordedRelation(
            movers=tuple(dict.fromkeys(movers)),
            kind=kind,
            place=place[0],
            color=next((color for color in COLORS if color in spoken), ""),
            stays=bool(_STAYING.match(clause, begin)),
        )
        if not _OWN_COLOR.search(place_text):
            yield relation
        for mover in relation.movers if _OWN_COLOR.search(place_text) else ():
            yield replace(relation, movers=(mover,), color=colors.get(mover, ""))


def _parse_tower(description: str, words: Mapping[str, set[str]]) -> tuple[WordedRelation | None, str]:
    """The tower whose levels the words name one by one, and the words without them; None unless each names an asset."""
    levels: dict[int, str] = {}
    begin, start = 0, len(description)
    for level in _LEVEL.finditer(description) if _TOWER.search(description) else ():
        phrase = re.split(r"[,:;.]|\b(?:and|with|using)\b", description[begin : level.start()].rstrip(" ,"))[-1]
        meant = _find_assets_meant(phrase, words)
        if len(meant) != 1 or _LEVELS[level["level"]] in levels:
            return None, description
        start = min(start, description.index(phrase, begin))
        levels[_LEVELS[level["level"]]], begin = meant[0], level.end()
    if len(set(levels.values())) < 2 or len(set(levels.values())) < len(levels) or 0 not in levels:
        return None, description
    place, *movers = (asset for _, asset in sorted(levels.items()))
    return WordedRelation(tuple(movers), "on", place, bottom_up=True), f"{description[:start]} {description[begin:]}"


def _find_assets_meant(phrase: str, words: Mapping[str, set[str]]) -> list[str]:
    """The assets that a phrase names; none if it fits several equally and is no plural."""
    spoken = re.findall(r"[a-z]+", _OWN_COLOR.sub(" ", phrase))
    vocabulary = set[str]().union(*words.values())
    while spoken and not {spoken[-1], make_singular(spoken[-1])} & vocabulary:
        spoken.pop()
    plain = [make_singular(word) for word in spoken]
    last = {*spoken[-1:], *plain[-1:]}
    scores = {asset: len(known & {*spoken, *plain}) for asset, known in words.items()}
    scores = {asset: score for asset, score in scores.items() if words[asset] & last} or scores
    best = max(scores.values(), default=0)
    meant = [asset for asset, score in scores.items() if score == best > 0]
    return meant if len(meant) == 1 or len(last) == 2 or {"each", "every"} & {*spoken} else []


def _select_motions_of_asset(asset: str, motions: Sequence[ObjectMotion]) -> list[ObjectMotion]:
    return [motion for motion in motions if motion.asset == asset]


def _measure_distance(first: ObjectMotion, second: ObjectMotion) -> float:
    return math.dist(first.end[:2], second.end[:2])
