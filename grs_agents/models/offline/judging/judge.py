"""The role ``judge`` by rules: compares plain imperatives with the places that goals ask for.

Words outside its grammar are not judged. It says that words differ only if it has understood all of them.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal

from grs_agents.base import Frozen
from grs_agents.models.offline.judging.grammar import (
    ANYWHERE,
    NotUnderstood,
    NounPhrase,
    Request,
    find_impossible_verb,
    parse_requests,
)
from grs_agents.models.offline.judging.things import MOVE, Differs, Thing, Things, gap_between, parse_things
from grs_agents.models.offline.prompt_text import Json, PromptText

_AGREES: Final = "all that the words move ends where they say, each goal asks for it, and nothing else moves"
_BESIDE: Final = 0.12
"""Largest gap (m) of two objects beside each other."""
_ASIDE: Final = 0.02
"""Least offset (m) to a side."""
_ALIKE: Final = 0.003
"""Tolerance (m) of heights that count as equal."""
_SIDES: Final = {"leftof": (1, 1), "rightof": (1, -1), "behind": (0, 1), "infront": (0, -1)}
"""Axis and sign of each side, as the robot sees it: x away from it, y to its left."""
_SAYING: Final = re.compile(r"(?:name|goals? (?P<numbers>[\d and]+)): (?P<text>.*)")
_PLACE_FLAGS: Final = {"own", "freeplace"}
_ROW_FLAGS: Final = {"sidebyside", "inrow", "leftright", "rightleft", "shortfirst", "tallfirst", "inorder"}
_FLAGS: Final = {
    "move": _PLACE_FLAGS | _ROW_FLAGS,
    "push": _PLACE_FLAGS,
    "stack": {"bottomup", "topdown", "inorder", "shortfirst", "tallfirst"},
    "line": _ROW_FLAGS,
    "sort": {"bycolor", "bykind", "own"},
}
"""Flags that are checked, by the kind of request."""


class Judgement(Frozen):
    """The verdict of the rules."""

    verdict: Literal["agrees", "differs", "unclear"]
    reason: str


def judge_words(prompt: PromptText) -> str:
    """Reply to the ``judge`` prompt."""
    judgement = judge_evidence(
        prompt.section_body("words"),
        prompt.section_body("further words").splitlines(),
        prompt.section_json_rows("objects"),
        prompt.section_body("goals").splitlines(),
    )
    return f"```json\n{json.dumps(judgement.model_dump(), ensure_ascii=False)}\n```"


def judge_evidence(words: str, other_texts: Sequence[str], rows: Sequence[Json], goals: Sequence[str]) -> Judgement:
    """Compare words with the evidence.

    Args:
        words: the task's description.
        other_texts: lines ``goal 1: ...`` with the program's sentences for its goals; others are not judged.
        rows: the objects, with their motion and the places that goals ask for.
        goals: a sentence for each.
    """
    things = Things(parse_things(rows))
    pushes = any("pushes things" in line for line in goals)
    try:
        if verb := find_impossible_verb(words):
            raise Differs(f"the words ask to {verb}, which this robot cannot do")
        _Check(things, parse_requests(words, things.nouns, things.adjectives), pushes).require_agreement()
        for line in other_texts:  # name: ... or goal 1 and 2: ...
            saying = _SAYING.fullmatch(line.strip())
            if saying and (fault := _find_contradiction(saying["text"], saying["numbers"], things, pushes)):
                raise Differs(f"the program says {saying['text']!r}: {fault}")
    except Differs as problem:
        return Judgement(verdict="differs", reason=str(problem))
    except NotUnderstood as problem:
        return Judgement(verdict="unclear", reason=str(problem))
    return Judgement(verdict="agrees", reason=_AGREES)


def _find_contradiction(text: str, numbers: str | None, things: Things, pushes: bool) -> str:
    """Fault of further words, which may say less than the goals; empty if there is none, or they are not understood.

    Args:
        text: a task's name, or the sentence of a goal.
        numbers: the numbers of these goals; None for a name.
    """
    if verb := find_impossible_verb(text.replace("-", " ")):
        return f"this robot cannot {verb}"
    try:
        requests = parse_requests(text.replace("-", " "), things.nouns, things.adjectives)
        nouns = [noun for request in requests for phrase in request.objects for noun in phrase.nouns]
        if numbers is None and (requests[0].kind not in ("stack", "swap") or any(noun.endswith("s") for noun in nouns)):
            return ""  # names say little: pack-cans
        check = _Check(things, requests, pushes)
        check.check_requests()
    except NotUnderstood:
        return ""
    except Differs as problem:
        return str(problem)
    if numbers is None:
        return ""
    goals = {things.by_id[number].goal for number in check.covered}
    return "" if not goals or goals & set(map(int, re.findall(r"\d+", numbers))) else "its goal is about other things"


@dataclass
class _Check:
    """Requests, checked against the objects on the table."""

    things: Things
    requests: Sequence[Request]
    pushes: bool
    covered: set[int] = field(default_factory=set[int])  # ids of the objects that some request moves
    moved_by: list[list[Thing]] = field(default_factory=list[list[Thing]])  # objects of each request

    def require_agreement(self) -> None:
        """Raises ``Differs`` or ``NotUnderstood`` unless all requests are met and nothing else moves."""
        self.check_requests()
        unnamed = [
            thing.name for thing in self.things.by_id.values() if thing.is_moved and thing.id not in self.covered
        ]
        if unnamed:
            raise Differs(f"the words do not name {', '.join(unnamed)}, which moves or turns")

    def check_requests(self) -> None:
        """Raises ``Differs`` or ``NotUnderstood`` unless all requests are met, in their order."""
        for request in self.requests:
            if request.flags - _FLAGS.get(request.kind, set()) and not request.heading:
                raise NotUnderstood(f"not understood: {', '.join(sorted(request.flags))} of what is to {request.verb}")
            if self.pushes != (request.kind == "push") and request.kind != "leave":
                raise NotUnderstood(f"unclear: how the robot is to {request.verb}")
            kinds: dict[str, Callable[[Request], list[Thing]]] = {
                "stack": self._check_stack,
                "line": self._check_line,
                "swap": self._check_swap,
                "leave": self._check_leave,
                "clear": self._check_clear,
                "sort": self._check_move,
            }
            kind = "line" if "inrow" in request.flags else request.kind
            moved = self._check_heading(request) if request.heading else kinds.get(kind, self._check_move)(request)
            self.moved_by.append(moved)
            self.covered |= {thing.id for thing in moved} if not request.heading and request.kind != "leave" else set()
        self._check_headings()
        self._check_order_in_time()

    def _find_moved(self, request: Request) -> list[Thing]:
        """The objects that a request moves; each must have a goal and be moved."""
        found: list[Thing] = []
        for phrase in request.objects:
            for thing in self._resolve(phrase):
                if thing in found:
                    raise NotUnderstood(f"unclear: {phrase.text} is named twice")
                found.append(thing)
        for thing in found:
            if not thing.goal or not thing.is_moved:
                raise Differs(f"{thing.name} is not moved for a goal, the words move it")
            if thing.moved < MOVE:
                raise Differs(f"{thing.name} is moved by {100 * thing.moved:.0f} cm only")
        if not found:
            raise NotUnderstood(f"not understood: what to {request.verb}")
        return found

    def _resolve(self, phrase: NounPhrase) -> list[Thing]:
        """The loose objects that a phrase means."""
        plural = bool(phrase.nouns) and phrase.nouns[-1].endswith("s") and not phrase.nouns[-1].endswith("ss")
        fitting = [thing for thing in self.things.find(phrase) if not thing.fixed]
        if not fitting and self.things.find(phrase):
            raise Differs(f"{phrase.text} cannot move")
        if phrase.number is None and phrase.article != "all" and not plural:
            if phrase.article == "a" and len(fitting) > 1:
                moved = [thing for thing in fitting if thing.is_moved]
                if len(moved) != 1:
                    raise NotUnderstood(f"unclear: which one is {phrase.text}")
                return moved
            return [self.things.find_one(phrase)]
        if not fitting:
            raise Differs(f"there is no such thing as {phrase.text}")
        # a box of raisins is called "the raisins", never "two raisins"
        countable = all(_is_countable(phrase, thing) for thing in fitting)
        if phrase.is_generic or (plural and len(fitting) == 1 and countable):
            raise NotUnderstood(f"unclear: which things are {phrase.text}")
        if phrase.number is not None and not countable:
            raise NotUnderstood(f"unclear: how many things are {phrase.text}")
        if phrase.number is not None and phrase.number != len(fitting):
            if phrase.number > len(fitting):
                raise Differs(f"there are {len(fitting)} of {phrase.text}, the words say {phrase.number}")
            raise NotUnderstood(f"unclear: which {phrase.number} of {len(fitting)} are {phrase.text}")
        return fitting

    def _check_move(self, request: Request) -> list[Thing]:
        moved = self._find_moved(request)
        if (
            not request.places
            and not (request.verb in ANYWHERE and not request.flags and not request.elided)
            and not request.flags & {"sidebyside", "bycolor", "bykind"}
        ):
            raise NotUnderstood(f"not understood: whereto to {request.verb} things")
        self._require_places(moved, request)
        if any(
            how == "on" and ("on", other.id) in thing.ends
            for how, _ in request.places
            for thing in moved
            for other in moved
        ):
            raise NotUnderstood("unclear: the words stack nothing, yet a thing ends on another one")
        if request.flags & (_ROW_FLAGS - {"sidebyside", "inorder"}):
            raise NotUnderstood(f"not understood: {', '.join(sorted(request.flags))} of what is to {request.verb}")
        if "own" in request.flags:
            _require_distinct_places(moved)
        if "sidebyside" in request.flags:
            _require_neighbors(moved)
        return moved

    def _require_places(self, moved: Sequence[Thing], request: Request) -> None:
        """Every object ends at every place; a place before another one may tell where an object starts instead."""
        for number, (how, phrase) in enumerate(request.places, 1):
            places = self.things.find(phrase) if phrase.article == "a" else []
            if len(places) > 1:
                shared = [place for place in places if all(self.things.is_at(thing, how, place) for thing in moved)]
                if how not in ("in", "on") or not shared:
                    raise NotUnderstood(f"unclear: which one is {phrase.text}")
                continue
            for thing in moved:
                try:
                    self._require_place(thing, how, phrase, request)
                except Differs:
                    if number < len(request.places) and self._may_start_at(thing, how, phrase):
                        raise NotUnderstood(
                            f"unclear: whether {thing.name} starts {how} {phrase.text} or ends there"
                        ) from None
                    raise

    def _may_start_at(self, thing: Thing, how: str, phrase: NounPhrase) -> bool:
        """True unless an object surely starts elsewhere."""
        if how not in ("in", "on"):
            return how != "outof"
        starts = {number for _, number in thing.stood}
        return not starts if phrase.is_table else self._find_place(how, phrase).id in starts

    def _require_place(self, thing: Thing, how: str, phrase: NounPhrase, request: Request) -> None:
        if phrase.is_table:
            if how != "on":
                raise NotUnderstood(f"not understood: {how} the table")
            if thing.ends:
                raise Differs(f"{thing.name} does not end on the bare table")
            if "freeplace" in request.flags:
                stood = [other for other in self.things.by_id.values() if not other.fixed and other.stood == ()]
                if any(gap_between(thing, thing.end, other, other.start) <= 0 for other in stood):
                    raise NotUnderstood(f"unclear: {thing.name} ends where a thing stood, which may count as free")
            return
        plural = (phrase.number or 1) > 1 or phrase.article == "all"
        if plural or (phrase.nouns and phrase.nouns[-1].endswith("s") and phrase.nouns[-1] not in self.things.nouns):
            raise NotUnderstood(f"unclear: which of {phrase.text} is meant")
        place = self._find_place(how, phrase)
        if how in ("in", "on"):
            if not self.things.is_at(thing, how, place):
                raise Differs(f"{thing.name} is not asked to end {how} {place.name}")
        elif how == "outof":
            if (left := {number for _, number in thing.stood}) and place.id not in left:
                raise Differs(f"{thing.name} does not start in {place.name}")
            if not left or place.id in {number for _, number in self.things.trace(thing.ends)}:
                raise Differs(f"{thing.name} does not leave {place.name}")
        elif how == "beside":
            _require_beside(thing, place)
        else:
            self._require_side(thing, how, place)

    def _find_place(self, how: str, phrase: NounPhrase) -> Thing:
        """The object that a place means: of several a hollow one for ``in``, else a fixture."""
        fitting = self.things.find(phrase)
        if how in ("in", "on", "outof") and len(fitting) > 1:
            fixed = [thing for thing in fitting if thing.fixed]
            if len(fixed) == 1:
                return fixed[0]
        return self.things.find_one(phrase)

    def _require_side(self, thing: Thing, how: str, place: Thing) -> None:
        axis, sign = _SIDES[how]

        def offsets(other: Thing) -> tuple[float, float]:
            return sign * (thing.end[axis] - other.end[axis]), abs(thing.end[1 - axis] - other.end[1 - axis])

        along, across = offsets(place)
        if along <= -_ASIDE:
            raise Differs(f"{thing.name} ends on the other side of {place.name}")
        nearer = [
            other
            for other in self.things.by_id.values()
            if other.id not in (thing.id, place.id)
            for near, off in (offsets(other),)
            if _ASIDE < near < along and off <= max(other.size[:2]) / 2
        ]
        in_line = across <= max(place.size[:2]) / 2
        if along <= _ASIDE or not thing.spots or not (in_line or (across <= along and not nearer)):
            raise NotUnderstood(f"unclear: whether {thing.name} ends {how} {place.name}")

    def _check_stack(self, request: Request) -> list[Thing]:
        """Objects end on each other; the lowest may keep its place if no place is given."""
        foot: list[Thing] = []
        objects = list(request.objects)
        if not request.places and objects:
            first = self._resolve(objects[0])
            if len(first) == 1 and not first[0].is_moved:
                foot, objects = first, objects[1:]
        moved = self._find_moved(Request(request.kind, request.verb, objects))
        on = [self._find_place("on", phrase) for how, phrase in request.places if how == "on"]
        if len(on) < len(request.places):
            raise NotUnderstood("unclear: the place of the stack")
        stack = sorted([*foot, *moved], key=lambda thing: thing.end[2])
        if len(stack) < 2 and (not on or on[0].fixed):
            raise NotUnderstood("unclear: what is stacked on what")
        for below, above in pairwise(stack):
            if not self.things.is_at(above, "on", below):
                raise Differs(f"{above.name} is not asked to end on {below.name}")
        for place in on:
            if not self.things.is_at(stack[0], "on", place):
                raise Differs(f"{stack[0].name} is not asked to end on {place.name}")
        seen = stack[::-1] if "topdown" in request.flags else stack
        listed = request.flags & {"inorder", "bottomup", "topdown"} and not request.flags & {"shortfirst", "tallfirst"}
        if listed and [*foot, *moved] != seen:
            raise Differs(f"from the bottom up there are {', '.join(thing.name for thing in stack)}")
        if request.flags & {"shortfirst", "tallfirst"} and not _has_height_order(request, seen):
            raise Differs("the stack has another order than by height")
        return moved

    def _check_line(self, request: Request) -> list[Thing]:
        moved = self._find_moved(request)
        self._require_places(moved, request)
        if len(moved) < 2:
            raise NotUnderstood("unclear: what the line is of")
        if not all(thing.spots or thing.lined for thing in moved):
            raise Differs("no goal asks for the things to end in a line")
        spans = [max(ends) - min(ends) for ends in zip(*(thing.end[:2] for thing in moved), strict=True)]
        axis = 1 if spans[1] > spans[0] else 0
        row = sorted(moved, key=lambda thing: thing.end[axis], reverse=True)
        first, last = row[0].end, row[-1].end
        length = math.dist(first[:2], last[:2])
        for thing in row:
            off = (last[0] - first[0]) * (thing.end[1] - first[1]) - (last[1] - first[1]) * (thing.end[0] - first[0])
            if abs(off) > _ASIDE * length:
                raise Differs("the things do not end in a line")
        ordered = request.flags & {"leftright", "rightleft", "shortfirst", "tallfirst", "inorder"}
        if ordered and not all(thing.spots for thing in moved):
            raise NotUnderstood("unclear: no goal asks for an order of the row, the film may show it by chance")
        sided = request.flags & {"leftright", "rightleft"}
        if sided and axis == 0:
            raise Differs("the row leads away from the robot, not to its sides")
        if "sidebyside" in request.flags:
            _require_neighbors(row)
        elif len(row) == 2 and not row[0].lined and gap_between(row[0], row[0].end, row[1], row[1].end) > _BESIDE:
            raise NotUnderstood("unclear: two things stand in a line wherever they end")
        ways = [row if "leftright" in sided else row[::-1]] if sided else [row, row[::-1]]
        if request.flags & {"shortfirst", "tallfirst"}:
            if not any(_has_height_order(request, way) for way in ways):
                raise Differs(f"the row is {', '.join(thing.name for thing in row)}, another order than by height")
        elif (sided or "inorder" in request.flags) and moved not in ways:
            raise Differs(f"the row is {', '.join(thing.name for thing in row)}, in another order than the words")
        return moved

    def _check_swap(self, request: Request) -> list[Thing]:
        moved = self._find_moved(request)
        if request.places or len(moved) != 2:
            raise NotUnderstood("unclear: what changes places")
        for thing, partner in (moved, moved[::-1]):
            if not all(("where", partner.id) in relations for relations in thing.asked):
                raise Differs(f"{thing.name} is not asked to end where {partner.name} stands at the start")
        return moved

    def _check_leave(self, request: Request) -> list[Thing]:
        if request.flags or request.places:
            raise NotUnderstood(f"not understood: where to {request.verb} things")
        left = [thing for phrase in request.objects for thing in self._resolve(phrase)]
        if moved := [thing for thing in left if thing.is_moved]:
            raise Differs(f"{moved[0].name} moves, the words leave it alone")
        return left

    def _check_clear(self, request: Request) -> list[Thing]:
        """All loose objects in or on an area leave it."""
        if request.flags or request.places or len(request.objects) != 1 or request.objects[0].is_table:
            raise NotUnderstood(f"not understood: what to {request.verb}")
        area = self._find_place("on", request.objects[0])
        stood = [thing for thing in self.things.by_id.values() if area.id in {number for _, number in thing.stood}]
        if not stood:
            raise Differs(f"nothing stands on {area.name} at the start")
        if left := [thing for thing in stood if area.id in {number for _, number in self.things.trace(thing.ends)}]:
            raise Differs(f"{left[0].name} still is on {area.name}")
        return stood if not request.heading else []

    def _check_heading(self, request: Request) -> list[Thing]:
        """Check what precedes a colon; what follows gives the objects."""
        if request.kind == "clear":
            return self._check_clear(request)
        if (
            request.kind not in ("move", "sort")
            or not all(phrase.is_generic for phrase in request.objects)
            or request.flags - {"bycolor", "bykind", "own"}
        ):
            raise NotUnderstood("not understood: what precedes the colon")
        if any(not self.things.find(phrase) for _, phrase in request.places):
            raise NotUnderstood("not understood: the place before the colon")
        return []

    def _check_headings(self) -> None:
        things = [self.things.by_id[number] for number in sorted(self.covered)]
        for request in self.requests:
            if "own" in request.flags:
                _require_distinct_places(things)
            for flag, values in (
                ("bycolor", [thing.color for thing in things]),
                ("bykind", [thing.category for thing in things]),
            ):
                if flag in request.flags:
                    if not all(thing.ends for thing in things):
                        raise NotUnderstood("unclear: how things on the bare table are sorted")
                    pairs = set(zip(values, (thing.ends for thing in things), strict=True))
                    if not len(pairs) == len(set(values)) == len({place for _, place in pairs}):
                        raise Differs(f"things are not sorted {flag[:2]} {flag[2:]}")
                    if flag == "bycolor":
                        self._require_places_match_colors(request, things)

    def _require_places_match_colors(self, request: Request, things: Sequence[Thing]) -> None:
        """If places have the colours of the sorted objects, each object ends in that of its colour, unless the words
        name places."""
        if request.heading and any(phrase.colors for later in self.requests for _, phrase in later.places):
            return
        colors = {thing.color for thing in things}
        for thing in things:
            for place in (self.things.by_id[number] for _, number in self.things.trace(thing.ends)):
                if place.fixed and place.color in colors - {thing.color}:
                    raise Differs(f"{thing.name} ends on {place.name}, the words sort by colour")

    def _check_order_in_time(self) -> None:
        for before, after in self._list_ordered_pairs():
            if before is after:
                continue
            if not before.actions or not after.actions or before.actions[-1] >= after.actions[-1]:
                raise Differs(f"{after.name} is not moved after {before.name}, which the words put first")
            stacked = before.goal == after.goal and ("on", before.id) in after.ends
            if before.goal >= after.goal and not stacked:
                raise Differs(f"no goal asks for {before.name} before {after.name}: goals are met in their order")

    def _list_ordered_pairs(self) -> Iterator[tuple[Thing, Thing]]:
        """Pairs of objects of which the words put the first before the second."""
        numbers = range(len(self.requests))
        for number, request in enumerate(self.requests):
            if request.kind == "move" and "inorder" in request.flags:
                yield from pairwise(self.moved_by[number])
            pairs = [(index, number) for index in range(number) if request.after]
            pairs += [(number, index) for index in numbers if request.first and index != number]
            pairs += [(index, number) for index in numbers if request.last and index != number]
            for earlier, later in pairs:
                yield from ((before, after) for before in self.moved_by[earlier] for after in self.moved_by[later])


def _is_countable(phrase: NounPhrase, thing: Thing) -> bool:
    """True if the phrase names the thing by its kind: cans can be counted, raisins in a box cannot."""
    last = phrase.nouns[-1] if phrase.nouns else ""
    return bool(last) and (
        last in thing.heads or last.removesuffix("s") in thing.heads or last.removesuffix("es") in thing.heads
    )


def _require_distinct_places(things: Sequence[Thing]) -> None:
    if len({thing.ends for thing in things}) < len(things):
        raise Differs("two things share a place, the words give each its own")


def _require_neighbors(row: Sequence[Thing]) -> None:
    """Each object ends beside the next one of its row, and goals fix their places."""
    spans = [max(ends) - min(ends) for ends in zip(*(thing.end[:2] for thing in row), strict=True)]
    ordered = sorted(row, key=lambda thing: thing.end[1 if spans[1] > spans[0] else 0])
    if len(row) < 2:
        raise NotUnderstood("unclear: what is side by side")
    for first, second in pairwise(ordered):
        if gap_between(first, first.end, second, second.end) > _BESIDE:
            raise Differs(f"{first.name} does not end beside {second.name}")
    if not all(thing.spots or thing.lined for thing in row):
        raise NotUnderstood("unclear: no goal asks for things to end side by side, but they do")


def _require_beside(thing: Thing, place: Thing) -> None:
    gap = gap_between(thing, thing.end, place, place.end)
    if gap > 2 * _BESIDE:
        raise Differs(f"{thing.name} ends {100 * gap:.0f} cm from {place.name}")
    asked = any(("beside", place.id) in relations for relations in thing.asked) and thing.within <= _BESIDE
    if not asked and not (thing.spots and gap <= _BESIDE and place.id not in {number for _, number in thing.ends}):
        raise NotUnderstood(f"unclear: whether {thing.name} ends beside {place.name}")


def _has_height_order(request: Request, row: Sequence[Thing]) -> bool:
    sign = -1 if "tallfirst" in request.flags else 1
    return all(sign * (b.height - a.height) >= -_ALIKE for a, b in pairwise(row))
