"""Search of a bin's walls: straight lines in the raised cells of the table, checked against the photo."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.walls import (
    SIDES,
    BinCamera,
    Wall,
    extend_to_corners,
    extend_to_seen_corners,
    rim_points,
    side_points,
    slide_to_rim,
)
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import axes_from_yaws, label_connected_components
from grs_agents.perception.types import Array


@dataclass(frozen=True)
class Sight:
    """The raised surface outside of the robot's blurred surroundings."""

    cells: Array  # (N, 3) as `raised_cells` makes them
    unmixed: Array  # (M, 3) the same without flying pixels, which form straight lines in the air
    camera: BinCamera


def raised_cells(cloud: Array) -> Array:
    """(N, 3) mean x, mean y and greatest height of the raised cells of the table; from (M, 3) points."""
    cloud = cloud[(cloud[:, 2] > CONFIG.raised) & (cloud[:, 2] < CONFIG.highest)]
    if not len(cloud):
        return np.zeros((0, 3))
    index = np.floor(cloud[:, :2] / CONFIG.cell).astype(np.int64)
    index -= index.min(axis=0)
    keys, owners = np.unique(index[:, 0] * (index[:, 1].max() + 1) + index[:, 1], return_inverse=True)
    tops = np.zeros(len(keys))
    np.maximum.at(tops, owners, cloud[:, 2])
    count = np.bincount(owners)
    middle = [np.bincount(owners, cloud[:, axis]) / count for axis in (0, 1)]
    return np.stack([*middle, tops], axis=1)


def likely_axes(cells: Array) -> list[Array]:
    """(2, 2) each, the directions across the walls, the likeliest first: local maxima, over yaw, of the length of the
    outermost straight lines. The picture's border cuts straight lines too."""
    yaws = np.deg2rad(np.arange(0, 90, CONFIG.turn))
    turned = [cells @ _rotation_to_axes(axes) for axes in axes_from_yaws(yaws)]
    scores = np.array([sum(_longest_line(local, *side)[1] for side in SIDES) for local in turned])
    beside = [np.roll(scores, shift) for shift in range(-CONFIG.apart_yaws, CONFIG.apart_yaws + 1) if shift]
    peaks = np.flatnonzero(scores >= np.max(beside, axis=0))
    best = peaks[np.argsort(-scores[peaks], kind="stable")][: CONFIG.hypotheses]
    return list(axes_from_yaws(yaws[best]))


def _rotation_to_axes(axes: Array) -> Array:
    """(3, 3) rotation of rows of (N, 3) points into the bin's axes."""
    turn = np.eye(3)
    turn[:2, :2] = axes.T
    return turn


def _straight_lines(local: Array, axis: int, sign: float) -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Lines along a side, from the innermost: outward position, m; occupied length, cm; and share of the cells beyond.
    ``local`` are (N, 3) cells in the bin's axes."""
    across, along = sign * local[:, axis], local[:, 1 - axis]
    bins = ((across - across.min()) / CONFIG.line).astype(np.int64)
    places = ((along - along.min()) / CONFIG.line).astype(np.int64)
    grid = np.zeros((bins.max() + 4, places.max() + 1), np.bool_)
    grid[bins, places] = True
    held = (grid[:-3] | grid[1:-2]).sum(axis=1)
    within = np.cumsum(np.bincount(bins, minlength=len(grid)))
    beyond = 1 - within[3:] / len(local)
    return across.min() + (np.arange(len(held)) + 1) * CONFIG.line, held, beyond


def _longest_line(local: Array, axis: int, sign: float) -> tuple[float, int]:
    """Position (m) and length (cm) of the longest nearly outermost line along a side."""
    places, held, beyond = _straight_lines(local, axis, sign)
    held[beyond > CONFIG.outside] = 0
    best = int(np.argmax(held))
    return float(places[best]), int(held[best])


def find_walls(sights: Sequence[Sight], axes: Array) -> tuple[list[Wall], Array]:
    """The walls of a bin, none if they form no bin; and the directions across them, (2, 2).

    Hidden walls are also searched in the later sights, nearer to the robot.
    """
    cells, camera = sights[0].cells, sights[0].camera
    walls = _straight_walls(sights[0], axes)
    for _ in range(CONFIG.rounds):
        if not walls:
            return [], axes
        local = cells @ _rotation_to_axes(axes)
        turns: list[float] = []
        for wall in walls.values():
            axis, sign = SIDES[wall.side]
            across, along = local[:, axis], local[:, 1 - axis]
            near = np.abs(sign * across - wall.middle) < CONFIG.thick / 2
            near &= np.abs(local[:, 2] - wall.height) < CONFIG.level
            slope = float(np.polyfit(along[near], across[near], 1)[0])
            turns.append(-slope if axis == 0 else slope)
        # The variance of a line's angle falls with the third power of its length.
        turn = float(np.average(turns, weights=[(wall.end - wall.start) ** 3 for wall in walls.values()]))
        axes = axes_from_yaws(np.array([turn]))[0] @ axes
        walls = _straight_walls(sights[0], axes)
    rims = {
        number: slide_to_rim(extend_to_seen_corners(wall, walls, axes, camera), axes, camera)
        for number, wall in walls.items()
    }
    walls = {number: wall for number, wall in walls.items() if camera.sees_rim(rims[number], axes)}
    if not walls:
        return [], axes
    measured = dict(walls)
    for sight in sights:
        walls |= _hidden_walls(walls, measured, sight.cells @ _rotation_to_axes(axes), axes, sight.camera)
    # A wall that visibly ends without an adjoining wall implies an unseen wall there.
    for wall in list(walls.values()):
        for side, end, sign in (
            (2 * (1 - SIDES[wall.side][0]), wall.start, -1.0),
            (2 * (1 - SIDES[wall.side][0]) + 1, wall.end, 1.0),
        ):
            near, far = end + sign * CONFIG.gap, end + sign * (CONFIG.gap + CONFIG.free)
            if side in walls:
                continue
            _, past, _ = camera.check_visibility(rim_points(wall, axes, min(near, far), max(near, far)))
            if past.mean() > 0.5:
                thick = wall.outer - wall.inner
                walls[side] = Wall(side, sign * end - thick, sign * end, 0.0, 0.0, wall.height)
    joined = [extend_to_seen_corners(wall, walls, axes, camera) for wall in walls.values()]
    joined = [slide_to_rim(wall, axes, camera) for wall in joined]
    is_bin = _enclose_raised_cells(joined, cells, axes, camera) and _are_long(joined, len(measured), axes, camera)
    return (joined if is_bin else []), axes


def _straight_walls(sight: Sight, axes: Array) -> dict[int, Wall]:
    """By side, the longest visible lines with level rims."""
    turn, camera = _rotation_to_axes(axes), sight.camera
    local, unmixed = sight.cells @ turn, sight.unmixed @ turn
    # Level of the rims: the mode of the tops along the outermost lines. Occluders cut walls anywhere below.
    columns: list[Array] = []
    for axis, sign in SIDES:
        place, _ = _longest_line(unmixed, axis, sign)
        near = np.abs(sign * unmixed[:, axis] - place) < CONFIG.strip
        _, owners = np.unique(np.floor(unmixed[near, 1 - axis] / CONFIG.line).astype(np.int64), return_inverse=True)
        highest = np.zeros(int(owners.max(initial=-1)) + 1)
        np.maximum.at(highest, owners, unmixed[near, 2])
        columns.append(highest)
    tops = np.concatenate(columns)
    alike = np.abs(tops[:, None] - tops) < CONFIG.level / 2
    level = float(np.median(tops[alike[int(np.argmax(alike.sum(axis=1)))]]))
    rims: dict[int, list[tuple[int, Wall]]] = {}  # by side, visible length (cm) and wall, the longest last
    for number in range(len(SIDES)):
        found: list[tuple[int, Wall]] = []
        for place in _possible_rim_places(local, number, level):
            wall = _measure_wall(local, number, place, level)
            if wall is not None:
                seen, past, _ = camera.check_rim(wall, axes)
                length = int(seen.sum()) if seen.sum() > CONFIG.seen * (seen | past).sum() else 0
                if length > CONFIG.few:
                    found.append((length, wall))
        rims[number] = sorted(found, key=lambda rim: rim[0])
    # A line that a longer wall crosses is one of objects in the bin.
    while True:
        longest = [found[-1] for found in rims.values() if found]
        pairs = [(wall, longer) for (a, wall), (b, longer) in permutations(longest, 2) if b > a]
        crossed = {wall.side for wall, longer in pairs if camera.sees_beyond(longer, wall, axes)}
        if not crossed:
            return {number: found[-1][1] for number, found in rims.items() if found}
        for number in crossed:
            rims[number].pop()


def _possible_rim_places(local: Array, number: int, level: float) -> list[float]:
    """Outward positions across a side of possible rims at ``level``, m."""
    rim = local[np.abs(local[:, 2] - level) < CONFIG.level]
    if not len(rim):
        return []
    axis, sign = SIDES[number]
    places, held, _ = _straight_lines(rim, axis, sign)
    limit = np.quantile(sign * local[local[:, 2] > level / 2, axis], 1 - CONFIG.outside) - CONFIG.strip
    peaks = held == np.asarray(cv2.dilate(held.astype(np.float32), np.ones((5, 5), np.uint8))).ravel()
    return [float(place) for place in places[peaks & (held * CONFIG.line > CONFIG.short) & (places > limit)]]


def _measure_wall(local: Array, number: int, place: float, level: float) -> Wall | None:
    """The wall with its rim at ``level`` at a place across a side; ``None`` if it is too short."""
    axis, sign = SIDES[number]
    across, along = sign * local[:, axis], local[:, 1 - axis]
    rim = (np.abs(local[:, 2] - level) < CONFIG.level) & (np.abs(across - place) < CONFIG.strip)
    # Robust line fit through the rim's cells.
    middle, slope = float(np.median(across[rim])), 0.0
    for _ in range(3):
        near = rim & (np.abs(across - middle - slope * along) < CONFIG.thick / 2)
        if np.count_nonzero(near) < 3:
            break
        slope, middle = (float(value) for value in np.polyfit(along[near], across[near], 1))
    rim &= np.abs(across - (middle + slope * along)) < CONFIG.thick / 2
    if len(np.unique(np.floor(along[rim] / CONFIG.line))) * CONFIG.line < CONFIG.short:
        return None
    inner, outer = np.percentile(across[rim], (10, 90))
    start, end = np.percentile(along[rim], (1, 99))
    return Wall(number, float(inner), float(outer), float(start), float(end), level)


def _hidden_walls(
    walls: dict[int, Wall], measured: dict[int, Wall], local: Array, axes: Array, camera: BinCamera
) -> dict[int, Wall]:
    """By side, walls with a rim that is occluded or out of the picture: outermost lines of lower cells, of which the
    side towards the camera is seen wherever it is not occluded, and at which the ``measured`` walls may end."""
    height = next(iter(walls.values())).height
    thick = float(np.median([wall.outer - wall.inner for wall in walls.values()]))
    low = local[local[:, 2] < height + CONFIG.level]
    eye = axes @ camera.pose[:2, 3]
    hidden: dict[int, Wall] = {}
    for number in set(range(len(SIDES))) - set(walls):
        axis, sign = SIDES[number]
        ending = [wall for wall in measured.values() if SIDES[wall.side][0] != axis]
        if not ending:
            continue
        across = sign * low[:, axis]
        places, held, beyond = _straight_lines(low, axis, sign)
        held[beyond > CONFIG.stray] = 0
        peaks = held == np.asarray(cv2.dilate(held.astype(np.float32), np.ones((3, 3), np.uint8))).ravel()
        for line in places[peaks & (held > CONFIG.columns)]:
            place = float(np.median(across[np.abs(across - line) < CONFIG.line]))
            inner = place if sign * eye[axis] < place else place - thick
            wall = extend_to_corners(Wall(number, inner, inner + thick, 0.0, 0.0, height), walls)
            seen, past, _ = camera.check_visibility(side_points(wall, place, axes))
            is_face_seen = seen.sum() > CONFIG.face and past.sum() <= min(CONFIG.few, seen.sum() * (1 - CONFIG.seen))
            if not is_face_seen:
                continue
            # Measured walls must end before it, without a gap that the camera sees past.
            for measured_wall in ending:
                end = sign * (measured_wall.end if sign > 0 else measured_wall.start)
                if end >= wall.outer + CONFIG.margin:
                    break
                gap = rim_points(measured_wall, axes, *sorted((sign * end, sign * wall.inner)))
                if camera.check_visibility(gap)[1].sum() > CONFIG.few:
                    break
            else:
                hidden[number] = wall
    return hidden


def _enclose_raised_cells(walls: Sequence[Wall], cells: Array, axes: Array, camera: BinCamera) -> bool:
    """Whether the walls are seen wherever they are not occluded, and hardly any cell of half their height lies outside:
    lower cells may be the robot's blurred edge."""
    if not all(camera.sees_rim(wall, axes) for wall in walls):
        return False
    local, eye = cells @ _rotation_to_axes(axes), camera.pose[:3, 3] @ _rotation_to_axes(axes)
    local = local[local[:, 2] > walls[0].height / 2]
    outside = np.zeros(len(local), np.bool_)
    for wall in walls:
        axis, sign = SIDES[wall.side]
        across, near = sign * local[:, axis], sign * eye[axis]
        beyond = across > wall.outer + CONFIG.strip
        share = (wall.middle - near) / np.where(beyond, across - near, np.inf)
        crossing = eye[2] + share * (local[:, 2] - eye[2])
        # Depth on a ray that grazes the rim is mixed with the rim's.
        outside |= beyond & ~((share > 0) & (np.abs(crossing - wall.height) < CONFIG.level))
    return bool(outside.mean() < CONFIG.outside)


def _are_long(walls: Sequence[Wall], rims: int, axes: Array, camera: BinCamera) -> bool:
    """Whether enough of several ``rims`` is seen, or of several sides: most rims may be out of the picture."""
    lengths = [int(camera.check_rim(wall, axes)[0].sum()) for wall in walls]
    if rims >= CONFIG.rims and sum(lengths) * CONFIG.line > CONFIG.long:
        return True
    sides = [camera.check_visibility(side_points(wall, wall.inner, axes))[0] for wall in walls]
    counts = [len(rim_points(wall, axes, wall.start, wall.end)) for wall in walls]
    lengths = [int(side.reshape(-1, count).any(axis=0).sum()) for side, count in zip(sides, counts, strict=True)]
    several = sum(length > CONFIG.few for length in lengths) >= CONFIG.sides
    return several and sum(lengths) * CONFIG.line > CONFIG.long


def holds_objects(walls: Sequence[Wall], axes: Array, cells: Array) -> bool:
    """Whether several objects stand apart between the walls, or the walls are farther apart than those of an object: a
    box with a single object in it is an object."""
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
