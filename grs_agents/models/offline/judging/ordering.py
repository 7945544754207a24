"""When things happen, against what the words say of it: first, then, finally, in this order."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from grs_agents.models.offline.judging.arrangements import MEASURES
from grs_agents.models.offline.judging.places import Differs
from grs_agents.models.offline.judging.reading import LINING, STACKING, Request
from grs_agents.models.offline.judging.scene import Thing

_SPATIAL = {"leftright", "rightleft", "bottomup", "topdown", "sidebyside", "inrow"}


def require_order_in_time(requests: Sequence[Request], movers: Sequence[Sequence[Thing]]) -> None:
    """Raises ``Differs`` unless goals ask for things in the order of the words, and the film shows them in it.

    Args:
        requests: what the words ask for.
        movers: what each of them moves.
    """
    for earlier, later in _list_ordered_request_pairs(requests):
        for one in movers[earlier]:
            for other in movers[later]:
                _require_moved_before(one, other)
    for request, things in zip(requests, movers, strict=True):
        for one, other in pairwise(_list_things_in_move_order(request, things)):
            _require_moved_before(one, other)


def _list_ordered_request_pairs(requests: Sequence[Request]) -> Iterator[tuple[int, int]]:
    """Which request comes before which other one, as far as the words say."""
    for number, request in enumerate(requests):
        if request.after:
            yield from ((before, number) for before in range(number))
        if request.first:
            yield from ((number, other) for other in range(len(requests)) if other != number)
        if request.last:
            yield from ((other, number) for other in range(len(requests)) if other != number)


def _list_things_in_move_order(request: Request, things: Sequence[Thing]) -> Sequence[Thing]:
    """The things of one request as they are to be moved; none where the words leave it open, or speak of places."""
    if request.verb in LINING or request.orders & _SPATIAL:
        return ()
    measures = request.orders & MEASURES.keys()
    if "sizedfirst" in request.orders and measures and request.verb not in STACKING:
        measure, sign = MEASURES[min(measures)]
        return sorted(things, key=lambda thing: sign * thing.measure(measure))
    return things if "inorder" in request.orders else ()


def _require_moved_before(one: Thing, other: Thing) -> None:
    if one is other:
        return
    if not one.actions or not other.actions or one.actions[-1] >= other.actions[-1]:
        raise Differs(f"{other.label} is not moved after {one.label}, which the words put first")
    if one.asked_by[-1] < other.asked_by[-1]:
        return
    stacked = one.asked_by[-1] == other.asked_by[-1] and ("on", one.id) in other.ends
    if not stacked:
        raise Differs(f"no goal asks for {one.label} before {other.label}: goals are met in their order")
