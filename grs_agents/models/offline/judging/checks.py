"""Checks of each kind of request (put, stack, sort, line up, clear, exchange and leave objects), and of arrangements:
in a line, by size, side by side, around an object, spread over places."""

import math
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import pairwise, product

from grs_agents.models.offline.judging.places import (
    Differs,
    Places,
    Unclear,
    explain_misplacement,
    narrow_to_things_meant,
    prefer_hollow_things,
    reach_beside,
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
from grs_agents.models.offline.judging.scene import Scene, Thing, distance_between

_FAR_ENOUGH = 0.05
"""Least displacement (m) of a move; less is a nudge."""
_TALL, _LAIN = 1.2, 60
"""Ratio of height to width of an upright object, and tilt (degrees) of a lying object."""
_SPATIAL = {"leftright", "rightleft", "bottomup", "topdown", "sidebyside", "inrow"}
_WHERE = {"sidebyside", "inrow", "together"}
"""Places of objects relative to each other."""
_ANYWHERE = {"move", "shift", "relocate", "transfer", *PUSHING}
"""Verbs that leave the new place open."""
_IN_LINE = 0.02
"""Largest distance (m) from the line of a row."""
_ALIKE = 0.003
"""Tolerance (m) of sizes that count as equal."""
_ALIKE_VOLUME = 0.05
"""Relative tolerance of volumes that count as equal."""
_HALF_ROUND = math.radians(200)
"""Largest angular gap between objects around another object: about half of the circle."""
MEASURES = {"shortfirst": (2, 1), "tallfirst": (2, -1), "smallfirst": (3, 1), "largefirst": (3, -1)}
"""Orders by size: index of the measure, and 1 if it grows or -1 if it shrinks."""


@dataclass(frozen=True)
class _Mention:
    """A mention of an object that must move, and the objects that it may mean."""

    phrase: Phrase
    request: Request
    options: tuple[int, ...]
    fault: str  # reason if no object will do


@dataclass
class _RequestChecker:
    """An interpretation of the words, checked against the scene."""

    scene: Scene
    mentions: list[_Mention] = field(default_factory=list[_Mention])
    later: list[tuple[list[int] | None, Callable[[list[Thing]], None]]] = field(
        default_factory=list[tuple[list[int] | None, Callable[[list[Thing]], None]]]
    )

    def add_mentions_of_moved_things(self, request: Request, places: Places, least: float = _FAR_ENOUGH) -> list[int]:
        """Add the mentions of all objects that a request moves. Returns: their indices."""
        added: list[int] = []
        for phrase in request.movers:
            meant = self.scene.find(phrase, movable=True)
            several = phrase.plural or phrase.article in ("all", "each")
            if several and not phrase.has_no_specific_noun and not self.scene.is_called(phrase):
                raise Unclear(f"which things on the table are {phrase.text} is not told by what they are called")
            if not meant:
                fixed = self.scene.find(phrase)
                raise Differs(f"{phrase.text} cannot move" if fixed else f"there is no such thing as {phrase.text}")
            require_several(phrase, meant)
            meant = (
                meant
                if any(
                    mention.phrase.article == "a" and mention.phrase.nouns == phrase.nouns for mention in self.mentions
                )
                else narrow_to_things_meant(phrase, meant)
            )
            faults = {
                thing.id: (
                    explain_why_thing_stays(thing, least) or explain_misplacement(thing, request, places, self.scene)
                )
                for thing in meant
            }
            numbers = list(faults)
            if phrase.number is not None:  # all objects are candidates of each of as many mentions
                if len(numbers) < phrase.number:
                    raise Differs(f"there are {len(numbers)} of {phrase.text}, the words say {phrase.number}")
                candidates = [numbers] * phrase.number
            elif phrase.plural or phrase.pronoun or phrase.article in ("all", "each"):
                candidates = [[number] for number in numbers]
            else:
                candidates = [numbers]
            for options in candidates:
                added.append(len(self.mentions))
                good = tuple(number for number in options if not faults[number])
                fault = faults[options[0]] or f"{phrase.text} is spoken of more often than there are such things"
                self.mentions.append(_Mention(phrase, request, good, fault))
        return added

    def assign_things_to_mentions(self) -> dict[int, int]:
        """Assign an object to each mention, no object to two (maximum bipartite matching); requests in the same words
        may share an object if they must."""
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
            if assign_thing_to_mention(index, set()):
                continue
            mention = self.mentions[index]
            others = [rival for rival in self.mentions if rival.request is not mention.request]
            if not mention.options or all(rival.phrase != mention.phrase for rival in others):
                raise Differs(mention.fault)
        return {index: number for number, index in owner.items()}


_Check = Callable[[Request, Places, _RequestChecker], None]


def explain_why_thing_stays(thing: Thing, least: float) -> str:
    """Reason why an object is not moved by ``least`` metres for a goal; empty if it is."""
    if thing.bystander:
        return f"{thing.label} is a bystander, the words move it"
    if not thing.goals:
        return f"{thing.label} has no goal, the words move it"
    return f"{thing.label} moves {100 * thing.moved:.0f} cm only" if thing.moved < least else ""


@dataclass(frozen=True)
class _Kind:
    """A kind of request."""

    verbs: Set[str]  # empty for a kind that the verb does not determine
    orders: Set[str]  # the orders that its check covers
    check: _Check


_KINDS: dict[str, _Kind] = {}
_BY_PLACE = {"own", "owncolor", "freeplace"}
_IN_ROW = {"sidebyside", "inrow", "together", "leftright", "rightleft", "sizedfirst", "inorder", *MEASURES}


def _checks_kind(name: str, verbs: Set[str], orders: Set[str]) -> Callable[[_Check], _Check]:
    """Register a function as the check of a kind of request."""

    def register(check: _Check) -> _Check:
        _KINDS[name] = _Kind(verbs, orders, check)
        return check

    return register


def require_requests_are_met(requests: Sequence[Request], places: Sequence[Places], scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless all requests are met, and nothing else moves."""
    check = _RequestChecker(scene)
    for request, chosen in zip(requests, places, strict=True):
        name = next((name for name, kind in _KINDS.items() if request.verb in kind.verbs), "move")
        kind = _KINDS["heading" if request.heading and name != "leave" else name]
        if unchecked := request.orders - kind.orders:
            raise Unclear(f"what {' and '.join(sorted(unchecked))} asks of what is to {request.verb} is not understood")
        kind.check(request, chosen, check)
    taken = check.assign_things_to_mentions()
    unnamed = scene.moved - set(taken.values())
    loosely = [mention.phrase for mention in check.mentions if mention.phrase.article == "a"]
    if any(scene.things[number] in scene.find(phrase) for number in unnamed for phrase in loosely):
        raise Unclear("how many things the words mean by an indefinite article is not understood")
    if unnamed:
        names = ", ".join(scene.things[number].label for number in sorted(unnamed))
        raise Differs(f"the words do not name {names}, which moves")
    things = {index: scene.things[number] for index, number in taken.items()}
    movers = [
        [things[i] for i, counted in enumerate(check.mentions) if counted.request is request and i in things]
        for request in requests
    ]
    _require_order_in_time(requests, movers)
    for mentions, follow in check.later:
        numbers = taken.values() if mentions is None else [taken[index] for index in mentions if index in taken]
        follow([scene.things[number] for number in numbers])


def _require_order_in_time(requests: Sequence[Request], movers: Sequence[Sequence[Thing]]) -> None:
    """Check that the goals and the episode keep the words' order in time.

    Args:
        requests: parsed from the words.
        movers: the objects moved by each request.

    Raises:
        Differs: an object, or its goal, comes too early.
    """
    pairs: list[tuple[int, int]] = []  # numbers of an earlier and a later request
    for number, request in enumerate(requests):
        rest = [index for index in range(len(requests)) if index != number]
        pairs += [(index, number) for index in range(number) if request.after]
        pairs += [(number, index) for index in rest if request.first]
        pairs += [(index, number) for index in rest if request.last]
    for earlier, later in pairs:
        for before, after in product(movers[earlier], movers[later]):
            _require_moved_before(before, after)
    for request, things in zip(requests, movers, strict=True):
        if request.verb in LINING or request.orders & _SPATIAL:
            continue  # an order of places
        row = list(things) if "inorder" in request.orders else []
        measures = request.orders & MEASURES.keys()
        if "sizedfirst" in request.orders and measures and request.verb not in STACKING:
            measure, sign = MEASURES[min(measures)]
            row = sorted(things, key=lambda thing: sign * thing.measure(measure))
        for before, after in pairwise(row):
            _require_moved_before(before, after)


def _require_moved_before(before: Thing, after: Thing) -> None:
    if before is after:
        return
    if not before.actions or not after.actions or before.actions[-1] >= after.actions[-1]:
        raise Differs(f"{after.label} is not moved after {before.label}, which the words put first")
    if before.asked_by[-1] < after.asked_by[-1]:
        return
    stacked = before.asked_by[-1] == after.asked_by[-1] and ("on", before.id) in after.ends
    if not stacked:
        raise Differs(f"no goal asks for {before.label} before {after.label}: goals are met in their order")


def require_arrangement(request: Request, places: Places, things: Sequence[Thing], scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless the objects of a request end in the arrangement that it asks for."""
    if request.verb in LINING or "inrow" in request.orders:
        if len(things) < 2:
            raise Unclear("what the line is of is not understood")
        _require_goals_fix_places(things, "in a line")
        points = [thing.end[:2] for thing in things]
        (ax, ay), (bx, by) = max(((a, b) for a in points for b in points), key=lambda pair: math.dist(*pair))
        length = math.dist((ax, ay), (bx, by))
        if any(abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) > _IN_LINE * length for x, y in points):
            raise Differs("the things do not end in a line")
    gathered = "together" in request.orders or request.verb in ("gather", "collect")
    if "sidebyside" in request.orders or (gathered and not request.has_carrier):
        _require_things_side_by_side(things)
    if "sizedfirst" not in request.orders or "sidebyside" in request.orders:
        _require_order_in_row(request, things)
    chosen = iter(places)
    for how, phrases in request.relations:
        for phrase in phrases:
            place = next(chosen)
            meant = [place] if place is not None else scene.find(phrase)
            meant = prefer_hollow_things(meant) if how == "in" else meant
            if phrase.number is not None and phrase.number > 1 and len(meant) != phrase.number:
                raise Differs(f"there are {len(meant)} of {phrase.text}, the words say {phrase.number}")
            if how == "around":
                if len(things) < 2 or len(meant) != 1:
                    raise Unclear("what stands around what is not understood")
                _require_goals_fix_places(things, f"around {meant[0].label}")
                x, y = meant[0].end[:2]
                angles = sorted(math.atan2(thing.end[1] - y, thing.end[0] - x) for thing in things)
                gaps = [b - a for a, b in pairwise([*angles, angles[0] + 2 * math.pi])]
                if max(gaps) > _HALF_ROUND:
                    raise Differs(f"the things do not end all around {meant[0].label}")
            elif how in ("in", "on", "at") and phrase.plural and 1 < len(meant) <= len(things):
                used = {number for thing in things for _, number in scene.trace_supports(thing.ends)}
                if unused := [place for place in meant if place.id not in used]:
                    spoken = f"the words speak of all of {phrase.text}"
                    raise Differs(f"none of the things ends on {unused[0].label}, {spoken}")
        if how == "on" and request.verb not in STACKING:
            numbers = {thing.id for thing in things}
            for thing in things:
                if any(relation == "on" and number in numbers for relation, number in thing.ends):
                    raise Differs(f"{thing.label} ends on another one, the words stack nothing")


def is_ordered_by_size(row: Sequence[Thing], order: str) -> bool:
    """True if a row has an order by size, out of ``MEASURES``."""
    measure, sign = MEASURES[order]
    sizes = [sign * thing.measure(measure) for thing in row]
    slack = _ALIKE if measure < 3 else _ALIKE_VOLUME * max(map(abs, sizes), default=0.0)
    return all(a <= b + slack for a, b in pairwise(sizes))


def _require_goals_fix_places(things: Sequence[Thing], what: str) -> None:
    """An arrangement counts only if goals ask for it; the episode may show it by chance."""
    free = [thing for thing in things if not thing.is_pinned and not thing.lined]
    if free:
        raise Differs(f"no goal asks for {free[0].label} to end {what}")


def _require_things_side_by_side(things: Sequence[Thing]) -> None:
    """Each object ends next to another object, and all are connected."""
    if len(things) < 2:
        raise Unclear("beside each other are two things at least")
    _require_goals_fix_places([thing for thing in things if not thing.reach], "beside the others")
    joined, waiting = [things[0]], list(things[1:])
    while waiting:
        near = [
            (candidate, neighbor)
            for candidate in waiting
            for neighbor in joined
            if distance_between(candidate, candidate.end, neighbor, neighbor.end, widest=True)
            <= reach_beside(candidate, neighbor)
        ]
        if not near:
            raise Differs(f"{waiting[0].label} does not end beside the others")
        joined.append(near[0][0])
        waiting.remove(near[0][0])


def _require_order_in_row(request: Request, things: Sequence[Thing]) -> None:
    """The row is ordered by size, from either side unless the words name a side, or as the words list the objects."""
    sided, measures = request.orders & {"leftright", "rightleft"}, request.orders & MEASURES.keys()
    listed = request.verb in LINING and "inorder" in request.orders
    if not things or not (sided or measures or listed):
        return
    _require_goals_fix_places(things, "in this order")
    if any(len(thing.spots) > 1 for thing in things) and len({thing.called for thing in things}) > 1:
        raise Differs("the goals leave open which thing ends at which place of the row")
    axis = 1
    if not sided:
        spans = [max(ends) - min(ends) for ends in zip(*(thing.end[:2] for thing in things), strict=True)]
        axis = spans.index(max(spans))
    row = sorted(things, key=lambda thing: thing.end[axis], reverse="leftright" in sided)
    ways = [row] if sided else [row, row[::-1]]
    names = ", ".join(thing.label for thing in ways[0])
    if not all(any(is_ordered_by_size(way, order) for way in ways) for order in measures):
        raise Differs(f"the row is {names}, another order than by size")
    if not measures and list(things) not in ways:
        raise Differs(f"the row is {names}, in another order than the words")


@_checks_kind("move", set(), {*_IN_ROW, *_BY_PLACE})
def check_move_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Objects are put into a place."""
    where = request.relations or request.orders & _WHERE or request.verb in _ANYWHERE
    if not request.movers or not where:
        raise Unclear(f"what to {request.verb}, and whereto, is not said")
    added = check.add_mentions_of_moved_things(request, places)
    if _asks_for_separate_places(request):
        check.later.append((added, _require_separate_places))

    def require_lain_or_upright(things: Sequence[Thing]) -> None:
        for thing in things:
            tall = thing.measure(2) > _TALL * thing.measure(0)
            if tall and (request.verb == "lay") != (thing.tipped > _LAIN):
                leaning = f"{thing.label} leans by {thing.tipped:.0f} degrees"
                raise Unclear(f"{leaning}, whether that is to {request.verb} it is not told")

    if request.verb in ("lay", "stand"):
        check.later.append((added, require_lain_or_upright))
    check.later.append((added, lambda things: require_arrangement(request, places, things, check.scene)))


def _asks_for_separate_places(request: Request) -> bool:
    each = any(phrase.article == "each" for _, phrases in request.relations for phrase in phrases)
    return each or "own" in request.orders


def _require_separate_places(things: Sequence[Thing]) -> None:
    if len({thing.ends for thing in things}) < len(things):
        raise Differs("two things share a place, the words give each its own")


@_checks_kind("heading", set(), {"bycolor", "bykind", *_IN_ROW, *_BY_PLACE})
def check_heading_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Check a request that later requests specify in detail: it applies to everything that moves."""
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
    """Objects of equal colour or kind share a place, and others do not."""
    for order, values in (
        ("bycolor", [thing.color for thing in things]),
        ("bykind", [thing.category for thing in things]),
    ):
        pairs = set(zip(values, (thing.ends for thing in things), strict=True))
        if order in request.orders and not len(pairs) == len(set(values)) == len({place for _, place in pairs}):
            raise Differs(f"things are not sorted {order[:2]} {order[2:]}")


def _require_places_match_colors(things: Sequence[Thing], check: _RequestChecker) -> None:
    """If places have the colours of the sorted objects, each object ends in the place of its colour, unless the words
    name places."""
    spoken = (phrase for mention in check.mentions for _, phrases in mention.request.relations for phrase in phrases)
    if any(phrase.colors for phrase in spoken):
        return
    colors = {thing.color for thing in things}
    for thing in things:
        for place in (check.scene.things[number] for _, number in check.scene.trace_supports(thing.ends)):
            if place.fixed and place.color in colors - {thing.color}:
                raise Differs(f"{thing.label} ends on {place.label}, the words sort by colour")


def _find_things_to_clear(request: Request, scene: Scene) -> dict[str, list[Thing]]:
    """Objects that start in or on each area that a request clears, by the words for the area."""
    standing: dict[str, list[Thing]] = {}
    for phrase in request.movers:
        areas = {thing.id for thing in scene.find(phrase) if thing.fixed}
        standing[phrase.text] = [thing for thing in scene.things.values() if thing.is_initially_in_any(areas)]
    return standing


def _require_places_are_cleared(request: Request, scene: Scene) -> None:
    """The cleared areas had objects at the start, and have none of them at the end."""
    for words, things in _find_things_to_clear(request, scene).items():
        if not things:
            raise Differs(f"nothing stands on {words} at the start")
        if left := [thing for thing in things if set(thing.stood) & set(thing.ends)]:
            raise Differs(f"{left[0].label} still is on {words}")


@_checks_kind("clear", CLEARING, {"freeplace"})
def check_clear_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """All objects in or on an area move away."""
    for thing in (thing for things in _find_things_to_clear(request, check.scene).values() for thing in things):
        fault = explain_why_thing_stays(thing, _FAR_ENOUGH) or explain_misplacement(thing, request, places, check.scene)
        check.mentions.append(_Mention(Phrase((thing.called,)), request, () if fault else (thing.id,), fault))
    check.later.append((None, lambda things: _require_places_are_cleared(request, check.scene)))


@_checks_kind("sort", SORTING, {"bycolor", "bykind", *_BY_PLACE})
def check_sort_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Each colour or kind gets a place."""
    if not request.orders & {"bycolor", "bykind"}:
        raise Unclear("by what to sort is not said")
    added = check.add_mentions_of_moved_things(request, places)
    check.later.append((added, lambda things: _require_sorted_into_groups(request, things)))
    if "bycolor" in request.orders:
        check.later.append((added, lambda things: _require_places_match_colors(things, check)))


@_checks_kind("stack", STACKING, {"bottomup", "topdown", "inorder", "sizedfirst", "together", "freeplace", *MEASURES})
def check_stack_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Objects end on each other; without a place, the lowest may keep its place."""
    if request.verb not in ("stack", "pile"):
        raise Unclear(f"what it is to {request.verb} something is not known here")
    base: Phrase | None = None  # the first or last object of a stack without a place, if it keeps its place
    for phrase in [request.movers[0], request.movers[-1]] if request.movers and not request.relations else []:
        meant = check.scene.find(phrase)
        if base is None and len(meant) == 1 and not meant[0].has_moved and not meant[0].bystander:
            base = phrase
    without = replace(request, movers=[phrase for phrase in request.movers if phrase is not base])
    added = check.add_mentions_of_moved_things(without, places)
    for index in added:
        check.mentions[index] = replace(check.mentions[index], request=request)
    foot = check.scene.find(base)[:1] if base is not None else []

    def require_stack(moved: Sequence[Thing]) -> None:
        things = [*foot, *moved]
        stack = sorted(things, key=lambda thing: thing.end[2])
        if not request.relations:
            if len(stack) < 2:
                raise Unclear("what is stacked on what is not understood")
            under = [check.scene.things[number] for _, number in stack[0].ends]
            if loose := [thing for thing in under if not thing.fixed and not thing.hollow]:
                raise Differs(f"{stack[0].label} lies on {loose[0].label}, the words stack nothing on that")
        for below, above in pairwise(stack):
            if not check.scene.lies(above, "on", [below]):
                raise Differs(f"{above.label} is not asked to end on {below.label}")
        names = f"from the bottom up there are {', '.join(thing.label for thing in stack)}"
        seen = stack[::-1] if "topdown" in request.orders else stack
        measures = request.orders & MEASURES.keys()
        listed = not measures and not request.orders.isdisjoint({"bottomup", "topdown", "inorder"})
        if listed and [thing.called for thing in things] != [thing.called for thing in seen]:
            raise Differs(names)
        if not all(is_ordered_by_size(seen, order) for order in measures):
            raise Differs(f"{names}, another order than by size")

    check.later.append((added, require_stack))


@_checks_kind("line", LINING, {*_IN_ROW, "freeplace"})
def check_line_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Objects end in a line."""
    added = check.add_mentions_of_moved_things(request, places)
    check.later.append((added, lambda things: require_arrangement(request, places, things, check.scene)))


@_checks_kind("swap", SWAPPING, set())
def check_swap_request(request: Request, places: Places, check: _RequestChecker) -> None:
    """Two objects exchange their places."""
    if request.relations or not request.movers:
        raise Unclear("what changes places is not said plainly")

    def require_swapped_places(things: Sequence[Thing]) -> None:
        if len(things) != 2:
            raise Unclear(f"{len(things)} things change places")
        for thing, partner in (things, things[::-1]):
            swapped = ("where", partner.id)
            if not any(goal and all(swapped in references for references in goal) for goal in thing.goals):
                raise Differs(f"{thing.label} is not asked to end where {partner.label} stands at the start")

    check.later.append((check.add_mentions_of_moved_things(request, places), require_swapped_places))


@_checks_kind("leave", LEAVING, set())
def check_leave_request(request: Request, _: Places, check: _RequestChecker) -> None:
    """Objects that are left alone do not move, and are at the place in the words."""
    for phrase in request.movers:
        meant = check.scene.find(phrase)
        if not meant and not phrase.pronoun:
            raise Differs(f"there is no such thing as {phrase.text}")
        loose = [thing for thing in meant if not thing.fixed and phrase.pronoun not in OTHERS]
        moved = [thing for thing in loose if thing.has_moved]
        if moved and (len(moved) == len(loose) or phrase.plural or phrase.article == "all"):
            raise Differs(f"{phrase.text} moves, the words leave it alone")
        if moved:
            raise Unclear(f"which of {len(loose)} is {phrase.text} that stays is not understood")
        for how, places in request.relations:
            if all(place.is_bare_table for place in places):
                continue
            if how not in ("in", "on", "at"):
                raise Unclear(f"whether something is {how} something that stays is not understood")
            carriers = {thing.id for place in places for thing in check.scene.find(place)}
            for thing in meant:
                if not carriers & {number for _, number in check.scene.trace_supports(thing.ends)}:
                    raise Differs(f"{thing.label} is not {how} what the words leave it {how}")
