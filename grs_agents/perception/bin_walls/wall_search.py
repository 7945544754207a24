"""The walls of a bin, found in what rises above the table and checked against the photo."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.straight_lines import (
    outermost_places,
    possible_rim_places,
    rim_level,
    rotation_to_axes,
)
from grs_agents.perception.bin_walls.view import (
    Sight,
    View,
    ends_in_sight,
    extend_to_seen_corners,
    is_seen_all_along,
    seen_rim_length,
    slide_to_rim,
)
from grs_agents.perception.bin_walls.wall import SIDES, Wall, extend_to_corners, outside_mask, rim_points, side_points
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import axes_from_yaws, label_connected_components
from grs_agents.perception.types import Array, Mask


def find_walls(sights: Sequence[Sight], axes: Array) -> tuple[list[Wall], Array]:
    """The walls of a bin, none where they do not make one; and the directions across them, (2, 2). In the later sights,
    nearer to the robot, hidden walls are looked for."""
    cells, view = sights[0].cells, sights[0].view
    walls = _straight_walls(sights[0], axes)
    for _ in range(CONFIG.rounds):
        if not walls:
            return [], axes
        axes = axes_from_yaws(np.array([_turn(walls, cells @ rotation_to_axes(axes))]))[0] @ axes
        walls = _straight_walls(sights[0], axes)
    rims = {
        number: slide_to_rim(extend_to_seen_corners(wall, walls, axes, view), axes, view)
        for number, wall in walls.items()
    }
    walls = {number: wall for number, wall in walls.items() if is_seen_all_along(rims[number], axes, view)}
    if not walls:
        return [], axes
    rims, measured = len(walls), dict(walls)
    for sight in sights:
        walls |= _hidden_walls(walls, measured, sight.cells @ rotation_to_axes(axes), axes, sight.view)
    joined = _joined_walls(walls, axes, view)
    joined = [slide_to_rim(wall, axes, view) for wall in joined]
    local = cells @ rotation_to_axes(axes)
    certain = _are_all_around(joined, local, axes, view) and _are_long(joined, rims, axes, view)
    return (joined if certain else []), axes


def _straight_walls(sight: Sight, axes: Array) -> dict[int, Wall]:
    """By side, the outermost lines of which the rims are level with each other, and seen all along."""
    turn, view = rotation_to_axes(axes), sight.view
    local, level = sight.cells @ turn, rim_level(sight.unmixed @ turn)
    rims = {number: _possible_rims(local, number, level, axes, view) for number in range(len(SIDES))}
    while crossed := _crossed_sides({number: ones[-1] for number, ones in rims.items() if ones}, axes, view):
        for number in crossed:
            rims[number].pop()
    return {number: ones[-1][1] for number, ones in rims.items() if ones}


def _possible_rims(local: Array, number: int, level: float, axes: Array, view: View) -> list[tuple[int, Wall]]:
    """The rims that may be on a side, with how many centimetres are seen of each, the longest last."""
    walls = [_measure_wall(local, number, place, level) for place in possible_rim_places(local, number, level)]
    seen = [(seen_rim_length(wall, axes, view), wall) for wall in walls if wall is not None]
    return sorted((one for one in seen if one[0] > CONFIG.few), key=lambda one: one[0])


def _crossed_sides(rims: dict[int, tuple[int, Wall]], axes: Array, view: View) -> set[int]:
    """The sides on which lies no wall, as a longer one goes on beyond it: its line is that of things in the bin."""
    crossed: set[int] = set()
    for (length, wall), (longer, one) in permutations(rims.values(), 2):
        if longer > length and _is_seen_beyond(one, wall, axes, view):
            crossed.add(wall.side)
    return crossed


def _is_seen_beyond(one: Wall, wall: Wall, axes: Array, view: View) -> bool:
    """Whether the wall ``one`` is across a ``wall``, and more of it is seen beyond that than by chance."""
    axis, sign = SIDES[wall.side]
    end, corner = sign * (one.end if sign > 0 else one.start), wall.outer + CONFIG.strip
    if SIDES[one.side][0] == axis or end <= corner:
        return False
    seen, _, _ = view.look(rim_points(one, axes, *sorted((sign * corner, sign * end))))
    return bool(seen.sum() > CONFIG.few)


def _measure_wall(local: Array, number: int, place: float, level: float) -> Wall | None:
    """The wall with its rim at ``level`` at a place across a side; None if it is not long."""
    axis, sign = SIDES[number]
    across, along = sign * local[:, axis], local[:, 1 - axis]
    rim = (np.abs(local[:, 2] - level) < CONFIG.level) & (np.abs(across - place) < CONFIG.strip)
    rim &= np.abs(across - _straight(across, along, rim)) < CONFIG.thick / 2
    if len(np.unique(np.floor(along[rim] / CONFIG.line))) * CONFIG.line < CONFIG.short:
        return None
    inner, outer = np.percentile(across[rim], (10, 90))
    start, end = np.percentile(along[rim], (1, 99))
    return Wall(number, float(inner), float(outer), float(start), float(end), level)


def _straight(across: Array, along: Array, rim: Mask) -> Array:
    """(N,) where the line that most of the ``rim`` cells lie on is across, at (N,) places along it."""
    level, slope, own = float(np.median(across[rim])), 0.0, rim
    for _ in range(3):
        own = rim & (np.abs(across - level - slope * along) < CONFIG.thick / 2)
        if np.count_nonzero(own) < 3:
            break
        slope, level = (float(v) for v in np.polyfit(along[own], across[own], 1))
    return level + slope * along


def _turn(walls: dict[int, Wall], local: Array) -> float:
    """By what angle, rad, the axes must turn to be along the walls."""
    turns: list[float] = []
    for wall in walls.values():
        axis, sign = SIDES[wall.side]
        across, along = local[:, axis], local[:, 1 - axis]
        own = np.abs(sign * across - wall.middle) < CONFIG.thick / 2
        own &= np.abs(local[:, 2] - wall.height) < CONFIG.level
        slope = float(np.polyfit(along[own], across[own], 1)[0])
        turns.append(-slope if axis == 0 else slope)
    # The angle of a line is known the better, the longer it is: its variance falls with the third power of the length.
    return float(np.average(turns, weights=[(wall.end - wall.start) ** 3 for wall in walls.values()]))


def _hidden_walls(
    walls: dict[int, Wall], measured: dict[int, Wall], local: Array, axes: Array, view: View
) -> dict[int, Wall]:
    """By side, walls of which the rim is hidden or beyond the picture: straight lines of what is lower, where the side
    that faces the camera is seen wherever nothing hides it, and that the ``measured`` walls may end at."""
    height = next(iter(walls.values())).height
    thick = float(np.median([wall.outer - wall.inner for wall in walls.values()]))
    low = local[local[:, 2] < height + CONFIG.level]
    eye = axes @ view.pose[:2, 3]
    found: dict[int, Wall] = {}
    for number in set(range(len(SIDES))) - set(walls):
        axis, sign = SIDES[number]
        ending = [one for one in measured.values() if SIDES[one.side][0] != axis]
        for place in outermost_places(low, number) if ending else []:
            inner = place if sign * eye[axis] < place else place - thick
            wall = extend_to_corners(Wall(number, inner, inner + thick, 0.0, 0.0, height), walls)
            seen, past, _ = view.look(side_points(wall, place, axes))
            is_face_seen = seen.sum() > CONFIG.face and past.sum() <= min(CONFIG.few, seen.sum() * (1 - CONFIG.seen))
            if is_face_seen and all(_may_end_at(wall, one, axes, view) for one in ending):
                found[number] = wall
    return found


def _may_end_at(wall: Wall, one: Wall, axes: Array, view: View) -> bool:
    """Whether the measured wall ``one`` is seen neither beyond a ``wall`` across its end, nor past on the way to it."""
    sign = SIDES[wall.side][1]
    end = sign * (one.end if sign > 0 else one.start)
    if end >= wall.outer + CONFIG.margin:
        return False
    _, past, _ = view.look(rim_points(one, axes, *sorted((sign * end, sign * wall.inner))))
    return bool(past.sum() <= CONFIG.few)


def _joined_walls(walls: dict[int, Wall], axes: Array, view: View) -> list[Wall]:
    """The walls from corner to corner; where one ends in plain sight and no other meets it, another one is assumed."""
    for wall in list(walls.values()):
        for last, sign in ((False, -1.0), (True, 1.0)):
            other = 2 * (1 - SIDES[wall.side][0]) + int(last)
            end = wall.end if last else wall.start
            if other not in walls and ends_in_sight(wall, end, sign, axes, view):
                thick = wall.outer - wall.inner
                walls[other] = Wall(other, sign * end - thick, sign * end, 0.0, 0.0, wall.height)
    return [extend_to_seen_corners(wall, walls, axes, view) for wall in walls.values()]


def _are_all_around(walls: Sequence[Wall], local: Array, axes: Array, view: View) -> bool:
    """Whether the walls are seen wherever they are not hidden, and hardly anything that rises to half their height is
    beyond them: what is lower may be the robot's blurred edge."""
    around = all(is_seen_all_along(wall, axes, view) for wall in walls)
    tall = local[local[:, 2] > walls[0].height / 2]
    return around and outside_mask(walls, tall, view.pose[:3, 3] @ rotation_to_axes(axes)).mean() < CONFIG.outside


def _are_long(walls: Sequence[Wall], rims: int, axes: Array, view: View) -> bool:
    """Whether enough of the ``rims`` is seen, if there are several, or of the sides."""
    lengths = [int(view.look(rim_points(wall, axes, wall.start, wall.end))[0].sum()) for wall in walls]
    if rims >= CONFIG.rims and sum(lengths) * CONFIG.line > CONFIG.long:
        return True
    return _are_sides_long(walls, axes, view)


def _are_sides_long(walls: Sequence[Wall], axes: Array, view: View) -> bool:
    """Whether enough of the sides of several walls is seen: the rims of most may be beyond the picture."""
    sides = [view.look(side_points(wall, wall.inner, axes))[0] for wall in walls]
    counts = [len(rim_points(wall, axes, wall.start, wall.end)) for wall in walls]
    lengths = [int(side.reshape(-1, count).any(axis=0).sum()) for side, count in zip(sides, counts, strict=True)]
    several = sum(length > CONFIG.few for length in lengths) >= CONFIG.sides
    return several and sum(lengths) * CONFIG.line > CONFIG.long


def holds_things(walls: Sequence[Wall], axes: Array, cells: Array) -> bool:
    """Whether several things stand apart between the walls, seen from above, or the walls are farther apart than those
    of an object: a box with one thing in it is an object."""
    inner = {wall.side: wall.inner for wall in walls}
    spans = [inner[side] + inner[side + 1] for side in (0, 2) if side in inner and side + 1 in inner]
    if max(spans, default=0.0) > DEFAULT.measuring.largest:
        return True
    local = cells[:, :2] @ axes.T
    inside = np.ones(len(cells), np.bool_)
    for wall in walls:
        axis, sign = SIDES[wall.side]
        inside &= sign * local[:, axis] < wall.inner - CONFIG.strip
    if not inside.any():
        return False
    places = np.floor((local[inside] - local[inside].min(axis=0)) / CONFIG.line).astype(np.int64)
    grid = np.zeros(places.max(axis=0) + 1, np.uint8)
    grid[places[:, 0], places[:, 1]] = 1
    return int(label_connected_components(grid, CONFIG.thing).max()) >= CONFIG.things
