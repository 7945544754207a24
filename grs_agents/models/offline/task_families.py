"""The task families: each makes a plan of chosen objects; None if they do not suit it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

from grs_agents.models.offline.plan import (
    WALL,
    ZONE_HEIGHT,
    Family,
    Move,
    PlacementPlan,
    RowLayout,
    Table,
    Target,
    arrange_in_rows,
    list_row_arrangements,
)
from grs_agents.models.offline.prompt_text import COLORS, GAP, PromptObject, Rect, Vector, make_identifier

PALETTE = ("green", "blue", "red", "yellow", "purple", "orange")


@dataclass(frozen=True)
class TaskRequest:
    """Parameters of a task besides the objects to move."""

    color: str = "green"  # the colour of the first container or zone
    containers: tuple[PromptObject, ...] = ()  # hollow objects of the scene that may serve as containers
    criterion: str = ""  # property that separates objects, if needed
    margin: float = 1.0  # factor on the free space inside containers and zones
    support: PromptObject | None = None  # the object of the scene that carries a stack, at its place
    ordered: bool = False  # a stack keeps the order of the given objects
    taken: tuple[Rect, ...] = ()  # footprints of all objects on the table


def plan_pack_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Put all objects into a container: a suitable container of the scene, else a new container."""
    options = _list_arrangements_of_objects(objects, request)
    for container, rows in product(request.containers, options):
        inside = container.size[0] - 0.04 >= rows.width and container.size[1] - 0.04 >= rows.depth
        free = not any(container.footprint_rect.overlaps(obj.footprint_rect, GAP) for obj in objects)
        square = abs(container.orientation[2] * container.orientation[3]) < 0.04 or abs(container.orientation[2]) > 0.68
        if inside and free and square and container.size[2] <= 0.12:
            target = _make_target_from_object(container)
            return PlacementPlan("pack", (target,), _make_moves_to_rows(objects, target, rows, 0.01))
    for rows in options:
        border = 2 * (WALL + GAP * request.margin)
        height = round(min(0.08, max(0.04, 0.6 * min(obj.size[2] for obj in objects))), 3)
        size = (_round_up_to_cm(rows.width + border), _round_up_to_cm(rows.depth + border), height)
        if new := _place_new_target(
            f"{request.color}_container", "container", size, request.color, _make_table_with_objects(objects, request)
        ):
            return PlacementPlan("pack", (new,), _make_moves_to_rows(objects, new, rows, WALL))
    return None


def _make_target_from_object(obj: PromptObject) -> Target:
    """An object of the scene as a target at its place."""
    return Target(make_identifier(obj.name), "object", obj.size, obj.position[:2], obj.color, False, obj)


def plan_stack_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Stack the objects on a zone, or on an object that keeps its place; larger objects below smaller objects."""
    labels, base = [obj.label for obj in objects], [request.support] if request.support else []
    order = sorted(
        objects, key=lambda obj: (request.ordered * labels.index(obj.label), -obj.size[0] * obj.size[1], obj.name)
    )
    stack = [*base, *order]
    steady = all(
        below.is_flat_topped and all(b >= a - 0.004 for a, b in zip(above.size[:2], below.size[:2], strict=True))
        for below, above in pairwise(stack)
    )
    low = sum(obj.size[2] for obj in stack) <= 0.26  # the cup clears the last object
    if len(stack) < 2 or not (steady and low) or any(obj.size[2] > 2.5 * min(obj.size[:2]) for obj in order):
        return None
    side = _round_up_to_cm(max(order[0].size[:2]) + 0.03 * request.margin)
    table = _make_table_with_objects(objects, request)
    zone = None if base else _place_new_zone(f"{request.color}_zone", side, side, request.color, table)
    target = _make_target_from_object(base[0]) if base else zone
    if target is None:
        return None
    moves: list[Move] = []
    height = sum(obj.size[2] for obj in base)
    for obj in order:
        moves.append(Move(obj, target, (0.0, 0.0, height + obj.size[2] / 2)))
        height += obj.size[2]
    return PlacementPlan("stack", (target,), tuple(moves), exact=True)


def plan_sort_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Put each group, by colour or by category, onto its own zone."""
    keys: dict[str, Callable[[PromptObject], str]] = {"color": lambda obj: obj.color, "kind": lambda obj: obj.category}
    criteria = [request.criterion] if request.criterion in keys else ["color", "kind"]
    for criterion in criteria:
        groups: dict[str, list[PromptObject]] = {}
        for obj in objects:
            groups.setdefault(keys[criterion](obj), []).append(obj)
        if 2 <= len(groups) <= 3 and all(groups):
            table, targets, moves = _make_table_with_objects(objects, request), list[Target](), list[Move]()
            spare = [color for color in PALETTE if color not in groups]
            for index, name in enumerate(sorted(groups)):
                color = name if name in COLORS else spare[index % len(spare)]
                layout = _place_zone_with_rows(groups[name], f"{color}_zone", color, table, request)
                if layout is None:
                    return None
                targets.append(layout[0])
                moves.extend(layout[1])
            return PlacementPlan("sort", tuple(targets), tuple(moves), criterion)
    return None


def plan_line_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Put the objects side by side on a strip, from the shortest to the tallest."""
    order = sorted(objects, key=lambda obj: (obj.size[2], obj.name))
    if len(order) < 2:
        return None
    rows = arrange_in_rows([obj.size[:2] for obj in order], 1, GAP * 1.5 * request.margin)
    width, depth = _round_up_to_cm(rows.width + 2 * GAP), _round_up_to_cm(rows.depth + 2 * GAP)
    strip = _place_new_zone(
        f"{request.color}_strip", width, depth, request.color, _make_table_with_objects(objects, request)
    )
    return (
        None
        if strip is None
        else PlacementPlan("line", (strip,), _make_moves_to_rows(order, strip, rows), "height", exact=True)
    )


def plan_place_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Put all objects onto a zone."""
    layout = _place_zone_with_rows(
        objects, f"{request.color}_zone", request.color, _make_table_with_objects(objects, request), request
    )
    return None if layout is None else PlacementPlan("place", (layout[0],), layout[1])


def plan_distribute_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Put each object onto its own mark."""
    if not 2 <= len(objects) <= 4:
        return None
    table, targets, moves = _make_table_with_objects(objects, request), list[Target](), list[Move]()
    start = PALETTE.index(request.color) if request.color in PALETTE else 0
    for index, obj in enumerate(objects):
        color = PALETTE[(start + index) % len(PALETTE)]
        layout = _place_zone_with_rows([obj], f"{color}_mark", color, table, request)
        if layout is None:
            return None
        targets.append(layout[0])
        moves.extend(layout[1])
    return PlacementPlan("match", tuple(targets), tuple(moves))


def plan_clear_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Move objects out of their area to a free part of the table."""
    rects = [obj.footprint_rect for obj in objects]
    low = [min(r.x - r.width / 2 for r in rects) - GAP, min(r.y - r.depth / 2 for r in rects) - GAP]
    high = [max(r.x + r.width / 2 for r in rects) + GAP, max(r.y + r.depth / 2 for r in rects) + GAP]
    area = Rect((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[0] - low[0], high[1] - low[1])
    moving = [obj.footprint_rect for obj in objects]
    staying = any(area.overlaps(rect) for rect in request.taken if rect not in moving)
    if staying or any(obj.relocated for obj in objects) or max(area.width, area.depth) > 0.45:
        return None
    size = (_round_up_to_cm(area.width), _round_up_to_cm(area.depth), ZONE_HEIGHT)
    spot = Target(f"{request.color}_area", "zone", size, (area.x, area.y), request.color, moves=False)
    table = Table([*request.taken, area], objects[0].far)
    tallest = max(obj.size[2] for obj in objects)
    for rows in _list_arrangements_of_objects(objects, request):
        size = (_round_up_to_cm(rows.width + 2 * GAP), _round_up_to_cm(rows.depth + 2 * GAP), tallest)
        if free := _place_new_target("free_place", "free", size, "", table):
            return PlacementPlan("clear", (spot, free), _make_moves_to_rows(objects, free, rows))
    return None


def plan_exchange_task(objects: Sequence[PromptObject], request: TaskRequest) -> PlacementPlan | None:
    """Exchange the places of two objects; the oracle moves the first aside."""
    if len(objects) != 2:
        return None
    places = [
        Target(f"place_of_{make_identifier(obj.name)}", "free", obj.size, obj.position[:2], moves=False)
        for obj in objects
    ]
    pairs = zip(objects, reversed(places), strict=True)
    moves = tuple(Move(obj, place, (0.0, 0.0, obj.size[2] / 2)) for obj, place in pairs)
    return PlacementPlan("exchange", tuple(places), moves, exact=True)


FAMILIES: dict[Family, Callable[[Sequence[PromptObject], TaskRequest], PlacementPlan | None]] = {
    "pack": plan_pack_task,
    "stack": plan_stack_task,
    "sort": plan_sort_task,
    "line": plan_line_task,
    "clear": plan_clear_task,
    "match": plan_distribute_task,
    "place": plan_place_task,
    "exchange": plan_exchange_task,
}


def _list_arrangements_of_objects(objects: Sequence[PromptObject], request: TaskRequest) -> list[RowLayout]:
    return list_row_arrangements([obj.size[:2] for obj in objects], GAP * request.margin)


def _make_moves_to_rows(
    objects: Sequence[PromptObject], target: Target, rows: RowLayout, floor: float = 0.0
) -> tuple[Move, ...]:
    """Move each object to its place in the rows, its underside ``floor`` metres above the table."""
    pairs = zip(objects, rows.offsets, strict=True)
    return tuple(Move(obj, target, (x, y, floor + obj.size[2] / 2)) for obj, (x, y) in pairs)


def _place_zone_with_rows(
    objects: Sequence[PromptObject], name: str, color: str, table: Table, request: TaskRequest
) -> tuple[Target, tuple[Move, ...]] | None:
    border = 2 * GAP * request.margin
    for rows in _list_arrangements_of_objects(objects, request):
        size = _round_up_to_cm(rows.width + border), _round_up_to_cm(rows.depth + border)
        if zone := _place_new_zone(name, *size, color, table):
            return zone, _make_moves_to_rows(objects, zone, rows)
    return None


def _place_new_zone(name: str, width: float, depth: float, color: str, table: Table) -> Target | None:
    return _place_new_target(name, "zone", (width, depth, ZONE_HEIGHT), color, table)


def _place_new_target(
    name: str, kind: Literal["container", "zone", "free"], size: Vector, color: str, table: Table
) -> Target | None:
    free = table.find_free_places(size[0], size[1])
    spot = table.reserve_free_place(size[0], size[1])
    return None if spot is None else Target(name, kind, size, spot, color, free=free)


def _make_table_with_objects(objects: Sequence[PromptObject], request: TaskRequest) -> Table:
    return Table([*request.taken, *(obj.footprint_rect for obj in objects)], objects[0].far)


def _round_up_to_cm(length: float) -> float:
    """Rounded up to whole centimetres."""
    return round(-(-length // 0.01) * 0.01, 3)
