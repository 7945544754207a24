"""What each kind of request asks of the scene: things are put, stacked, sorted, lined up, cleared, exchanged, left."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from grs_agents.models.offline.judging.arrangements import MEASURES, is_ordered_by_size, require_arrangement
from grs_agents.models.offline.judging.ordering import require_order_in_time
from grs_agents.models.offline.judging.places import (
    Differs,
    Places,
    Unclear,
    explain_misplacement,
    narrow_to_things_meant,
    require_several,
)
from grs_agents.models.offline.judging.reading import (
    CLEARING,
    LEAVING,
    LINING,
    OTHERS,
    PUSHING,
    SORTING,
    STACKING,
    SWAPPING,
    Phrase,
    Request,
)
from grs_agents.models.offline.judging.scene import Scene, Thing

_FAR_ENOUGH = 0.05
"""Metres: less is a nudge."""
_TALL, _LAIN = 1.2, 60
"""Height against width of what stands or lies, and degrees from which on it lies."""
_WHERE = {"sidebyside", "inrow", "together"}
"""Places of things among one another."""
_ANYWHERE = {"move", "shift", "relocate", "transfer", *PUSHING}
"""What is done to things whose new place is left open."""


@dataclass(frozen=True)
class _Mention:
    """A mention of something that must move, and what it may be."""

    phrase: Phrase
    request: Request
    options: tuple[int, ...]
    fault: str  # what is wrong where nothing will do


@dataclass
class _RequestChecker:
    """One reading of the words, checked against the scene."""

    scene: Scene
    mentions: list[_Mention] = field(default_factory=list[_Mention])
    later: list[tuple[list[int] | None, Callable[[list[Thing]], None]]] = field(
        default_factory=list[tuple[list[int] | None, Callable[[list[Thing]], None]]]
    )

    def add_mentions_of_moved_things(self, request: Request, places: Places, least: float = _FAR_ENOUGH) -> list[int]:
        """Mentions of all that a request moves; gives their numbers."""
        added: list[int] = []
        for phrase in request.movers:
            found = self._find_things_to_move(phrase)
            faults = {thing.id: self._explain_unmet_request(thing, request, places, least) for thing in found}
            for numbers in _split_mention(phrase, list(faults), request):
                added.append(len(self.mentions))
                good = tuple(number for number in numbers if not faults[number])
                fault = faults[numbers[0]] or f"{phrase.text} is spoken of more often than there are such things"
                self.mentions.append(_Mention(phrase, request, good, fault))
        return added

    def _find_things_to_move(self, phrase: Phrase) -> list[Thing]:
        found = self.scene.find(phrase, movable=True)
        several = phrase.plural or phrase.article in ("all", "each")
        if several and not phrase.has_no_specific_noun and not self.scene.is_called(phrase):
            raise Unclear(f"which things on the table are {phrase.text} is not told by what they are called")
        if not found:
            fixed = self.scene.find(phrase)
            raise Differs(f"{phrase.text} cannot move" if fixed else f"there is no such thing as {phrase.text}")
        require_several(phrase, found)
        return found if self._was_introduced(phrase) else narrow_to_things_meant(phrase, found)

    def _was_introduced(self, phrase: Phrase) -> bool:
        """Whether the words spoke of such a thing before, as any one: a can, then the can."""
        return any(one.phrase.article == "a" and one.phrase.nouns == phrase.nouns for one in self.mentions)

    def _explain_unmet_request(self, thing: Thing, request: Request, places: Places, least: float) -> str:
        return explain_why_thing_stays(thing, least) or explain_misplacement(thing, request, places, self.scene)

    def assign_things_to_mentions(self) -> dict[int, int]:
        """A thing for each mention, no thing for two; requests in the same words may share one where they must."""
        owner: dict[int, int] = {}  # thing -> mention

        def assign_thing_to_mention(index: int, seen: set[int]) -> bool:
            for number in self.mentions[index].options:
                if number not in seen:
                    seen.add(number)
                    if number not in owner or assign_thing_to_mention(owner[number], seen):
                        owner[number] = index
                        return True
            return False

        for index in sorted(range(len(self.mentions)), key=lambda index: len(self.mentions[index].options)):
            if not assign_thing_to_mention(index, set()) and not self._is_mentioned_by_another_request(index):
                raise Differs(self.mentions[index].fault)
        return {index: number for number, index in owner.items()}

    def _is_mentioned_by_another_request(self, index: int) -> bool:
        """Whether another request speaks of the same thing in the same words."""
        own = self.mentions[index]
        return bool(own.options) and any(
            other.phrase == own.phrase and other.request is not own.request for other in self.mentions
        )


def explain_why_thing_stays(thing: Thing, least: float) -> str:
    """What speaks against a thing's being moved by ``least`` metres as a goal asks, empty where nothing does."""
    if thing.bystander:
        return f"{thing.label} is a bystander, the words move it"
    if not thing.goals:
        return f"{thing.label} has no goal, the words move it"
    return f"{thing.label} moves {100 * thing.moved:.0f} cm only" if thing.moved < least else ""


def _split_mention(phrase: Phrase, numbers: list[int], request: Request) -> Iterator[list[int]]:
    """What each single mention in a phrase may mean: any, of so many as it counts; each by itself; or any one."""
    if phrase.number is not None:
        if len(numbers) < phrase.number:
            raise Differs(f"there are {len(numbers)} of {phrase.text}, the words say {phrase.number}")
        yield from [numbers] * phrase.number
    elif phrase.plural or phrase.pronoun or phrase.article in ("all", "each"):
        yield from ([number] for number in numbers)
    else:
        yield numbers


def require_requests_are_met(requests: Sequence[Request], places: Sequence[Places], scene: Scene) -> None:
    """Raises ``Differs`` unless all that is asked for happens, and nothing else moves."""
    check = _RequestChecker(scene)
    for request, chosen in zip(requests, places, strict=True):
        kind = _classify_request(request)
        _require_orders_are_checked(request, kind)
        _CHECKS[kind](request, chosen, check)
    taken = check.assign_things_to_mentions()
    _require_no_unnamed_moves(scene.moved - set(taken.values()), check)
    things = {index: scene.things[number] for index, number in taken.items()}
    movers = [
        [things[i] for i, one in enumerate(check.mentions) if one.request is request and i in things]
        for request in requests
    ]
    require_order_in_time(requests, movers)
    for mentions, follow in check.later:
        numbers = taken.values() if mentions is None else [taken[index] for index in mentions if index in taken]
        follow([scene.things[number] for number in numbers])


def _require_orders_are_checked(request: Request, kind: str) -> None:
    if unchecked := request.orders - _ORDERS[kind]:
        raise Unclear(f"what {' and '.join(sorted(unchecked))} asks of what is to {request.verb} is not understood")


def _require_no_unnamed_moves(unnamed: set[int], check: _RequestChecker) -> None:
    """Raises where something moves that no mention means."""
    scene = check.scene
    loosely = [mention.phrase for mention in check.mentions if mention.phrase.article == "a"]
    if any(scene.things[number] in scene.find(phrase) for number in unnamed for phrase in loosely):
        raise Unclear("how many things the words mean by an indefinite article is not understood")
    if unnamed:
        names = ", ".join(scene.things[number].label for number in sorted(unnamed))
        raise Differs(f"the words do not name {names}, which moves")


def _classify_request(request: Request) -> str:
    if request.verb in LEAVING:
        return "leave"
    if request.heading:
        return "heading"
    kinds = (("stack", STACKING), ("sort", SORTING), ("line", LINING), ("clear", CLEARING), ("swap", SWAPPING))
    return next((kind for kind, verbs in kinds if request.verb in verbs), "move")


def _check_move_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Things are put somewhere."""
    where = request.relations or request.orders & _WHERE or request.verb in _ANYWHERE
    if not request.movers or not where:
        raise Unclear(f"what to {request.verb}, and whereto, is not said")
    added = check.add_mentions_of_moved_things(request, places)
    if _asks_for_separate_places(request):
        check.later.append((added, _require_separate_places))
    if request.verb in ("lay", "stand"):
        check.later.append((added, lambda things: _require_lain_or_upright(request.verb, things)))
    check.later.append((added, lambda things: require_arrangement(request, places, things, check.scene)))


def _require_lain_or_upright(verb: str, things: Sequence[Thing]) -> None:
    for thing in things:
        tall = thing.measure(2) > _TALL * thing.measure(0)
        if tall and (verb == "lay") != (thing.tipped > _LAIN):
            raise Unclear(
                f"{thing.label} leans by {thing.tipped:.0f} degrees, whether that is to {verb} it is not told"
            )


def _asks_for_separate_places(request: Request) -> bool:
    each = any(phrase.article == "each" for _, phrases in request.relations for phrase in phrases)
    return each or "own" in request.orders


def _require_separate_places(things: Sequence[Thing]) -> None:
    if len({thing.ends for thing in things}) < len(things):
        raise Differs("two things share a place, the words give each its own")


def _check_heading_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """What is said in detail afterwards: all that moves must keep to it."""
    if request.verb in CLEARING:
        check.later.append((None, lambda things: _require_places_are_cleared(request, check.scene)))
        return
    if not all(phrase.has_no_specific_noun for phrase in request.movers):
        raise Unclear("the part before the colon names things of its own")
    if request.verb in STACKING | SWAPPING:
        raise Unclear(f"what it is to {request.verb} things as said after the colon is not understood")

    def follow(things: list[Thing]) -> None:
        for fault in (explain_misplacement(thing, request, places, check.scene) for thing in things):
            if fault:
                raise Differs(fault)
        if _asks_for_separate_places(request):
            _require_separate_places(things)
        require_arrangement(request, places, things, check.scene)
        _require_sorted_into_groups(request, things)
        if "bycolor" in request.orders:
            _require_places_match_colors(things, check)

    check.later.append((None, follow))


def _require_sorted_into_groups(request: Request, things: Sequence[Thing]) -> None:
    """Things of one colour or kind share a place, and others do not."""
    for order, values in (
        ("bycolor", [thing.color for thing in things]),
        ("bykind", [thing.category for thing in things]),
    ):
        pairs = set(zip(values, (thing.ends for thing in things), strict=True))
        if order in request.orders and not len(pairs) == len(set(values)) == len({place for _, place in pairs}):
            raise Differs(f"things are not sorted {order[:2]} {order[2:]}")


def _require_places_match_colors(things: Sequence[Thing], check: _RequestChecker) -> None:
    """Where places have the colours of the things that are sorted, each lies in its own, unless the words say where."""
    spoken = (phrase for one in check.mentions for _, phrases in one.request.relations for phrase in phrases)
    if any(phrase.colors for phrase in spoken):
        return
    colors = {thing.color for thing in things}
    for thing in things:
        for place in (check.scene.things[number] for _, number in check.scene.trace_supports(thing.ends)):
            if place.fixed and place.color in colors - {thing.color}:
                raise Differs(f"{thing.label} ends on {place.label}, the words sort by colour")


def _find_things_to_clear(request: Request, scene: Scene) -> dict[str, list[Thing]]:
    """What stands at the start in or on each of what a request clears, by the words for it."""
    standing: dict[str, list[Thing]] = {}
    for phrase in request.movers:
        areas = {thing.id for thing in scene.find(phrase) if thing.fixed}
        standing[phrase.text] = [thing for thing in scene.things.values() if thing.is_initially_in_any(areas)]
    return standing


def _require_places_are_cleared(request: Request, scene: Scene) -> None:
    """Something stood there at the start, and nothing of it does at the end."""
    for words, things in _find_things_to_clear(request, scene).items():
        if not things:
            raise Differs(f"nothing stands on {words} at the start")
        if left := [thing for thing in things if set(thing.stood) & set(thing.ends)]:
            raise Differs(f"{left[0].label} still is on {words}")


def _check_request_to_clear_place(request: Request, places: Places, check: _RequestChecker) -> None:
    """All that stands in or on something goes."""
    for thing in (thing for things in _find_things_to_clear(request, check.scene).values() for thing in things):
        fault = explain_why_thing_stays(thing, _FAR_ENOUGH) or explain_misplacement(thing, request, places, check.scene)
        check.mentions.append(_Mention(Phrase((thing.called,)), request, () if fault else (thing.id,), fault))
    check.later.append((None, lambda things: _require_places_are_cleared(request, check.scene)))


def _check_sort_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Each colour or kind gets a place."""
    if not request.orders & {"bycolor", "bykind"}:
        raise Unclear("by what to sort is not said")
    added = check.add_mentions_of_moved_things(request, places)
    check.later.append((added, lambda things: _require_sorted_into_groups(request, things)))
    if "bycolor" in request.orders:
        check.later.append((added, lambda things: _require_places_match_colors(things, check)))


def _check_stack_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Things lie on one another; without a place, the lowest may stay where it is."""
    if request.verb not in ("stack", "pile"):
        raise Unclear(f"what it is to {request.verb} something is not known here")
    base = _find_stack_base(request, check.scene)
    without = replace(request, movers=[phrase for phrase in request.movers if phrase is not base])
    added = check.add_mentions_of_moved_things(without, places)
    for index in added:
        check.mentions[index] = replace(check.mentions[index], request=request)
    foot = check.scene.find(base)[:1] if base is not None else []
    check.later.append((added, lambda things: _require_things_are_stacked(request, [*foot, *things], check.scene)))


def _find_stack_base(request: Request, scene: Scene) -> Phrase | None:
    """The first or last thing of a stack without a place, where that one stays."""
    ends = [request.movers[0], request.movers[-1]] if request.movers and not request.relations else []
    for phrase in ends:
        found = scene.find(phrase)
        if len(found) == 1 and not found[0].has_moved and not found[0].bystander:
            return phrase
    return None


def _require_things_are_stacked(request: Request, things: Sequence[Thing], scene: Scene) -> None:
    stack = sorted(things, key=lambda thing: thing.end[2])
    if not request.relations:
        _require_stack_stands_alone(stack, scene)
    _require_each_asked_to_lie_on_next(stack, scene)
    names = f"from the bottom up there are {', '.join(thing.label for thing in stack)}"
    seen = stack[::-1] if "topdown" in request.orders else stack
    measures = request.orders & MEASURES.keys()
    listed = not measures and not request.orders.isdisjoint({"bottomup", "topdown", "inorder"})
    if listed and [thing.called for thing in things] != [thing.called for thing in seen]:
        raise Differs(names)
    if not all(is_ordered_by_size(seen, order) for order in measures):
        raise Differs(f"{names}, another order than by size")


def _require_each_asked_to_lie_on_next(stack: Sequence[Thing], scene: Scene) -> None:
    for below, above in pairwise(stack):
        if not scene.lies(above, "on", [below]):
            raise Differs(f"{above.label} is not asked to end on {below.label}")


def _require_stack_stands_alone(stack: Sequence[Thing], scene: Scene) -> None:
    """It has two things at least, and is no part of another one."""
    if len(stack) < 2:
        raise Unclear("what is stacked on what is not understood")
    under = [scene.things[number] for _, number in stack[0].ends]
    if loose := [thing for thing in under if not thing.fixed and not thing.hollow]:
        raise Differs(f"{stack[0].label} lies on {loose[0].label}, the words stack nothing on that")


def _check_line_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Things end in one line."""
    added = check.add_mentions_of_moved_things(request, places)
    check.later.append((added, lambda things: require_arrangement(request, places, things, check.scene)))


def _check_swap_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Two things end where the other one stood."""
    if request.relations or not request.movers:
        raise Unclear("what changes places is not said plainly")
    check.later.append((check.add_mentions_of_moved_things(request, places), _require_things_swap_places))


def _require_things_swap_places(things: Sequence[Thing]) -> None:
    if len(things) != 2:
        raise Unclear(f"{len(things)} things change places")
    for thing, other in (things, things[::-1]):
        if not any(goal and all(("where", other.id) in references for references in goal) for goal in thing.goals):
            raise Differs(f"{thing.label} is not asked to end where {other.label} stands at the start")


def _check_leave_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """What is left alone does not move, and is where the words say."""
    for phrase in request.movers:
        found = check.scene.find(phrase)
        if not found and not phrase.pronoun:
            raise Differs(f"there is no such thing as {phrase.text}")
        if phrase.pronoun not in OTHERS:
            _require_things_stay(phrase, [thing for thing in found if not thing.fixed])
        for how, named in request.relations:
            if not all(one.is_bare_table for one in named):
                _require_things_are_at(how, [place for one in named for place in check.scene.find(one)], found, check)


def _require_things_are_at(how: str, places: Sequence[Thing], things: Sequence[Thing], check: _RequestChecker) -> None:
    if how not in ("in", "on", "at"):
        raise Unclear(f"whether something is {how} something that stays is not understood")
    carriers = {place.id for place in places}
    for thing in things:
        if not carriers & {number for _, number in check.scene.trace_supports(thing.ends)}:
            raise Differs(f"{thing.label} is not {how} what the words leave it {how}")


def _require_things_stay(phrase: Phrase, loose: Sequence[Thing]) -> None:
    moved = [thing for thing in loose if thing.has_moved]
    if moved and (len(moved) == len(loose) or phrase.plural or phrase.article == "all"):
        raise Differs(f"{phrase.text} moves, the words leave it alone")
    if moved:
        raise Unclear(f"which of {len(loose)} is {phrase.text} that stays is not understood")


_BY_PLACE = {"own", "owncolor", "freeplace"}
_IN_ROW = {"sidebyside", "inrow", "together", "leftright", "rightleft", "sizedfirst", "inorder", *MEASURES}
_ORDERS: dict[str, set[str]] = {
    "heading": {"bycolor", "bykind", *_IN_ROW, *_BY_PLACE},
    "move": {*_IN_ROW, *_BY_PLACE},
    "stack": {"bottomup", "topdown", "inorder", "sizedfirst", "together", "freeplace", *MEASURES},
    "sort": {"bycolor", "bykind", *_BY_PLACE},
    "line": {*_IN_ROW, "freeplace"},
    "clear": {"freeplace"},
    "swap": set(),
    "leave": set(),
}
"""The orders that each kind of request is checked for."""
_CHECKS: dict[str, Callable[[Request, Places, _RequestChecker], None]] = {
    "heading": _check_heading_request,
    "move": _check_move_request,
    "stack": _check_stack_request,
    "sort": _check_sort_request,
    "line": _check_line_request,
    "clear": _check_request_to_clear_place,
    "swap": _check_swap_request,
    "leave": _check_leave_request,
}
