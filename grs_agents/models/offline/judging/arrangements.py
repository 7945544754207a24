"""Arrangements of objects at the end: in a line, by size, side by side, around an object, spread over places."""

import math
from collections.abc import Sequence
from itertools import pairwise

from grs_agents.models.offline.judging.places import Differs, Places, Unclear, prefer_hollow_things, reach_beside
from grs_agents.models.offline.judging.reading import LINING, STACKING, Request
from grs_agents.models.offline.judging.scene import Scene, Thing, distance_between

_IN_LINE = 0.02
"""Largest distance (m) from the line of a row."""
_ALIKE = 0.003
"""Tolerance (m) of sizes that count as equal."""
_ALIKE_VOLUME = 0.05
"""And the share of the largest volume."""
_HALF_ROUND = math.radians(200)
"""Largest angular gap between objects around another object: about half of the circle."""
MEASURES = {"shortfirst": (2, 1), "tallfirst": (2, -1), "smallfirst": (3, 1), "largefirst": (3, -1)}
"""Orders by size: which measure, and whether it grows or shrinks."""


def require_arrangement(request: Request, places: Places, things: Sequence[Thing], scene: Scene) -> None:
    """Raises ``Differs`` or ``Unclear`` unless the objects of a request end in the arrangement that it asks for."""
    if request.verb in LINING or "inrow" in request.orders:
        _require_things_in_line(things)
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
                _require_things_around(things, meant)
            elif how in ("in", "on", "at") and phrase.plural and 1 < len(meant) <= len(things):
                used = {number for thing in things for _, number in scene.trace_supports(thing.ends)}
                if unused := [place for place in meant if place.id not in used]:
                    spoken = f"the words speak of all of {phrase.text}"
                    raise Differs(f"none of the things ends on {unused[0].label}, {spoken}")
        if how == "on" and request.verb not in STACKING:
            _require_none_on_another(things)


def _require_things_in_line(things: Sequence[Thing]) -> None:
    if len(things) < 2:
        raise Unclear("what the line is of is not understood")
    _require_goals_fix_places(things, "in a line")
    points = [thing.end[:2] for thing in things]
    (ax, ay), (bx, by) = max(((a, b) for a in points for b in points), key=lambda pair: math.dist(*pair))
    length = math.dist((ax, ay), (bx, by))
    if any(abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) > _IN_LINE * length for x, y in points):
        raise Differs("the things do not end in a line")


def is_ordered_by_size(row: Sequence[Thing], order: str) -> bool:
    """Whether a row has an order by size, out of ``MEASURES``."""
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
    """Every object ends next to another object, and all are connected."""
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
    """By size along a row, from either side unless the words say from which; or as the words list them."""
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


def _require_things_around(things: Sequence[Thing], centers: Sequence[Thing]) -> None:
    """Objects end on all sides of another object."""
    if len(things) < 2 or len(centers) != 1:
        raise Unclear("what stands around what is not understood")
    _require_goals_fix_places(things, f"around {centers[0].label}")
    x, y = centers[0].end[:2]
    angles = sorted(math.atan2(thing.end[1] - y, thing.end[0] - x) for thing in things)
    gaps = [b - a for a, b in pairwise([*angles, angles[0] + 2 * math.pi])]
    if max(gaps) > _HALF_ROUND:
        raise Differs(f"the things do not end all around {centers[0].label}")


def _require_none_on_another(things: Sequence[Thing]) -> None:
    """Objects that are put on something do not end on each other."""
    numbers = {thing.id for thing in things}
    for thing in things:
        if any(how == "on" and number in numbers for how, number in thing.ends):
            raise Differs(f"{thing.label} ends on another one, the words stack nothing")
