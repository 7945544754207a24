"""How things end among one another: in a line, by size, side by side, around something, spread over several places."""

import math
from collections.abc import Sequence
from itertools import pairwise

from grs_agents.models.offline.judging.places import Differs, Places, Unclear, prefer_hollow_things, reach_beside
from grs_agents.models.offline.judging.reading import LINING, STACKING, Phrase, Request
from grs_agents.models.offline.judging.scene import Scene, Thing, distance_between

_IN_LINE = 0.02
"""Metres beside the line of things in a row."""
_ALIKE = 0.003
"""Metres by which things of one size may differ."""
_ALIKE_VOLUME = 0.05
"""And the share of the largest volume."""
_HALF_ROUND = math.radians(200)
"""What stands around something leaves no larger gap than about half of the circle."""
MEASURES = {"shortfirst": (2, 1), "tallfirst": (2, -1), "smallfirst": (3, 1), "largefirst": (3, -1)}
"""Orders by size: which measure, and whether it grows or shrinks."""


def require_arrangement(request: Request, places: Places, things: Sequence[Thing], scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless the things of a request end among one another as it says."""
    _require_row_or_group(request, things)
    chosen = iter(places)
    for how, phrases in request.relations:
        for phrase in phrases:
            place = next(chosen)
            found = [place] if place is not None else scene.find(phrase)
            found = prefer_hollow_things(found) if how == "in" else found
            _require_number_of_places(phrase, found)
            _require_spread(how, phrase, found, things, scene)
        if how == "on" and request.verb not in STACKING:
            _require_none_on_another(things)


def _require_row_or_group(request: Request, things: Sequence[Thing]) -> None:
    if request.verb in LINING or "inrow" in request.orders:
        _require_things_in_line(things)
    gathered = "together" in request.orders or request.verb in ("gather", "collect")
    if "sidebyside" in request.orders or (gathered and not request.has_carrier):
        _require_things_side_by_side(things)
    if "sizedfirst" not in request.orders or "sidebyside" in request.orders:
        _require_order_in_row(request, things)


def _require_spread(how: str, phrase: Phrase, found: Sequence[Thing], things: Sequence[Thing], scene: Scene) -> None:
    if how == "around":
        _require_things_around(things, found)
    elif how in ("in", "on", "at"):
        _require_places_are_used(phrase, found, things, scene)


def is_ordered_by_size(row: Sequence[Thing], order: str) -> bool:
    """Whether a row keeps to an order by size, one of ``MEASURES``."""
    measure, sign = MEASURES[order]
    sizes = [sign * thing.measure(measure) for thing in row]
    slack = _ALIKE if measure < 3 else _ALIKE_VOLUME * max(map(abs, sizes), default=0.0)
    return all(a <= b + slack for a, b in pairwise(sizes))


def _require_goals_fix_places(things: Sequence[Thing], what: str) -> None:
    """What the film shows by chance no goal asks for."""
    free = [thing for thing in things if not thing.is_pinned and not thing.lined]
    if free:
        raise Differs(f"no goal asks for {free[0].label} to end {what}")


def _require_things_in_line(things: Sequence[Thing]) -> None:
    if len(things) < 2:
        raise Unclear("what the line is of is not understood")
    _require_goals_fix_places(things, "in a line")
    points = [thing.end[:2] for thing in things]
    (ax, ay), (bx, by) = max(((a, b) for a in points for b in points), key=lambda pair: math.dist(*pair))
    length = math.dist((ax, ay), (bx, by))
    if any(abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) > _IN_LINE * length for x, y in points):
        raise Differs("the things do not end in a line")


def _require_things_side_by_side(things: Sequence[Thing]) -> None:
    """Each is beside another one, and all are joined so."""
    if len(things) < 2:
        raise Unclear("beside each other are two things at least")
    _require_goals_fix_places([thing for thing in things if not thing.reach], "beside the others")
    joined, waiting = [things[0]], list(things[1:])
    while waiting:
        near = [
            (one, other)
            for one in waiting
            for other in joined
            if distance_between(one, one.end, other, other.end, widest=True) <= reach_beside(one, other)
        ]
        if not near:
            raise Differs(f"{waiting[0].label} does not end beside the others")
        joined.append(near[0][0])
        waiting.remove(near[0][0])


def _require_order_in_row(request: Request, things: Sequence[Thing]) -> None:
    """By size along a row, from either side unless the words say from which; or as the words list them."""
    sided, measures = request.orders & {"leftright", "rightleft"}, request.orders & MEASURES.keys()
    listed = request.verb in LINING and "inorder" in request.orders
    if not things or not (sided or measures or listed):
        return
    _require_goals_fix_places(things, "in this order")
    _require_goals_tell_things_apart(things)
    ways = _list_ways_along_row(things, sided)
    names = ", ".join(thing.label for thing in ways[0])
    if not all(any(is_ordered_by_size(way, order) for way in ways) for order in measures):
        raise Differs(f"the row is {names}, another order than by size")
    if not measures and list(things) not in ways:
        raise Differs(f"the row is {names}, in another order than the words")


def _list_ways_along_row(things: Sequence[Thing], sided: set[str]) -> list[list[Thing]]:
    """The things along their row, from the side that the words say, or from either one."""
    axis = 1 if sided else _find_axis_of_row(things)
    row = sorted(things, key=lambda thing: thing.end[axis], reverse="leftright" in sided)
    return [row] if sided else [row, row[::-1]]


def _require_goals_tell_things_apart(things: Sequence[Thing]) -> None:
    if any(len(thing.spots) > 1 for thing in things) and len({thing.called for thing in things}) > 1:
        raise Differs("the goals leave open which thing ends at which place of the row")


def _find_axis_of_row(things: Sequence[Thing]) -> int:
    spans = [max(ends) - min(ends) for ends in zip(*(thing.end[:2] for thing in things), strict=True)]
    return spans.index(max(spans))


def _require_things_around(things: Sequence[Thing], found: Sequence[Thing]) -> None:
    """Things stand on all sides of another one."""
    if len(things) < 2 or len(found) != 1:
        raise Unclear("what stands around what is not understood")
    _require_goals_fix_places(things, f"around {found[0].label}")
    x, y = found[0].end[:2]
    angles = sorted(math.atan2(thing.end[1] - y, thing.end[0] - x) for thing in things)
    gaps = [b - a for a, b in pairwise([*angles, angles[0] + 2 * math.pi])]
    if max(gaps) > _HALF_ROUND:
        raise Differs(f"the things do not end all around {found[0].label}")


def _require_number_of_places(phrase: Phrase, found: Sequence[Thing]) -> None:
    if phrase.number is not None and phrase.number > 1 and len(found) != phrase.number:
        raise Differs(f"there are {len(found)} of {phrase.text}, the words say {phrase.number}")


def _require_places_are_used(phrase: Phrase, found: Sequence[Thing], things: Sequence[Thing], scene: Scene) -> None:
    """Of places that the words speak of as several none stays without a thing, where there are enough."""
    if phrase.plural and 1 < len(found) <= len(things):
        used = {number for thing in things for _, number in scene.trace_supports(thing.ends)}
        if unused := [place for place in found if place.id not in used]:
            raise Differs(f"none of the things ends on {unused[0].label}, the words speak of all of {phrase.text}")


def _require_none_on_another(things: Sequence[Thing]) -> None:
    """What is put on something does not end on what is put there too."""
    own = {thing.id for thing in things}
    for thing in things:
        if any(how == "on" and number in own for how, number in thing.ends):
            raise Differs(f"{thing.label} ends on another one, the words stack nothing")
