"""The task families: each turns chosen things into a plan, or says that they do not suit it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from grs_agents.models.offline.plan import WALL, ZONE_HEIGHT, Family, Frame, Move, Plan, Table, in_rows
from grs_agents.models.offline.prompt_text import COLORS, GAP, Rect, Thing, Vector, identifier

PALETTE = ("green", "blue", "red", "yellow", "purple", "orange")


@dataclass(frozen=True)
class Wish:
    """What is asked for besides the things to move.

    Attributes:
        color: the colour of the first container or zone.
        holders: hollow things of the scene that may serve as containers.
        note: how to tell things apart, where that matters.
        margin: factor on the free space inside containers and zones.
    """

    color: str = "green"
    holders: tuple[Thing, ...] = ()
    note: str = ""
    margin: float = 1.0


def pack(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """Everything into one container: one of the scene's where one fits, else a new one."""
    rows = in_rows([thing.size[:2] for thing in things], gap=GAP * wish.margin)
    frame = _holder(things, wish, rows.width, rows.depth) or _new_container(things, wish, rows.width, rows.depth)
    if frame is None:
        return None
    floor = WALL if frame.kind == "container" else 0.01
    moves = [
        Move(thing, frame, (x, y, floor + thing.size[2] / 2))
        for thing, (x, y) in zip(things, rows.offsets, strict=True)
    ]
    return Plan("pack", (frame,), tuple(moves))


def _holder(things: Sequence[Thing], wish: Wish, width: float, depth: float) -> Frame | None:
    for holder in wish.holders:
        inside = holder.size[0] - 0.04 >= width and holder.size[1] - 0.04 >= depth
        free = not any(holder.rect.overlaps(thing.rect, GAP) for thing in things)
        square = abs(holder.orientation[2] * holder.orientation[3]) < 0.04 or abs(holder.orientation[2]) > 0.68
        if inside and free and square and holder.size[2] <= 0.12:
            name = identifier(holder.name)
            return Frame(name, "thing", holder.size, holder.position[:2], holder.color, False, holder)
    return None


def _new_container(things: Sequence[Thing], wish: Wish, width: float, depth: float) -> Frame | None:
    border = 2 * (WALL + GAP * wish.margin)
    height = round(min(0.08, max(0.04, 0.6 * min(thing.size[2] for thing in things))), 3)
    size = (_up(width + border), _up(depth + border), height)
    return _frame(f"{wish.color}_container", "container", size, wish.color, _table(things))


def stack(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """One upon the other on a zone, the larger below the smaller."""
    order = sorted(things, key=lambda thing: (-thing.size[0] * thing.size[1], thing.name))
    for below, above in pairwise(order):
        wider = all(b >= a - 0.004 for a, b in zip(above.size[:2], below.size[:2], strict=True))
        if not wider or not below.flat_topped:
            return None
    tall = sum(thing.size[2] for thing in order)
    if len(order) < 2 or tall > 0.26 or any(thing.size[2] > 2.5 * min(thing.size[:2]) for thing in order):
        return None
    side = _up(max(order[0].size[:2]) + 0.03 * wish.margin)
    zone = _zone(f"{wish.color}_zone", side, side, wish.color, _table(things))
    if zone is None:
        return None
    moves: list[Move] = []
    height = 0.0
    for thing in order:
        moves.append(Move(thing, zone, (0.0, 0.0, height + thing.size[2] / 2)))
        height += thing.size[2]
    return Plan("stack", (zone,), tuple(moves), exact=True)


def sort(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """Each group, by colour or by category, onto a zone of its own."""
    keys: dict[str, Callable[[Thing], str]] = {
        "color": lambda thing: thing.color,
        "kind": lambda thing: thing.category,
    }
    notes = [wish.note] if wish.note in keys else ["color", "kind"]
    for note in notes:
        groups: dict[str, list[Thing]] = {}
        for thing in things:
            groups.setdefault(keys[note](thing), []).append(thing)
        if 2 <= len(groups) <= 3 and all(groups):
            return _sorted(things, groups, note, wish)
    return None


def _sorted(things: Sequence[Thing], groups: dict[str, list[Thing]], note: str, wish: Wish) -> Plan | None:
    table, frames, moves = _table(things), list[Frame](), list[Move]()
    spare = [color for color in PALETTE if color not in groups]
    for index, name in enumerate(sorted(groups)):
        color = name if name in COLORS else spare[index % len(spare)]
        laid = _laid_out(groups[name], f"{color}_zone", color, table, wish)
        if laid is None:
            return None
        frames.append(laid[0])
        moves.extend(laid[1])
    return Plan("sort", tuple(frames), tuple(moves), note)


def line(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """Side by side on a strip, from the shortest to the tallest."""
    order = sorted(things, key=lambda thing: (thing.size[2], thing.name))
    if len(order) < 2:
        return None
    rows = in_rows([thing.size[:2] for thing in order], 1, GAP * 1.5 * wish.margin)
    width, depth = _up(rows.width + 2 * GAP), _up(rows.depth + 2 * GAP)
    strip = _zone(f"{wish.color}_strip", width, depth, wish.color, _table(things))
    if strip is None:
        return None
    moves = [Move(thing, strip, (x, y, thing.size[2] / 2)) for thing, (x, y) in zip(order, rows.offsets, strict=True)]
    return Plan("line", (strip,), tuple(moves), "height", exact=True)


def place(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """Everything onto one zone."""
    laid = _laid_out(things, f"{wish.color}_zone", wish.color, _table(things), wish)
    return None if laid is None else Plan("place", (laid[0],), tuple(laid[1]))


def match(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """Each onto a mark of its own."""
    if not 2 <= len(things) <= 4:
        return None
    table, frames, moves = _table(things), list[Frame](), list[Move]()
    start = PALETTE.index(wish.color) if wish.color in PALETTE else 0
    for index, thing in enumerate(things):
        color = PALETTE[(start + index) % len(PALETTE)]
        laid = _laid_out([thing], f"{color}_mark", color, table, wish)
        if laid is None:
            return None
        frames.append(laid[0])
        moves.extend(laid[1])
    return Plan("match", tuple(frames), tuple(moves))


def clear(things: Sequence[Thing], wish: Wish) -> Plan | None:
    """Out of the area in which they stand, to a free part of the table."""
    rects = [thing.rect for thing in things]
    low = [min(r.x - r.width / 2 for r in rects) - GAP, min(r.y - r.depth / 2 for r in rects) - GAP]
    high = [max(r.x + r.width / 2 for r in rects) + GAP, max(r.y + r.depth / 2 for r in rects) + GAP]
    area = Rect((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[0] - low[0], high[1] - low[1])
    if any(thing.relocated for thing in things) or max(area.width, area.depth) > 0.45:
        return None
    size = (_up(area.width), _up(area.depth), ZONE_HEIGHT)
    spot = Frame(f"{wish.color}_area", "zone", size, (area.x, area.y), wish.color, moves=False)
    table = Table([area])
    rows = in_rows([thing.size[:2] for thing in things], gap=GAP * wish.margin)
    size = (_up(rows.width + 2 * GAP), _up(rows.depth + 2 * GAP), max(thing.size[2] for thing in things))
    free = _frame("free_place", "free", size, "", table)
    if free is None:
        return None
    moves = [Move(thing, free, (x, y, thing.size[2] / 2)) for thing, (x, y) in zip(things, rows.offsets, strict=True)]
    return Plan("clear", (spot, free), tuple(moves))


FAMILIES: dict[Family, Callable[[Sequence[Thing], Wish], Plan | None]] = {
    "pack": pack,
    "stack": stack,
    "sort": sort,
    "line": line,
    "clear": clear,
    "match": match,
    "place": place,
}


def _laid_out(
    things: Sequence[Thing], name: str, color: str, table: Table, wish: Wish
) -> tuple[Frame, list[Move]] | None:
    rows = in_rows([thing.size[:2] for thing in things], gap=GAP * wish.margin)
    border = 2 * GAP * wish.margin
    zone = _zone(name, _up(rows.width + border), _up(rows.depth + border), color, table)
    if zone is None:
        return None
    return zone, [
        Move(thing, zone, (x, y, thing.size[2] / 2)) for thing, (x, y) in zip(things, rows.offsets, strict=True)
    ]


def _zone(name: str, width: float, depth: float, color: str, table: Table) -> Frame | None:
    return _frame(name, "zone", (width, depth, ZONE_HEIGHT), color, table)


def _frame(name: str, kind: str, size: Vector, color: str, table: Table) -> Frame | None:
    spot = table.place(size[0], size[1])
    if spot is None:
        return None
    return Frame(name, "container" if kind == "container" else "zone" if kind == "zone" else "free", size, spot, color)


def _table(things: Sequence[Thing]) -> Table:
    return Table([thing.rect for thing in things])


def _up(length: float) -> float:
    """Rounded up to whole centimetres."""
    return round(-(-length // 0.01) * 0.01, 3)
